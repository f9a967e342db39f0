"""Streams with constraints and frozen joints: kept, relaxed in order, never infeasible."""

import mink
import numpy as np
import pytest

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import Robo47Error
from robo47_qp.evaluation.benchmarks.ik.hostile_targets import PAIR_OBSTACLES, pair_targets, targets
from robo47_qp.evaluation.benchmarks.ik.stream_audit import clearance_audit
from robo47_qp.ik.mended import RelativeFrameTask
from robo47_qp.ik.objectives import Objective
from robo47_qp.ik.stream.settings import Event
from robo47_qp.ik.stream.stream import StreamIk
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots import load_robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.waypoint import tool_down
from tests.ik.stream.test_composition import (
    DT,
    Broken,
    ElbowAside,
    Floor,
    circle,
    kept,
    posture,
    ran,
)


class Coupled(mink.Task):
    """Joint 5 turns against joint 3, and so much further."""

    def __init__(self, offset: float = 0.0) -> None:
        super().__init__(cost=np.ones(1))
        self.offset = offset

    def compute_error(self, configuration: mink.Configuration) -> Vector:
        return np.array([configuration.q[4] + configuration.q[2] - self.offset])

    def compute_jacobian(self, configuration: mink.Configuration) -> Matrix:
        return np.array([[0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0]])


def grip(arm: Arm) -> mink.Task:
    """Return a closed chain: both hands hold one stiff thing, as they do at home."""
    task = RelativeFrameTask("right_tcp", "site", "left_tcp", "site", 1.0, 1.0)
    task.set_target(arm.pose(arm.home, 0).inverse() @ arm.pose(arm.home, 1))
    return task


@pytest.mark.parametrize("clearance", [None, 0.01])
def test_a_constraint_that_holds_goes_on_holding_while_the_tool_moves(
    clearance: float | None,
) -> None:
    arm = Arm(PANDA)
    T = arm.pose(arm.home)
    solver = StreamIk(dt=DT, clearance=clearance, constraints=(Coupled(),)).build(arm)
    ticks = ran(solver, 1500, lambda k: circle(T, k))
    kept(solver, arm.home, ticks)
    assert max(abs(tick.q[4] + tick.q[2]) for tick in ticks) < 1e-9
    assert max(tick.position_error for tick in ticks[600:]) < 2e-4
    free = ran(StreamIk(dt=DT).build(arm), 1500, lambda k: circle(T, k))
    assert max(abs(tick.q[4] + tick.q[2]) for tick in free) > 0.01
    assert sum(solver.counts.values()) == 0


def test_a_constraint_that_does_not_hold_is_brought_about_within_the_limits() -> None:
    arm = Arm(PANDA)
    T = arm.pose(arm.home)
    solver = StreamIk(dt=DT, constraints=(Coupled(0.3),), objectives=(posture,)).build(arm)
    ticks = ran(solver, 1500, T)
    kept(solver, arm.home, ticks)
    assert ticks[-1].q[4] + ticks[-1].q[2] == pytest.approx(0.3, abs=1e-6)
    assert ticks[-1].position_error < 1e-4


def test_the_tool_gives_way_before_a_constraint_does() -> None:
    """One joint is asked to be where the tool cannot have it."""
    arm = Arm(PANDA)

    class Elbow(mink.Task):
        def compute_error(self, configuration: mink.Configuration) -> Vector:
            return np.array([configuration.q[3] - arm.home[3] + 0.3])

        def compute_jacobian(self, configuration: mink.Configuration) -> Matrix:
            return np.eye(7)[3:4]

    solver = StreamIk(dt=DT, constraints=(Elbow(cost=np.ones(1)),)).build(arm)
    end = ran(solver, 1500, arm.pose(arm.home))[-1]
    assert end.q[3] == pytest.approx(arm.home[3] - 0.3, abs=1e-6)
    assert end.position_error > 0.01
    assert solver.counts[Event.CONSTRAINT_RELAXED] == 0


def test_limits_give_way_before_constraints_and_constraints_before_clearances() -> None:
    arm = Arm(PANDA, obstacles=PAIR_OBSTACLES[:1])
    T = arm.pose(arm.home)
    height = float(T.translation()[2])

    class Height(mink.Task):
        """The tool at a height."""

        def __init__(self, z: float) -> None:
            super().__init__(cost=np.ones(1))
            self.z = z

        def compute_error(self, configuration: mink.Configuration) -> Vector:
            return arm.pose(configuration.q).translation()[2:] - self.z

        def compute_jacobian(self, configuration: mink.Configuration) -> Matrix:
            pose = arm.pose(configuration.q).rotation().as_matrix()
            return (pose @ arm.jacobian(configuration.q)[:3])[2:]

    # A limit that keeps the tool up against a constraint that holds it down.
    down = Height(height - 0.1)
    solver = StreamIk(dt=DT, constraints=(down,), limits=(Floor(height),)).build(arm)
    end = ran(solver, 900, T)[-1]
    assert Event.LIMIT_RELAXED in end.events
    assert Event.CONSTRAINT_RELAXED not in end.events
    assert arm.pose(end.q).translation()[2] == pytest.approx(height - 0.1, abs=2e-3)
    # The same where constraints give way, too, for a reason of their own.
    fighting = down, Coupled(0.1), Coupled(-0.1)
    solver = StreamIk(dt=DT, constraints=fighting, limits=(Floor(height),)).build(arm)
    end = ran(solver, 900, T)[-1]
    assert {Event.LIMIT_RELAXED, Event.CONSTRAINT_RELAXED} <= {*end.events}
    assert arm.pose(end.q).translation()[2] < height - 0.09
    # A constraint that wants the tool in the table.
    inside = mink.FrameTask("tcp", "site", 1.0, 0.0)
    inside.set_target(tool_down([0.5, 0.0, -0.03]))
    solver = StreamIk(dt=DT, clearance=0.01, constraints=(inside,)).build(arm)
    ticks = ran(solver, 1500, tool_down([0.5, 0.1, 0.3]))
    kept(solver, arm.home, ticks)
    assert Event.CONSTRAINT_RELAXED in ticks[-1].events
    assert solver.counts[Event.CLEARANCE_RELAXED] == solver.counts[Event.NO_ANSWER] == 0
    q = np.array([tick.q for tick in ticks])
    assert clearance_audit(PANDA, arm.obstacles, q, 0.01)["clearance_violations"] == 0


def test_constraints_against_each_other_are_a_counted_compromise() -> None:
    arm = Arm(PANDA)
    solver = StreamIk(dt=DT, constraints=(Coupled(0.2), Coupled(-0.2))).build(arm)
    ticks = ran(solver, 600, arm.pose(arm.home))
    kept(solver, arm.home, ticks)
    assert solver.counts[Event.CONSTRAINT_RELAXED] > 500
    assert solver.counts[Event.NO_ANSWER] == 0
    assert ticks[-1].q[4] + ticks[-1].q[2] == pytest.approx(0.0, abs=1e-3)
    agreeing = StreamIk(dt=DT, constraints=(Coupled(0.2), Coupled(0.2))).build(arm)
    end = ran(agreeing, 600, arm.pose(arm.home))[-1]
    assert end.q[4] + end.q[2] == pytest.approx(0.2, abs=1e-6)
    assert agreeing.counts[Event.CONSTRAINT_RELAXED] == 0


def test_objectives_move_only_what_constraints_leave_free() -> None:
    arm = Arm(PANDA)
    T = arm.pose(arm.home)
    own = Objective(ElbowAside(0.1), priority=1), Objective(posture, priority=2)
    solver = StreamIk(dt=DT, constraints=(Coupled(),), objectives=own).build(arm)
    ticks = ran(solver, 900, T)
    assert max(abs(tick.q[4] + tick.q[2]) for tick in ticks) < 1e-9


def test_two_hands_of_a_closed_chain_hold_what_they_hold() -> None:
    arm = Arm(load_robot("panda_pair"))
    T = arm.pose(arm.home, 0)
    solver = StreamIk(dt=DT, constraints=(grip,)).build(arm)
    ticks = ran(solver, 1200, lambda k: {"left": circle(T, k)})
    kept(solver, arm.home, ticks)
    held = arm.pose(arm.home, 0).inverse() @ arm.pose(arm.home, 1)
    for tick in ticks[::40]:
        now = arm.pose(tick.q, 0).inverse() @ arm.pose(tick.q, 1)
        assert np.abs((held.inverse() @ now).log()).max() < 2e-5
    assert (
        np.linalg.norm(arm.pose(ticks[-1].q, 1).translation() - arm.pose(arm.home, 1).translation())
        > 0.05
    )
    assert max(tick.position_error for tick in ticks[500:]) < 3e-4
    assert solver.counts[Event.CONSTRAINT_RELAXED] == 0


@pytest.mark.parametrize("how", ["raises", "nan", "shape"])
def test_a_broken_constraint_is_left_out_and_counted(how: str) -> None:
    arm = Arm(PANDA)
    T = arm.pose(arm.home)
    plain = StreamIk(dt=DT, constraints=(Coupled(),)).build(arm)
    broken = StreamIk(dt=DT, constraints=(Coupled(), lambda arm: Broken(arm, how))).build(arm)
    for k in range(60):
        expected, found = plain.tick(circle(T, k)), broken.tick(circle(T, k))
        if k > 0:
            np.testing.assert_allclose(found.q, expected.q, atol=1e-5)
    assert broken.counts[Event.CONSTRAINT_LEFT_OUT] > 55


def test_frozen_joints_stand_still_and_the_others_do_their_work() -> None:
    arm = Arm(PANDA)
    T = arm.pose(arm.home)
    solver = StreamIk(dt=DT, frozen=("joint3",), objectives=(posture,)).build(arm)
    ticks = ran(solver, 1000, lambda k: circle(T, k))
    kept(solver, arm.home, ticks)
    assert max(abs(tick.q[2] - arm.home[2]) for tick in ticks) == 0.0
    assert max(tick.position_error for tick in ticks[500:]) < 3e-4
    v = np.zeros(7)
    v[2] = 0.5
    solver.reset(arm.home, v)
    ticks = ran(solver, 300, T)
    assert abs(ticks[-1].v[2]) == 0.0
    assert max(abs(tick.a[2]) for tick in ticks) <= PANDA.profile.a_max[2]

    class Aside(mink.Limit):
        """The frozen joint elsewhere."""

        def compute_qp_inequalities(
            self, configuration: mink.Configuration, dt: float
        ) -> mink.Constraint:
            return mink.Constraint(-np.eye(7)[2:3], np.array([configuration.q[2] - 0.5]))

    pushed = StreamIk(dt=DT, frozen=("joint3",), limits=(Aside(),)).build(arm)
    ticks = ran(pushed, 100, T)
    assert max(abs(tick.q[2] - arm.home[2]) for tick in ticks) == 0.0
    assert pushed.counts[Event.LIMIT_RELAXED] == 100


@pytest.mark.parametrize(
    "settings",
    [
        {"constraints": (42,)},
        {"constraints": (mink.FrameTask("nobody", "body", 1.0, 1.0),)},
        {"constraints": (lambda arm: mink.DampingTask(arm.model, 1.0), "none")},
        {"frozen": ("joint9",)},
    ],
)
def test_what_is_no_constraint_is_refused_with_a_message(settings: dict[str, object]) -> None:
    with pytest.raises(Robo47Error):
        StreamIk(dt=DT, **settings).build(Arm(PANDA))  # type: ignore[arg-type]


@pytest.mark.parametrize("robot", ["panda", "panda_pair"])
def test_hostile_targets_with_constraints_raise_nothing_and_break_nothing(robot: str) -> None:
    one = robot == "panda"
    arm = Arm(load_robot(robot), obstacles=PAIR_OBSTACLES)
    solver = StreamIk(
        dt=DT,
        clearance=0.02,
        profile=arm.robot.rated,
        constraints=(Coupled(),) if one else (grip,),
        frozen=("joint1",) if one else (),
        limits=(Floor(0.25),) if one else (),
    ).build(arm)
    rng = np.random.default_rng(5)
    hostile = targets(arm, rng) if one else pair_targets(arm, rng)
    ticks = ran(solver, 500, lambda _: next(hostile))
    kept(solver, arm.home, ticks)
    q = np.array([tick.q for tick in ticks])
    assert clearance_audit(arm.robot, arm.obstacles, q, 0.02)["clearance_violations"] == 0
    assert solver.counts[Event.NO_ANSWER] == 0
    if one:
        assert np.abs(q[:, 0] - arm.home[0]).max() == 0.0
