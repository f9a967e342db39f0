"""Speed limits between geoms: what they let through stops in time, and nothing near is missed."""

from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mink import SE3, SO3
from numpy.typing import NDArray

from robo47_qp.arrays import Vector
from robo47_qp.collision.clearance import Clearance
from robo47_qp.evaluation.benchmarks.ik.hostile_targets import OBSTACLES, PAIR_OBSTACLES
from robo47_qp.ik.stream.clearance_bounds import ClearanceBounds, VelocityRows
from robo47_qp.ik.stream.compiled_bounds import CompiledBounds
from robo47_qp.ik.stream.joint_bounds import max_stoppable_speed
from robo47_qp.model.arm import Arm
from robo47_qp.model.obstacle import Obstacle, Shape
from robo47_qp.model.robot import Robot
from robo47_qp.model.robots import load_robot
from tests.small_robots import small_robot

DT, KEEP = 1e-3, 0.02


@pytest.fixture(scope="module")
def among(robot: Robot) -> Arm:
    """The arm with a ball near its tool and a floor."""
    tool = Arm(robot).pose(Arm(robot).home).translation()
    ball = SE3.from_translation(tool + np.array([0.05, 0.3, 0.0]))
    floor = SE3.from_translation(np.array([0.0, 0.0, -0.3]))
    return Arm(
        robot,
        obstacles=[
            Obstacle(name="ball", shape=Shape.SPHERE, size=(0.1,), T_world_obstacle=ball),
            Obstacle(name="floor", shape=Shape.PLANE, T_world_obstacle=floor),
        ],
    )


class _Updated(ClearanceBounds):
    """Brings its state up to date itself."""

    def reset(self, q: Vector) -> None:
        self.update(q)
        super().reset(q)

    def rows(self, q: Vector, v: Vector) -> VelocityRows:
        self.update(q)
        return super().rows(q, v)

    def update(self, q: Vector) -> None:
        self._data.qpos[:] = q
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)


class InNumpy(_Updated, ClearanceBounds):
    """The reference."""


class InCore(_Updated, CompiledBounds):
    """The compiled core."""


Kind = type[InNumpy] | type[InCore]
each = pytest.mark.parametrize("kind", [InNumpy, InCore])


def clearance_bounds(
    kind: Kind, arm: Arm, max_pairs: int = 500, keep: float = KEEP
) -> tuple[InNumpy | InCore, Clearance]:
    clearance = Clearance(arm, KEEP)
    made = kind(
        clearance,
        mujoco.MjData(arm.model),
        arm.robot.rated.a_max,
        DT,
        d_min=keep,
        braking_share=0.5,
        max_pairs=max_pairs,
    )
    return made, clearance


@each
def test_every_near_pair_has_its_row_on_any_path(
    among: Arm, rng: np.random.Generator, kind: Kind
) -> None:
    """All distances by brute force, along paths that change direction."""
    made, clearance = clearance_bounds(kind, among)
    q, v = among.home.copy(), np.zeros(among.n)
    made.reset(q)
    near = 0
    for k in range(400):
        if k % 100 == 0:
            v = rng.uniform(-1.5, 1.5, among.n)
        q = np.clip(q + DT * v, among.q_min, among.q_max)
        rows = made.rows(q, v)
        assert len(rows.pair) == len(set(rows.pair.tolist()))
        if k % 10:
            continue
        told = dict(zip(rows.pair.tolist(), rows.room.tolist(), strict=True))
        found = clearance.pairs_within(q, KEEP + 0.03)
        for pair, distance in zip(found.pair.tolist(), found.distance.tolist(), strict=True):
            assert told[pair] == pytest.approx(distance - KEEP, abs=1e-9)
            near += 1
        if len(found.pair):
            assert made.measured == pytest.approx(found.distance[0], abs=1e-9)
    assert near > 20


@each
def test_rows_are_rates_of_distances_and_leave_room_to_brake(
    among: Arm, rng: np.random.Generator, kind: Kind
) -> None:
    made, clearance = clearance_bounds(kind, among)
    a = 0.5 * among.robot.rated.a_max
    checked = 0
    for _ in range(12):
        q = among.home + rng.uniform(-0.3, 0.3, among.n)
        v = rng.uniform(-1.0, 1.0, among.n)
        made.reset(q)
        rows = made.rows(q, v)
        for A, upper, room, pair in zip(*rows, strict=True):
            h = 1e-6 * v
            ahead, back = (clearance.distance_of(int(pair), q + s * h) for s in (1, -1))
            if room + KEEP < 1e-3:
                continue
            # Smooth but for the edges of boxes: nearest points jump there.
            rate = -(ahead - back) / 2e-6
            if abs(A @ v - rate) < 1e-4:
                checked += 1
            if room >= 0.0:
                brake = max(float(np.abs(A) @ a), 1e-9)
                assert upper == pytest.approx(float(max_stoppable_speed(room, A @ v, brake, DT)))
            else:
                assert upper < 0.0
    assert checked > 30


@each
def test_a_pair_that_is_too_close_has_to_part_but_gently(among: Arm, kind: Kind) -> None:
    least = Clearance(among, KEEP).nearest(among.home)[0]
    made, _ = clearance_bounds(kind, among, max_pairs=50, keep=least + 1e-3)
    made.reset(among.home)
    rows = made.rows(among.home, np.zeros(among.n))
    assert rows.room.min() == pytest.approx(-1e-3, abs=1e-9)
    assert -0.011 < rows.upper[rows.room.argmin()] < 0.0


def test_the_budget_bounds_the_work_and_the_nearest_come_first(
    among: Arm, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, clearance = clearance_bounds(InNumpy, among, max_pairs=3)
    core, _ = clearance_bounds(InCore, among, max_pairs=3)
    assert isinstance(core, InCore)
    for one in (made, core):
        one.reset(among.home)
    looked: list[int] = []
    update = made._update

    def counted(picked: NDArray[np.intp], far: Vector) -> None:
        looked.append(len(picked))
        update(picked, far)

    monkeypatch.setattr(made, "_update", counted)
    v = among.robot.rated.v_max
    q = among.home.copy()
    for _ in range(20):
        made.rows(q, v)
        core.rows(q, v)
        assert core._core.pointer.picked == looked[-1]
        q = q + DT * v
    assert max(looked) == 3
    for one in (made, core):
        one.rows(q, np.zeros(among.n))
        assert one.measured <= clearance.nearest(q)[0] + 0.01


@pytest.mark.parametrize(("name", "most"), [("panda", 3), ("panda", 5000), ("panda_pair", 5000)])
def test_the_core_tells_the_rows_of_the_reference(name: str, most: int) -> None:
    """Into and out of contact; with pairs that wait for their turn, or all rows, and old ones."""
    rng = np.random.default_rng(7)
    arm = Arm(load_robot(name), obstacles=OBSTACLES if name == "panda" else PAIR_OBSTACLES)
    pair = [clearance_bounds(kind, arm, max_pairs=most)[0] for kind in (InNumpy, InCore)]
    goals = [arm.home, *rng.uniform(arm.q_low, arm.q_high, (5, arm.n))]
    kinds = pair[0]._measure
    told = negative = crossed = 0
    for one in pair:
        one.reset(arm.home)
    for start, end in pairwise(goals):
        v = 0.5 * (end - start)
        for q in np.linspace(start, end, 20 if name == "panda_pair" else 40):
            expected, found = (one.rows(q, v) for one in pair)
            assert found.pair.tolist() == expected.pair.tolist()
            for got, wanted in zip(found[:3], expected[:3], strict=True):
                np.testing.assert_allclose(got, wanted, rtol=1e-9, atol=1e-9)
            assert pair[1].measured == pytest.approx(pair[0].measured, abs=1e-12)
            told += len(expected.pair)
            negative += int((expected.room < -KEEP).sum())
            deep = expected.pair[expected.room < -KEEP].tolist()
            crossed += any(kinds.capsule_and_box(*pair[0]._ends[i])[0] >= 0 for i in deep)
    assert min(told, 20 * negative) > 500
    assert crossed > 5 or most == 3


_SWING = """
<mujoco><compiler angle="radian"/><worldbody><body name="base">
  <geom name="foot" size="0.01" pos="0 0 -5"/>
  <body name="arm"><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>
    <joint name="swing" axis="0 0 1" range="-3 3"/>
    <geom name="tip" size="0.05" pos="1 0 0"/><site name="tool" pos="1 0 0"/>
</body></body></worldbody></mujoco>
"""


_ASIDE = np.pi / 2


@each
@pytest.mark.parametrize(
    ("wall", "turns", "speed"),
    [
        # From 10 cm of room to 2.5 within the travel that a row is trusted for.
        (0.83, [0.0, 0.39], 0.1),
        # Half way round: the first row says all the way that the tip comes no closer.
        (-0.5, [0.0, 2.0], 0.2),
        # Near and back, which a bound does not know: it is looked at too far away for a row.
        (-0.25, [_ASIDE, _ASIDE + 0.1, _ASIDE - 0.05, _ASIDE + 0.16], 0.05),
    ],
    ids=["close", "round", "back"],
)
def test_a_tip_that_swings_towards_a_wall_is_seen_to_come(
    tmp_path: Path, wall: float, turns: list[float], speed: float, kind: Kind
) -> None:
    normal = SO3.from_y_radians(np.pi / 2)
    T = SE3.from_rotation_and_translation(normal, np.array([wall, 0.0, 0.0]))
    obstacle = Obstacle(name="wall", shape=Shape.PLANE, T_world_obstacle=T)
    arm = Arm(small_robot(tmp_path, _SWING, ("swing",)), obstacles=[obstacle])
    made, _ = clearance_bounds(kind, arm)
    near = 0
    made.reset(np.array(turns[:1]))
    for start, end in pairwise(turns):
        v = speed * np.sign(end - start)
        for q in np.arange(start, end, v * DT):
            rows = made.rows(np.array([q]), np.array([v]))
            room = np.cos(q) - wall - 0.05 - KEEP
            if room < 0.03:
                assert rows.room.min() == pytest.approx(room, abs=1e-9)
                near += 1
    assert near > 50


@each
def test_a_pair_that_touches_keeps_the_row_that_it_had(tmp_path: Path, kind: Kind) -> None:
    normal = SO3.from_y_radians(np.pi / 2)
    T = SE3.from_rotation_and_translation(normal, np.zeros(3))
    obstacle = Obstacle(name="wall", shape=Shape.PLANE, T_world_obstacle=T)
    arm = Arm(small_robot(tmp_path, _SWING, ("swing",)), obstacles=[obstacle])
    made, _ = clearance_bounds(kind, arm)
    touching = np.arccos(0.05)
    made.reset(np.array([touching - 1e-3]))
    before = made.rows(np.array([touching - 1e-3]), np.ones(1)).A.copy()
    after = made.rows(np.array([touching]), np.ones(1))
    assert abs(made.measured) < 1e-12
    assert np.abs(before).max() > 0.9
    assert after.A.tolist() == before.tolist()
