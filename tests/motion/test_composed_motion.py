"""Demands, objectives, constraints and frozen joints along lines, arcs and to PTP goals."""

import itertools
from dataclasses import replace
from typing import Any

import mink
import numpy as np
import pytest
from mink import SE3

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import InvalidValueError, PlanError
from robo47_qp.ik.gauss_newton import Stall
from robo47_qp.ik.mink import MinkIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.objectives import Objective
from robo47_qp.ik.tool_demand import FULL, POSITION, Direction, FreeAxis
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.planner import Leg, Planner
from robo47_qp.motion.waypoint import Motion, Waypoint, tool_down
from robo47_qp.stack import ClassicalStack
from tests.composed import tasks
from tests.examples import turned

ARM = Arm(PANDA)
DT = 1e-3
START = tool_down([0.5, -0.2, 0.3])
GOAL = tool_down([0.5, 0.2, 0.3])
OFF = 6e-6
"""What Tracking allows beside a path [m] and [rad]."""


def planner(**composition: Any) -> Planner:
    solver = MinkIk(max_iterations=30, stall=Stall(), **composition)
    return Planner(ik=MultiStart(solver=solver), profile=PANDA.profile)


def planned(plan: Planner, waypoint: Waypoint, start: SE3 = START) -> Leg:
    q = plan.ik.solve(ARM, start, ARM.home)
    assert q.converged, q.explanation
    return plan.plan(ARM, waypoint, q.q, DT)


def poses(leg: Leg) -> list[SE3]:
    rows = np.linspace(0, leg.trajectory.steps, 61).round().astype(int)
    return [ARM.pose(q) for q in leg.trajectory.q[rows]]


def off_line(leg: Leg, start: SE3 = START, goal: SE3 = GOAL) -> float:
    a, b = start.translation(), goal.translation()
    u = (b - a) / np.linalg.norm(b - a)
    away = np.array([pose.translation() - a for pose in poses(leg)])
    return float(np.linalg.norm(away - np.outer(away @ u, u), axis=1).max())


def turning(leg: Leg) -> float:
    """How far the tool turns in all [rad]."""
    all_poses = poses(leg)
    return sum(
        float(np.linalg.norm((a.rotation().inverse() @ b.rotation()).log()))
        for a, b in itertools.pairwise(all_poses)
    )


def tilt(leg: Leg, axis: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> float:
    """Largest angle of the tool's z axis to straight down [rad]."""
    axes = np.array([pose.rotation().as_matrix() @ axis for pose in poses(leg)])
    return float(np.arcsin(np.linalg.norm(axes[:, :2], axis=1)).max())


def line(goal: SE3 = GOAL, **more: Any) -> Waypoint:
    return Waypoint(name="line", target=goal, motion=Motion.LIN, **more)


def test_along_a_line_a_free_axis_is_free_and_nothing_else() -> None:
    goal = turned(GOAL, 2, 2.5)
    leg = planned(planner(), line(goal, demand=FreeAxis()))
    assert off_line(leg) < OFF
    assert tilt(leg) < OFF
    assert np.linalg.norm(poses(leg)[-1].translation() - GOAL.translation()) < OFF
    # The whole pose takes the turn of 2.5 rad, which is not asked for.
    assert turning(leg) < 1.0
    assert leg.ik.converged
    whole = planned(planner(), line(turned(GOAL, 2, 0.7)))
    assert turning(whole) > 0.69
    # A turn that cannot be made is none that is needed.
    with pytest.raises(PlanError):
        planned(planner(), line(goal))


def test_a_line_by_position_alone_goes_where_no_orientation_could() -> None:
    far = tool_down([0.62, 0.35, 0.75])
    with pytest.raises(PlanError):
        planned(planner(), line(far))
    leg = planned(planner(), line(far, demand=POSITION))
    assert off_line(leg, START, far) < OFF
    assert np.linalg.norm(poses(leg)[-1].translation() - far.translation()) < OFF


def test_pointing_turns_the_tool_where_it_stands_or_moves_it() -> None:
    down = planned(planner(), line(turned(START, 0, 0.5), demand=Direction()))
    axis = poses(down)[-1].rotation().as_matrix()[:, 2]
    assert axis == pytest.approx(turned(START, 0, 0.5).rotation().as_matrix()[:, 2], abs=1e-5)


def test_an_arc_with_a_free_axis() -> None:
    way = Waypoint(
        name="arc",
        target=turned(GOAL, 2, 2.5),
        motion=Motion.CIRC,
        through=np.array([0.6, 0.0, 0.3]),
        demand=FreeAxis(),
    )
    leg = planned(planner(), way)
    assert tilt(leg) < OFF
    heights = np.array([pose.translation()[2] for pose in poses(leg)])
    assert np.abs(heights - 0.3).max() < OFF
    assert leg.path is not None
    assert leg.path.distances(np.array([pose.translation() for pose in poses(leg)])).max() < OFF


def test_a_demand_of_a_ptp_waypoint_is_all_that_is_asked_for() -> None:
    upside = turned(tool_down([0.45, 0.0, 0.12]), 2, 1.0)
    leg = planned(planner(), Waypoint(name="there", target=upside, demand=FreeAxis()))
    assert leg.ik.converged
    assert (
        tilt(
            replace(leg, trajectory=leg.trajectory.part(leg.trajectory.steps, leg.trajectory.steps))
        )
        < 2e-6
    )


@pytest.mark.parametrize(
    ("name", "motion"), [*((name, Motion.LIN) for name in tasks()), ("look at", Motion.CIRC)]
)
def test_each_task_of_mink_runs_along_a_path(name: str, motion: Motion) -> None:
    way = Waypoint(
        name="way",
        target=tool_down([0.5, -0.14, 0.3]),
        motion=motion,
        objectives=[Objective(tasks()[name], 1)],
        through=np.array([0.51, -0.17, 0.3]) if motion is Motion.CIRC else None,
    )
    leg = planned(planner(), way)
    assert leg.ik.converged
    assert leg.path is not None
    away = np.array([pose.translation() for pose in poses(leg)])
    assert leg.path.distances(away).max() < OFF
    assert tilt(leg) < OFF


def test_a_lasting_objective_is_better_all_along_the_line() -> None:
    posture = mink.PostureTask(ARM.model, cost=1.0)
    q = planner().ik.solve(ARM, START, ARM.home).q
    # The elbow out, as far as a null space of one dimension allows.
    wanted = q + 0.5 * np.linalg.svd(ARM.jacobian(q))[2][-1]
    posture.set_target(wanted)
    asked = planner(objectives=[posture])
    start = asked.ik.solve(ARM, START, ARM.home).q
    plain, leg = (plan.plan(ARM, line(), start, DT) for plan in (planner(), asked))

    def value(one: Leg) -> float:
        return float(np.mean(np.sum((one.trajectory.q - wanted) ** 2, axis=1)))

    assert off_line(leg) < OFF
    assert value(leg) < value(plain)
    # It is at its best at every knot: no self-motion makes it better.
    for q in leg.trajectory.q[:: leg.trajectory.steps // 5]:
        free = np.linalg.svd(ARM.jacobian(q))[2][-1]
        assert abs(free @ (q - wanted)) < 1e-3


def test_a_frozen_joint_stands_still_on_lines_and_ptp() -> None:
    plan = planner(frozen=["joint3"])
    q = planner().ik.solve(ARM, START, ARM.home).q
    for waypoint in (line(), Waypoint(name="ptp", target=GOAL)):
        leg = plan.plan(ARM, waypoint, q, DT)
        assert np.abs(leg.trajectory.q[:, 2] - q[2]).max() < 1e-9
        assert leg.ik.converged


class Coupled(mink.Task):
    """The third joint turns by half of what the first does."""

    def __init__(self, q: Vector) -> None:
        super().__init__(np.ones(1))
        self.row = np.array([[-0.5, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]])
        self.at = self.row @ q

    def compute_error(self, configuration: mink.Configuration) -> Vector:
        error: Vector = self.row @ configuration.q - self.at
        return error

    def compute_jacobian(self, configuration: mink.Configuration) -> Matrix:
        return self.row


def test_a_constraint_holds_all_along_the_line() -> None:
    q = planner().ik.solve(ARM, START, ARM.home).q
    held, short = Coupled(q), tool_down([0.5, -0.1, 0.3])
    leg = planner(constraints=[held]).plan(ARM, line(short), q, DT)
    assert np.abs(leg.trajectory.q @ held.row.T - held.at).max() < 1e-5
    assert off_line(leg, START, short) < OFF
    plain = planner().plan(ARM, line(short), q, DT)
    assert np.abs(plain.trajectory.q @ held.row.T - held.at).max() > 1e-3


def test_a_chain_takes_each_waypoint_as_it_asks() -> None:
    chain = [
        Waypoint(name="over", target=START),
        line(turned(GOAL, 2, 2.5), demand=FreeAxis()),
        Waypoint(name="back", target=tool_down([0.4, 0.0, 0.4])),
    ]
    legs = planner().plan_chain(ARM, chain, ARM.home, DT)
    assert tilt(legs[1]) < OFF
    assert off_line(legs[1]) < OFF
    assert max(ARM.pose_distance(tool_down([0.4, 0.0, 0.4]), legs[2].trajectory.end.q)) < 1e-5


def test_lines_that_are_blended_must_ask_for_the_same() -> None:
    chain = [
        Waypoint(name="over", target=START),
        line(GOAL, blend=0.02, demand=FreeAxis()),
        Waypoint(name="on", target=tool_down([0.4, 0.2, 0.3]), motion=Motion.LIN),
    ]
    with pytest.raises(PlanError, match="'on' cannot be planned: without a stop before it"):
        planner().plan_chain(ARM, chain, ARM.home, DT)
    chain[2] = replace(chain[2], demand=FreeAxis())
    legs = planner().plan_chain(ARM, chain, ARM.home, DT)
    assert max(tilt(leg) for leg in legs[1:]) < OFF


@pytest.mark.parametrize("ik", ["qp", "lm", "dls"])
def test_solvers_that_do_not_compose_say_so(ik: str) -> None:
    plan = Planner(ik=ClassicalStack(ik=ik).solver(), profile=PANDA.profile)
    both: list[dict[str, Any]] = [{"demand": FreeAxis()}, {"objectives": [tasks()["com"]]}]
    for asked in both:
        waypoint = Waypoint(name="there", target=GOAL, **asked)
        with pytest.raises(InvalidValueError, match="left out with this solver; MinkIk takes them"):
            plan.plan(ARM, waypoint, ARM.home, DT)


def test_bad_demands_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="demand must be FULL, FreeAxis"):
        Waypoint(name="there", target=GOAL, demand="up")  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match="axis must be a vector with a length"):
        FreeAxis((0.0, 0.0, 0.0))
    assert Waypoint(name="there", target=GOAL, demand=FULL).demand == FULL
