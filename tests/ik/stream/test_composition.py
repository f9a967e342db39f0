"""Streams with a user's objectives and limits, demands on the tool, and several tools."""

from collections.abc import Callable, Sequence

import mink
import mujoco
import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import Robo47Error
from robo47_qp.evaluation.benchmarks.ik.hostile_targets import PAIR_OBSTACLES, pair_targets, targets
from robo47_qp.evaluation.benchmarks.ik.stream_audit import audit, clearance_audit
from robo47_qp.ik.objectives import Objective
from robo47_qp.ik.stream.settings import Event, StreamTick
from robo47_qp.ik.stream.stream import StreamIk, StreamSolver
from robo47_qp.ik.tool_demand import POSITION, Direction, FreeAxis
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots import load_robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.tool_poses import ToolPoses
from robo47_qp.motion.waypoint import tool_down

DT = 1e-3


class ElbowAside(mink.Task):
    """The elbow at a distance to the left of the base."""

    def __init__(self, y: float, cost: float = 1.0) -> None:
        super().__init__(cost=np.array([cost]))
        self.y = y

    def compute_error(self, configuration: mink.Configuration) -> Vector:
        elbow = configuration.get_transform_frame_to_world("link4", "body")
        return np.array([elbow.translation()[1] - self.y])

    def compute_jacobian(self, configuration: mink.Configuration) -> Matrix:
        m, d, J = configuration.model, configuration.data, np.zeros((3, configuration.nv))
        mujoco.mj_jacBody(m, d, J, None, m.body("link4").id)
        return J[1:2]


class Floor(mink.Limit):
    """The tool stays above a height, or below it for a negative sign."""

    def __init__(self, height: float, sign: float = 1.0) -> None:
        self.height, self.sign = height, sign

    def compute_qp_inequalities(
        self, configuration: mink.Configuration, dt: float
    ) -> mink.Constraint:
        T = configuration.get_transform_frame_to_world("tcp", "site")
        J = configuration.get_frame_jacobian("tcp", "site")
        Jz = (T.rotation().as_matrix() @ J[:3])[2:]
        room = self.sign * (T.translation()[2] - self.height)
        return mink.Constraint(-self.sign * Jz, np.array([room]))


class Slow(mink.Limit):
    """Joint 1 no faster than a speed."""

    def compute_qp_inequalities(
        self, configuration: mink.Configuration, dt: float
    ) -> mink.Constraint:
        G = np.zeros((2, configuration.nv))
        G[:, 0] = 1.0, -1.0
        return mink.Constraint(G, np.full(2, 0.2 * dt))


def posture(arm: Arm) -> mink.PostureTask:
    task = mink.PostureTask(arm.model, cost=np.array([0, 0, 1.0, 0, 0, 0, 0]))
    task.set_target(arm.home + np.array([0, 0, 0.6, 0, 0, 0, 0]))
    return task


def ran(
    stream: StreamSolver, count: int, target: Callable[[int], object] | SE3 | dict[str, SE3]
) -> list[StreamTick]:
    """Ticks on a target that moves, or that stays."""
    return [stream.tick(target(k) if callable(target) else target) for k in range(count)]


def kept(stream: StreamSolver, q0: Vector, ticks: Sequence[StreamTick]) -> None:
    q, v, a = (np.array([getattr(tick, name) for tick in ticks]) for name in "qva")
    found = audit(stream.arm, stream.profile, DT, q0, q, v, a)
    assert [found[f"{name}_violations"] for name in "qva"] == [0, 0, 0]


def circle(T: SE3, k: int) -> SE3:
    t = 2.0 * DT * k
    return SE3.from_translation(0.1 * np.array([0.0, np.sin(t), np.cos(t) - 1.0])) @ T


def test_an_objective_moves_the_arm_in_what_the_tool_leaves_free() -> None:
    arm = Arm(PANDA)
    T = arm.pose(arm.home)
    plain = StreamIk(dt=DT).build(arm)
    own = StreamIk(dt=DT, objectives=(posture,)).build(arm)
    before = ran(plain, 1500, lambda k: circle(T, k))
    after = ran(own, 1500, lambda k: circle(T, k))
    kept(own, arm.home, after)
    assert abs(before[-1].q[2]) < 0.2
    assert after[-1].q[2] == pytest.approx(0.6, abs=1e-2)
    assert max(tick.position_error for tick in after[500:]) < 1.5e-4
    assert own.counts[Event.OBJECTIVE_LEFT_OUT] == own.counts[Event.NO_ANSWER] == 0


def elbow_of(arm: Arm, q: Vector) -> float:
    return float(arm.place_only(q).xpos[arm.model.body("link4").id][1])


def test_a_task_of_a_users_own_is_met_and_what_cannot_be_is_counted() -> None:
    arm = Arm(PANDA)
    T = arm.pose(arm.home)
    stream = StreamIk(dt=DT, objectives=(ElbowAside(0.1),)).build(arm)
    end = ran(stream, 1200, T)[-1]
    assert end.position_error < 1e-5
    assert elbow_of(arm, end.q) == pytest.approx(0.1, abs=1e-4)
    assert not end.events
    far = StreamIk(dt=DT, objectives=(ElbowAside(2.0),)).build(arm)
    ticks = ran(far, 800, T)
    assert max(tick.position_error for tick in ticks) < 1e-3
    assert far.counts[Event.OBJECTIVE_RELAXED] > 0


def test_priority_0_trades_off_with_the_tool_and_the_second_priority_waits_for_the_first() -> None:
    arm = Arm(PANDA)
    T = arm.pose(arm.home)
    tool = mink.FrameTask("tcp", "site", position_cost=1.0, orientation_cost=0.3)
    tool.set_target(SE3.from_translation(np.array([0.0, 0.1, 0.0])) @ T)
    mixed = StreamIk(dt=DT, objectives=(Objective(tool, priority=0),)).build(arm)
    end = ran(mixed, 700, T)[-1]
    halfway = arm.pose(end.q).translation() - T.translation()
    np.testing.assert_allclose(halfway, [0.0, 0.05, 0.0], atol=1e-3)
    assert Event.OBJECTIVE_RELAXED in end.events
    for first, second in ((0.1, -0.1), (-0.1, 0.1)):
        both = Objective(ElbowAside(second), priority=2), Objective(ElbowAside(first), priority=1)
        stream = StreamIk(dt=DT, objectives=both).build(arm)
        end = ran(stream, 1000, T)[-1]
        assert elbow_of(arm, end.q) == pytest.approx(first, abs=1e-3)
        assert stream.counts[Event.OBJECTIVE_RELAXED] > 900


def test_objectives_that_fight_at_the_same_priority_are_a_counted_compromise() -> None:
    arm = Arm(PANDA)
    T = arm.pose(arm.home)
    fighting = ElbowAside(0.1), ElbowAside(0.0, cost=2.0)
    end = ran(StreamIk(dt=DT, objectives=fighting).build(arm), 1200, T)[-1]
    assert Event.OBJECTIVE_RELAXED in end.events
    assert elbow_of(arm, end.q) == pytest.approx(0.1 / 5.0, abs=1e-3)  # squares of costs 1 and 2
    assert end.position_error < 1e-4


@pytest.mark.parametrize("clearance", [None, 0.01])
def test_a_limit_on_a_way_is_kept_though_it_knows_nothing_of_brakes(
    clearance: float | None,
) -> None:
    arm = Arm(PANDA)
    T = arm.pose(arm.home)
    height = float(T.translation()[2]) - 0.1
    stream = StreamIk(dt=DT, profile=PANDA.rated, clearance=clearance, limits=(Floor(height),))
    solver = stream.build(arm)
    low = SE3.from_translation(np.array([0.0, 0.1, -0.3])) @ T
    ticks = ran(solver, 900, low)
    z = np.array([arm.pose(tick.q).translation()[2] for tick in ticks])
    assert z.min() > height - 1e-5
    assert z[-1] == pytest.approx(height, abs=1e-3)
    kept(solver, arm.home, ticks)
    aside = arm.pose(ticks[-1].q).translation()[1]
    assert aside == pytest.approx(0.1, abs=0.015)  # what the limit leaves is done
    assert solver.counts[Event.LIMIT_RELAXED] == 0


def test_a_limit_on_a_speed_is_kept_as_it_is() -> None:
    arm = Arm(PANDA)
    aside = SE3.from_translation(np.array([0.0, 0.3, 0.0])) @ arm.pose(arm.home)
    ticks = ran(StreamIk(dt=DT, limits=(Slow(),)).build(arm), 700, aside)
    speeds = np.abs([tick.v[0] for tick in ticks])
    assert 0.19 < speeds.max() < 0.2 + 1e-6


def test_limits_against_each_other_give_way_before_clearances_and_are_counted() -> None:
    arm = Arm(PANDA, obstacles=PAIR_OBSTACLES[:1])
    T = arm.pose(arm.home)
    z = float(T.translation()[2])
    fighting = (Floor(z + 0.1), Floor(z - 0.1, sign=-1.0))
    solver = StreamIk(dt=DT, clearance=0.01, limits=fighting).build(arm)
    low = tool_down([0.5, 0.1, -0.3])
    ticks = ran(solver, 900, low)
    assert solver.counts[Event.LIMIT_RELAXED] > 100
    assert solver.counts[Event.NO_ANSWER] == 0
    kept(solver, arm.home, ticks)
    q = np.array([tick.q for tick in ticks])
    assert clearance_audit(PANDA, arm.obstacles, q, 0.01)["clearance_violations"] == 0


class Broken(mink.Task):
    """Fine at home, and then it raises or is NaN."""

    def __init__(self, arm: Arm, how: str) -> None:
        super().__init__(cost=np.ones(1))
        self.home, self.how = arm.home, how

    def compute_error(self, configuration: mink.Configuration) -> Vector:
        if np.array_equal(configuration.q, self.home):
            return np.zeros(1)
        if self.how == "raises":
            raise ZeroDivisionError
        return np.full(1, np.nan) if self.how == "nan" else np.zeros(3)

    def compute_jacobian(self, configuration: mink.Configuration) -> Matrix:
        return np.ones((1, configuration.nv))


class BrokenLimit(mink.Limit):
    """The same as a limit."""

    def __init__(self, arm: Arm, how: str) -> None:
        self.task = Broken(arm, how)

    def compute_qp_inequalities(
        self, configuration: mink.Configuration, dt: float
    ) -> mink.Constraint:
        return mink.Constraint(
            np.ones((1, configuration.nv)), 9.0 + self.task.compute_error(configuration)
        )


@pytest.mark.parametrize("how", ["raises", "nan", "shape"])
def test_a_broken_part_is_left_out_and_counted(how: str) -> None:
    arm = Arm(PANDA)
    T = arm.pose(arm.home)
    plain = StreamIk(dt=DT, objectives=(posture,)).build(arm)
    own = StreamIk(
        dt=DT,
        objectives=(posture, lambda arm: Broken(arm, how)),
        limits=(lambda arm: BrokenLimit(arm, how),),
    ).build(arm)
    for k in range(150):
        expected, found = plain.tick(circle(T, k)), own.tick(circle(T, k))
        np.testing.assert_allclose(found.q, expected.q, atol=1e-9)
    assert own.counts[Event.OBJECTIVE_LEFT_OUT] == own.counts[Event.LIMIT_LEFT_OUT] > 145


@pytest.mark.parametrize(
    "settings",
    [
        {"objectives": (mink.FrameTask("nobody", "body", 1.0, 1.0),)},
        {"objectives": (ElbowAside(0.5, cost=float("nan")),)},
        {"objectives": (42,)},
        {"limits": (Floor,)},
        {"limits": (BrokenLimit(Arm(PANDA), "raises"), "none")},
        {"demand": "tight"},
    ],
)
def test_what_is_no_part_is_refused_with_a_message(settings: dict[str, object]) -> None:
    with pytest.raises(Robo47Error):
        StreamIk(dt=DT, **settings).build(Arm(PANDA))  # type: ignore[arg-type]


def test_a_free_axis_is_not_turned_and_a_position_does_not_care_for_the_angle() -> None:
    arm = Arm(PANDA)
    T = arm.pose(arm.home)

    def spinning(k: int) -> SE3:
        return T @ SE3.from_rotation(SO3.exp(np.array([0.0, 0.0, 20.0 * DT * k])))

    free = StreamIk(dt=DT, demand=FreeAxis(), home_gain=0.0).build(arm)
    ticks = ran(free, 600, spinning)
    assert np.abs(ticks[-1].q - arm.home).max() < 1e-6
    assert max(tick.orientation_error for tick in ticks) < 1e-6
    assert free.counts[Event.TARGET_JUMPED] == 0
    turned = T @ SE3.from_rotation(SO3.exp(np.array([0.4, 0.0, 1.0])))
    end = ran(StreamIk(dt=DT, demand=FreeAxis()).build(arm), 1500, turned)[-1]
    axes = [pose.rotation().as_matrix()[:, 2] for pose in (arm.pose(end.q), turned)]
    np.testing.assert_allclose(axes[0], axes[1], atol=1e-4)
    away = SE3.from_translation(np.array([0.05, 0.1, 0.05])) @ turned
    end = ran(StreamIk(dt=DT, demand=POSITION).build(arm), 1500, away)[-1]
    np.testing.assert_allclose(arm.pose(end.q).translation(), away.translation(), atol=1e-4)
    end = ran(StreamIk(dt=DT, demand=Direction()).build(arm), 1500, away)[-1]
    pointed = arm.pose(end.q).rotation().as_matrix()[:, 2]
    np.testing.assert_allclose(pointed, axes[1], atol=1e-4)
    assert np.linalg.norm(arm.pose(end.q).translation() - away.translation()) > 0.05


def test_two_tools_are_followed_and_a_lost_target_holds_its_tool_still() -> None:
    arm = Arm(load_robot("panda_pair"))
    left, right = (arm.pose(arm.home, tool) for tool in (0, 1))
    stream = StreamIk(dt=DT).build(arm)
    ticks = ran(
        stream, 1500, lambda k: ToolPoses({"left": circle(left, k), "right": circle(right, -k)})
    )
    assert max(tick.position_error for tick in ticks[500:]) < 5e-5
    assert stream.counts[Event.TARGET_JUMPED] == 0
    stopped = arm.pose(ticks[-1].q, 1)
    ticks = ran(stream, 1500, {"left": left, "right": SE3(np.full(7, np.nan))})
    assert stream.counts[Event.TARGET_REFUSED] == 1500
    q = ticks[-1].q
    np.testing.assert_allclose(arm.pose(q, 0).wxyz_xyz, left.wxyz_xyz, atol=1e-4)
    drift = np.linalg.norm(arm.pose(q, 1).translation() - stopped.translation())
    assert drift < 0.02
    # One arm alone is followed as if the other were not there.
    both, one = (StreamIk(dt=DT).build(arm) for _ in range(2))
    far = tool_down([0.5, -0.3, 0.5])
    near = ran(both, 200, lambda k: {"left": circle(left, k), "right": far})
    alone = ran(one, 200, lambda k: {"left": circle(left, k)})
    np.testing.assert_allclose(near[-1].q[:7], alone[-1].q[:7], atol=1e-6)


def test_two_arms_on_hostile_targets_keep_every_limit_and_clearance() -> None:
    arm = Arm(load_robot("panda_pair"), obstacles=PAIR_OBSTACLES)
    solver = StreamIk(dt=DT, clearance=0.02, profile=arm.robot.rated).build(arm)
    pairs = pair_targets(arm, np.random.default_rng(3))
    ticks = ran(solver, 700, lambda _: next(pairs))
    kept(solver, arm.home, ticks)
    q = np.array([tick.q for tick in ticks])
    found = clearance_audit(arm.robot, arm.obstacles, q, 0.02)
    assert found["clearance_violations"] == 0


def test_hostile_targets_with_a_users_parts_raise_nothing_and_break_nothing() -> None:
    arm = Arm(PANDA, obstacles=PAIR_OBSTACLES)
    solver = StreamIk(
        dt=DT,
        clearance=0.02,
        profile=PANDA.rated,
        demand=FreeAxis(),
        objectives=(posture, Objective(ElbowAside(0.1), priority=2)),
        limits=(Floor(0.25),),
    ).build(arm)
    hostile = targets(arm, np.random.default_rng(5))
    ticks = ran(solver, 700, lambda _: next(hostile))
    kept(solver, arm.home, ticks)
    q = np.array([tick.q for tick in ticks])
    assert clearance_audit(PANDA, arm.obstacles, q, 0.02)["clearance_violations"] == 0
    assert min(arm.pose(now).translation()[2] for now in q[::10]) > 0.25 - 1e-3


def test_a_tool_that_is_asked_for_again_starts_from_where_it_is_asked_to_be() -> None:
    arm = Arm(load_robot("panda_pair"))
    left, right = (arm.pose(arm.home, tool) for tool in (0, 1))
    stream = StreamIk(dt=DT).build(arm)
    stream.tick(ToolPoses({"left": left, "right": right}))
    stream.tick(ToolPoses({"right": right}))
    away = left @ SE3.from_translation(np.array([0.0, 0.0, -0.1]))
    assert stream.tick(ToolPoses({"left": away, "right": right})).events == ()
