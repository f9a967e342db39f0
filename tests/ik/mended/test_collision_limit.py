"""The mended collision limit: distances kept at any dt, pairs, recovery; and what mink's does."""

import mink
import mujoco
import numpy as np
import pytest

from robo47_qp.arrays import Vector
from robo47_qp.collision.distance import GeomDistance
from robo47_qp.errors import InvalidValueError, UnknownNameError
from robo47_qp.ik.mended import CollisionLimit, JointLimit
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from tests.small_robots import cell

WALL = """<mujoco><worldbody>
  <geom name="wall" type="box" size=".1 1 1" pos="1.1 0 0"/>
  <body name="frame"><joint name="y" type="slide" axis="0 1 0"/><geom name="rail" size=".01"/>
    <body><joint name="x" type="slide" axis="1 0 0"/><geom name="ball" size=".1"/></body></body>
</worldbody></mujoco>"""
PAIR = [(["wall"], ["ball"])]
Limits = list[mink.Limit]


def wall() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(WALL)


def driven(x: float, dt: float, limits: Limits, steps: int) -> list[tuple[float, float]]:
    """Distance and speed of the ball at each step, pulled into the wall from x."""
    m = wall()
    c, task, seen = mink.Configuration(m, np.array([0.0, x])), mink.PostureTask(m, 1.0), []
    task.set_target(np.array([0.3, 3.0]))
    for _ in range(steps):
        v = mink.solve_ik(c, [task], dt, "daqp", limits=limits)
        for limit in limits:
            if isinstance(limit, JointLimit):
                limit.set_velocity(v)
        c.integrate_inplace(v, dt)
        seen.append((0.9 - c.q[1], v[1]))
    return seen


def keeping(kind: type[mink.Limit], m: mujoco.MjModel) -> Limits:
    limit = kind(m, PAIR, collision_detection_distance=2.5)  # type: ignore[call-arg]
    return [limit, mink.VelocityLimit(m, {"x": 2.0})]


@pytest.mark.parametrize("dt", [1e-3, 0.02, 0.1, 1.0])
def test_the_distance_is_kept_at_any_dt(dt: float) -> None:
    seen = driven(0.5, dt, keeping(CollisionLimit, wall()), 20 + int(0.4 / dt))
    assert min(distance for distance, _ in seen) >= 0.005 - 1e-9
    assert seen[-1][0] == pytest.approx(0.005, abs=1e-6)


@pytest.mark.parametrize("recovery", [0.1, 0.5, 1.0])
def test_a_pair_in_penetration_parts_by_its_share(recovery: float) -> None:
    limit = CollisionLimit(wall(), PAIR, recovery=recovery)
    distances = [distance for distance, _ in driven(0.94, 1.0, [limit], 40)]
    lacking = 0.005 - np.array([-0.04, *distances[:5]])
    assert lacking[1:] == pytest.approx((1.0 - recovery) * lacking[:-1], abs=1e-9)
    assert distances[-1] == pytest.approx(0.005, abs=1e-3)


def test_with_a_joint_limit_it_brakes_in_time() -> None:
    m, dt = wall(), 2e-3
    joints = JointLimit(m, {"x": 2.0, "y": 1.0}, {"x": 5.0, "y": 5.0})
    limit = CollisionLimit(
        m, PAIR, collision_detection_distance=1.0, gain=1.0, joint_limit=joints, braking_share=1.0
    )
    seen = driven(-0.5, dt, [joints, limit], 1500)
    speeds = np.array([0.0, *(v for _, v in seen)])
    assert np.abs(np.diff(speeds)).max() <= 5.0 * dt + 1e-9
    assert min(distance for distance, _ in seen) >= 0.005 - 1e-9
    assert seen[-1][0] == pytest.approx(0.005, abs=1e-6)
    assert speeds.max() == pytest.approx(2.0)


@pytest.mark.parametrize("dt", [1e-3, 0.02])
def test_a_deep_penetration_beside_a_joint_limit_is_not_infeasible(dt: float) -> None:
    m = wall()
    joints = JointLimit(m, {"x": 2.0}, {"x": 5.0})
    limit = CollisionLimit(m, PAIR, recovery=1.0, joint_limit=joints)
    seen = driven(0.98, dt, [joints, limit], int(1.0 / dt))
    assert np.abs(np.diff([0.0, *(v for _, v in seen)])).max() <= 5.0 * dt + 1e-9
    assert seen[-1][0] == pytest.approx(0.005, abs=2e-3)


SLIT = """<mujoco><worldbody>
  <geom name="left" type="box" size="1 .1 1" pos="1.2 .19 0"/>
  <geom name="right" type="box" size="1 .1 1" pos="1.2 -.19 0"/>
  <body><joint name="y" type="slide" axis="0 1 0"/>
    <inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>
    <body><joint name="x" type="slide" axis="1 0 0"/><geom name="ball" size=".1"/></body></body>
</worldbody></mujoco>"""
"""Of 18 cm; the ball has 20 cm."""


@pytest.mark.parametrize(("start", "in_time"), [(-1.0, True), (-0.1, False)])
def test_rows_that_no_step_meets_are_relaxed_and_that_is_told(start: float, in_time: bool) -> None:
    """A slit that is too narrow is met at 2 m/s, which takes 0.4 m to brake."""
    m, dt = mujoco.MjModel.from_xml_string(SLIT), 0.01
    joints = JointLimit(m, {"x": 2.0, "y": 1.0}, {"x": 5.0, "y": 5.0})
    limit = CollisionLimit(
        m, [(["left", "right"], ["ball"])], collision_detection_distance=1.0, joint_limit=joints
    )
    c, task, relaxed = mink.Configuration(m, np.array([0.0, start])), mink.PostureTask(m, 1.0), []
    task.set_target(np.array([0.0, 3.0]))
    speeds, least = [np.array([0.0, 2.0])], np.inf
    joints.set_velocity(speeds[0])
    for _ in range(200):
        speeds.append(mink.solve_ik(c, [task], dt, "daqp", limits=[joints, limit]))
        joints.set_velocity(speeds[-1])
        c.integrate_inplace(speeds[-1], dt)
        relaxed.append(limit.relaxed)
        least = min(least, *(mujoco.mj_geomDistance(m, c.data, g, 2, 1.0, None) for g in (0, 1)))
    assert np.abs(np.diff(speeds, axis=0)).max() <= 5.0 * dt + 1e-9
    assert (max(relaxed) < 1e-3) == in_time
    assert (least > 0.004) == in_time
    c.update(np.array([0.0, -3.0]))
    limit.compute_qp_inequalities(c, dt)
    assert limit.relaxed == 0.0


def panda_limit(clearance: float, far: float) -> tuple[Arm, CollisionLimit]:
    arm = Arm(PANDA, obstacles=cell())
    geoms = range(arm.model.ngeom)
    limit = CollisionLimit(
        arm.model,
        [(geoms, geoms)],
        gain=1.0,
        recovery=1.0,
        minimum_distance_from_collisions=clearance,
        collision_detection_distance=far,
    )
    return arm, limit


def test_rows_are_how_distances_fall(rng: np.random.Generator) -> None:
    """By differences of distances, for every pair within 20 cm, apart or overlapping."""
    arm, limit = panda_limit(0.0, 0.2)
    m, d, h, apart, inside = arm.model, mujoco.MjData(arm.model), 1e-6, 0, 0
    measure = GeomDistance(m, d)

    def distances(q: Vector) -> Vector:
        d.qpos[:] = q
        mujoco.mj_kinematics(m, d)
        return np.array([measure.between(*pair, 0.2) for pair in limit.geom_id_pairs])

    for _ in range(12):
        q = rng.uniform(arm.q_min, arm.q_max)
        G, bound = limit.compute_qp_inequalities(mink.Configuration(m, q), 0.1)
        assert G is not None
        assert bound is not None
        slope = np.array([distances(q + s) - distances(q - s) for s in h * np.eye(7)]).T / (-2 * h)
        now = distances(q)
        near = (now < 0.2) & (np.abs(slope).max(axis=1) > 1e-8)
        assert bound == pytest.approx(now[near], abs=1e-12)
        # At edges of boxes the nearest points, and with them the slopes, jump.
        assert np.mean(np.abs(G - slope[near]).max(axis=1) < 1e-5) > 0.95
        apart, inside = apart + int((now[near] > 0).sum()), inside + int((now[near] < 0).sum())
    assert apart > 40
    assert inside > 0


def test_geoms_that_touch_exactly_have_a_direction() -> None:
    m = wall()
    limit = CollisionLimit(m, PAIR)
    G, h = limit.compute_qp_inequalities(mink.Configuration(m, np.array([0.0, 0.9])), 0.1)
    assert G is not None
    assert pytest.approx(np.array([[0.0, 1.0]]), abs=1e-6) == G
    assert h == pytest.approx([-0.0025], abs=1e-9)


def test_an_arm_among_obstacles_keeps_its_distance(rng: np.random.Generator) -> None:
    arm, _ = panda_limit(0.0, 0.1)
    m, dt = arm.model, 0.01
    robot = [g for g in range(m.ngeom) if m.body_weldid[m.geom_bodyid[g]] > 0]
    still = [obstacle.name for obstacle in cell()]
    profile = arm.robot.profile
    joints = JointLimit(
        m,
        dict(zip(arm.robot.joints, profile.v_max.tolist(), strict=True)),
        dict(zip(arm.robot.joints, profile.a_max.tolist(), strict=True)),
    )
    limit = CollisionLimit(
        m, [(still, robot)], gain=0.3, collision_detection_distance=0.5, joint_limit=joints
    )
    c, task, least = mink.Configuration(m, arm.home), mink.PostureTask(m, 1.0), np.inf
    for tick in range(400):
        if tick % 80 == 0:
            task.set_target(rng.uniform(arm.q_min, arm.q_max))
        v = mink.solve_ik(c, [task], dt, "daqp", limits=[joints, limit])
        joints.set_velocity(v)
        c.integrate_inplace(v, dt)
        for pair in limit.geom_id_pairs:
            least = min(least, mujoco.mj_geomDistance(m, c.data, *pair, 0.5, None))
    assert 0.004 < least < 0.03


# Pairs -----------------------------------------------------------------------------------------


def test_the_first_moving_link_is_kept_from_the_world() -> None:
    m = wall()
    limit = CollisionLimit(m, [(["wall"], ["rail", "ball"])])
    assert limit.geom_id_pairs == ((0, 1), (0, 2))
    assert limit.dropped == ()


def test_pairs_are_sorted_and_each_is_there_once() -> None:
    arm, limit = panda_limit(0.0, 0.1)
    assert list(limit.geom_id_pairs) == sorted(set(limit.geom_id_pairs))
    assert all(a < b for a, b in limit.geom_id_pairs)
    dropped = {pair.geoms for pair in limit.dropped}
    assert not dropped & set(limit.geom_id_pairs)
    n = arm.model.ngeom
    assert len(dropped) + len(limit.geom_id_pairs) == n * (n - 1) // 2


def test_what_is_dropped_is_told_with_its_reason() -> None:
    m = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
      <geom name="floor" type="plane" size="1 1 1" pos="0 0 -3"/>
      <geom name="ghost" size=".1" contype="0" conaffinity="0"/>
      <body name="mocap" mocap="true"><geom name="marker" size=".1"/></body>
      <body name="foot"><geom name="foot" size=".1"/>
        <body><joint/><geom name="link1" size=".1"/>
          <body><joint/><geom name="link2" size=".1"/></body></body></body>
      <body><geom name="table" size=".1"/></body>
    </worldbody></mujoco>""")
    names = [m.geom(g).name for g in range(m.ngeom)]
    limit = CollisionLimit(m, [(names, names)])
    kept = {tuple(m.geom(g).name for g in pair) for pair in limit.geom_id_pairs}
    assert kept == {
        *(("floor", "link1"), ("floor", "link2"), ("marker", "link1"), ("marker", "link2")),
        *(("foot", "link2"), ("link1", "table"), ("link2", "table")),
    }
    why = {tuple(m.geom(g).name for g in one.geoms): one.reason for one in limit.dropped}
    assert why["foot", "link1"] == why["link1", "link2"] == "neighbours that a joint connects"
    assert why["ghost", "link1"] == "contype and conaffinity of the model"
    assert why["floor", "marker"] == "no joint moves one against the other"


def test_bad_input_is_told() -> None:
    m = wall()
    with pytest.raises(UnknownNameError, match="geom is called 'shelf'; known: wall, rail, ball"):
        CollisionLimit(m, [(["shelf"], ["ball"])])
    with pytest.raises(InvalidValueError, match="number of a geom must be"):
        CollisionLimit(m, [([7], ["ball"])])
    with pytest.raises(InvalidValueError, match="pairs of which one can be kept apart"):
        CollisionLimit(m, [(["rail"], ["ball"])])
    with pytest.raises(InvalidValueError, match="none was given"):
        CollisionLimit(m, [])
    with pytest.raises(InvalidValueError, match=r"collision_detection_distance must be above 0.2"):
        CollisionLimit(m, PAIR, minimum_distance_from_collisions=0.2)
    for wrong in ("gain", "recovery", "braking_share"):
        with pytest.raises(InvalidValueError, match=f"{wrong} must be"):
            CollisionLimit(m, PAIR, **{wrong: np.nan})  # type: ignore[arg-type]


# What plain mink does ---------------------------------------------------------------------------


@pytest.mark.xfail(reason="mink 1.3: bounds a displacement by a speed")
def test_mink_keeps_the_distance_at_dt_0_02() -> None:
    seen = driven(0.5, 0.02, keeping(mink.CollisionAvoidanceLimit, wall()), 40)
    assert min(distance for distance, _ in seen) >= 0.005 - 1e-9


def test_mink_keeps_the_distance_at_dt_1() -> None:
    """So the expected failure above is about dt, and nothing else."""
    seen = driven(0.5, 1.0, keeping(mink.CollisionAvoidanceLimit, wall()), 40)
    assert min(distance for distance, _ in seen) >= 0.005 - 1e-9


@pytest.mark.xfail(reason="mink 1.3: never parts geoms that are too close")
def test_mink_parts_a_pair_in_penetration() -> None:
    seen = driven(0.94, 1.0, [mink.CollisionAvoidanceLimit(wall(), PAIR)], 40)
    assert seen[-1][0] > 0.0


@pytest.mark.xfail(reason="mink 1.3: drops pairs of the world and the first moving link")
def test_mink_keeps_the_first_moving_link_from_the_world() -> None:
    limit = mink.CollisionAvoidanceLimit(wall(), [(["wall"], ["rail", "ball"])])
    assert (0, 1) in limit.geom_id_pairs


@pytest.mark.xfail(reason="mink 1.3: pairs come in the order of a set")
def test_minks_pairs_are_sorted() -> None:
    arm, _ = panda_limit(0.0, 0.1)
    geoms = range(arm.model.ngeom)
    pairs = mink.CollisionAvoidanceLimit(arm.model, [(geoms, geoms)]).geom_id_pairs
    ordered = pairs == sorted(pairs)
    # Not compared in the assertion: pytest would explain at length how thousands of pairs differ.
    assert ordered
