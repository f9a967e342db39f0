"""Levers as bounds: no pair's distance changes faster, on any path."""

import mujoco
import numpy as np
import pytest

from robo47_qp.collision.clearance import Clearance
from robo47_qp.collision.motion_bounds import approach_speed_bounds
from robo47_qp.model.arm import Arm

SLIDER = """
<mujoco><compiler angle="radian"/><worldbody>
  <geom name="wall" type="box" size="0.1 1 5" pos="3 0 0"/>
  <body name="cart" pos="0 0 0.5">
    <joint name="drive" type="slide" axis="1 0 0" range="-0.5 1.5" pos="0 0 0.1"/>
    <geom name="cart" size="0.1"/>
    <body name="link" pos="0 0 0.3">
      <joint name="turn" axis="0 1 0" range="-3 3" pos="0 0 0.2"/>
      <geom name="link" type="capsule" fromto="0 0 0 0 0 0.6" size="0.05"/>
    </body>
  </body>
</worldbody></mujoco>
"""


def test_distances_of_an_arm_change_no_faster(arm: Arm, rng: np.random.Generator) -> None:
    clearance = Clearance(arm, 0.01)
    L = approach_speed_bounds(arm.model, clearance.pairs.kept)
    assert L.shape == (len(clearance.pairs.kept), arm.n)
    tightest = 0.0
    for _ in range(400):
        q = rng.uniform(arm.q_min, arm.q_max)
        step = rng.normal(size=arm.n) * 10.0 ** rng.uniform(-4, -0.5)
        pair = int(rng.integers(len(L)))
        change = abs(clearance.distance_of(pair, q + step) - clearance.distance_of(pair, q))
        bound = L[pair] @ np.abs(step)
        assert change <= bound + 1e-9
        tightest = max(tightest, change / (bound + 1e-9))
    assert tightest > 0.3  # bounds of a kilometre would hold, too


def test_a_joint_that_moves_both_or_none_has_no_lever(arm: Arm) -> None:
    m, clearance = arm.model, Clearance(arm, 0.01)
    L = approach_speed_bounds(m, clearance.pairs.kept)
    rng = np.random.default_rng(1)
    for pair in rng.choice(len(L), size=20, replace=False):
        q = rng.uniform(arm.q_min, arm.q_max)
        for joint in np.flatnonzero(L[pair] == 0.0):
            moved = q.copy()
            moved[joint] = arm.q_min[joint]
            before, after = (
                clearance.distance_of(int(pair), q),
                clearance.distance_of(int(pair), moved),
            )
            assert after == pytest.approx(before, abs=1e-9)


HEAD = """<mujoco><compiler angle="radian"/><worldbody>
  <geom name="post" size="0.05" pos="1 1 0"/>
  <body><joint axis="0 0 1" range="-3 3"/>"""
TAIL = '<geom name="hand" size="0.05"/></body></worldbody></mujoco>'
MASS = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
LATER = {
    "a slide of the same body": '<joint type="slide" axis="1 0 0" range="0 1"/>',
    "a hinge beside it": '<joint axis="0 0 1" pos="0.5 0 0" range="-3 3"/>',
    "both": '<joint axis="0 0 1" pos="0 0.3 0" range="-3 3"/>'
    '<joint type="slide" axis="0 1 0" range="-0.4 0.2"/>',
    "a slide that begins elsewhere": f'{MASS}<body pos="0.1 0 0">'
    '<joint type="slide" axis="1 0 0" ref="-1" range="-0.2 0.2"/><geom size="0.05"/></body>',
}


@pytest.mark.parametrize("later", LATER.values(), ids=LATER)
def test_later_joints_of_a_body_carry_it_away_from_the_first(later: str) -> None:
    m = mujoco.MjModel.from_xml_string(HEAD + later + TAIL)
    d, rng, step = mujoco.MjData(m), np.random.default_rng(3), 1e-4
    pairs = tuple((0, geom) for geom in range(1, m.ngeom))
    L, tightest = approach_speed_bounds(m, pairs), 0.0
    for _ in range(1500):
        q, joint = rng.uniform(m.jnt_range[:, 0], m.jnt_range[:, 1]), int(rng.integers(m.njnt))
        ways = []
        for at in (q, q + step * (np.arange(m.njnt) == joint)):
            d.qpos[:] = at
            mujoco.mj_kinematics(m, d)
            ways.append([mujoco.mj_geomDistance(m, d, a, b, 100.0, None) for a, b in pairs])
        if min(map(min, ways)) > 0.0:
            rates = np.abs(np.array(ways[1]) - np.array(ways[0])) / step
            assert (rates <= L[:, joint] + 1e-6).all()
            tightest = max(tightest, *(rates[rates > 0.0] / L[rates > 0.0, joint]), 0.0)
    assert tightest > 0.5


def test_slides_and_joints_beside_the_frame_of_their_body() -> None:
    m = mujoco.MjModel.from_xml_string(SLIDER)
    d = mujoco.MjData(m)
    wall, cart, link = (m.geom(name).id for name in ("wall", "cart", "link"))
    L = approach_speed_bounds(m, ((wall, cart), (wall, link), (cart, link)))
    assert L[0].tolist() == [1.0, 0.0]
    assert L[1, 0] == 1.0
    assert L[2, 0] == 0.0
    rng, nearest = np.random.default_rng(5), 0.0
    for _ in range(500):
        q = rng.uniform(m.jnt_range[:, 0], m.jnt_range[:, 1])
        step = np.array([0.0, 1e-4])
        ways = []
        for at in (q, q + step):
            d.qpos[:] = at
            mujoco.mj_kinematics(m, d)
            ways.append(mujoco.mj_geomDistance(m, d, wall, link, 10.0, None))
        rate = abs(ways[1] - ways[0]) / 1e-4
        assert rate <= L[1, 1]
        nearest = max(nearest, rate)
    assert nearest > 0.3


BESIDE = """
<mujoco><compiler angle="radian"/><worldbody>
  <geom name="wall" type="plane" size="5 5 1" pos="0 -2 0" zaxis="0 1 0"/>
  <body>
    <joint axis="0 0 1" range="-3.2 3.2"/>
    <geom size="0.02"/>
    <body pos="0.5 0 0">
      <joint axis="0 0 1" range="-3.2 3.2" pos="0.2 0 0"/>
      <geom name="tip" size="0.05"/>
    </body>
  </body>
</worldbody></mujoco>
"""


def test_a_link_that_swings_about_a_joint_beside_its_frame_reaches_further() -> None:
    """Folded out, the tip is 0.5 m and twice 0.2 m away from the first joint."""
    m = mujoco.MjModel.from_xml_string(BESIDE)
    d = mujoco.MjData(m)
    wall, tip = m.geom("wall").id, m.geom("tip").id
    ways = []
    for first in (-1e-4, 1e-4):
        d.qpos[:] = first, np.pi
        mujoco.mj_kinematics(m, d)
        ways.append(mujoco.mj_geomDistance(m, d, wall, tip, 10.0, None))
    rate = (ways[1] - ways[0]) / 2e-4
    assert rate == pytest.approx(0.9, abs=1e-3)
    assert approach_speed_bounds(m, ((wall, tip),))[0, 0] >= rate
