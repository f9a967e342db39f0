from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError, PlanError, RefusalReason
from robo47_qp.evaluation.benchmarks.motion.motion_check import violations
from robo47_qp.evaluation.benchmarks.motion.reference_kinematics import ReferenceKinematics
from robo47_qp.evaluation.benchmarks.motion.refusal_check import RefusalCheck
from robo47_qp.ik.gauss_newton import Stall
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.solver import judged
from robo47_qp.model.arm import Arm
from robo47_qp.model.gripper import Grip
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.continuous import Continuous
from robo47_qp.motion.paths.segments import Line, PathProfile
from robo47_qp.motion.planner import Leg, Planner
from robo47_qp.motion.tool_motion import tool_rates
from robo47_qp.motion.waypoint import Motion, Waypoint, goal_pose
from tests.examples import shifted, turned
from tests.plain_arm import PlainArm

ARM, PLAIN, DT = Arm(PANDA), PlainArm(PANDA), 1e-3
IK = MultiStart(solver=LmIk(max_iterations=30, stall=Stall()))
PLANNER = Planner(ik=IK, profile=PANDA.profile)
START = ARM.pose(ARM.home)
LOOK = ReferenceKinematics(PANDA)
REFUSALS = RefusalCheck(LOOK)
TOOL = PathProfile()


def at(x: float, y: float, z: float, turn: float = 0.0) -> SE3:
    return turned(shifted(START, np.array([x, y, z])), 2, turn)


def three(motion: Motion, **how: object) -> list[Waypoint]:
    """A corner of 90 degrees, one that is not, and a turn."""
    places = [at(0.2, 0.0, 0.0), at(0.2, 0.2, -0.1, 0.5), at(0.1, 0.2, -0.25, 0.5)]
    names = ("first", "second", "goal")
    inner = [how, how, {}]
    return [
        Waypoint(name=name, target=place, motion=motion, **one)  # type: ignore[arg-type]
        for name, place, one in zip(names, places, inner, strict=True)
    ]


def whole(legs: list[Leg]) -> Vector:
    parts = [leg.trajectory.q for leg in legs]
    return np.vstack([parts[0], *(part[1:] for part in parts[1:])])


def tool(q: Vector) -> Vector:
    return np.array([PLAIN.tool(row)[0] for row in q])


def check_tool(q: Vector, profile: PathProfile, pace: float = 1.0) -> float:
    """The tool keeps its bounds; returns how much of them it uses."""
    p = np.vstack([np.repeat(q[:1], 3, axis=0), q, np.repeat(q[-1:], 3, axis=0)])
    p, used = tool(p), 0.0
    for order, bound in enumerate(profile.linear, start=1):
        rate = np.linalg.norm(np.diff(p, order, axis=0), axis=1) / DT**order
        assert rate.max() <= bound * pace**order * (1 + 1e-4), order
        used = max(used, rate.max() / (bound * pace**order))
    rates = tool_rates(ARM, q, DT)
    for order, (rate, bound) in enumerate(zip(rates, profile.angular, strict=True), start=1):
        assert rate[:, 1].max() <= bound * pace**order * (1 + 1e-4)
    return float(used)


def stops(legs: list[Leg]) -> int:
    """How often the arm is at rest between start and goal."""
    v = np.vstack([leg.trajectory.v for leg in legs])
    speed = np.abs(v).max(axis=1)[50:-50]
    return int((speed < 1e-3).sum())


@pytest.mark.parametrize("motion", [Motion.LIN, Motion.PTP])
@pytest.mark.parametrize("how", [{"blend": 0.03}, {"stop": False}], ids=["blend", "via"])
def test_waypoints_are_passed_without_a_stop_within_all_bounds(
    motion: Motion, how: dict[str, object]
) -> None:
    waypoints = three(motion, **how)
    legs = PLANNER.plan_chain(ARM, waypoints, ARM.home, DT)
    assert [leg.waypoint.name for leg in legs] == ["first", "second", "goal"]
    assert violations(LOOK, legs, PANDA.profile) == []
    assert stops(legs) == 0
    p = tool(whole(legs))
    for waypoint in waypoints[:-1]:
        assert isinstance(waypoint.target, SE3)
        nearest = np.linalg.norm(p - waypoint.target.translation(), axis=1).min()
        assert nearest < (0.03 if waypoint.blend else 1e-3 * TOOL.linear[0] * 2)
        assert (nearest > 1e-4) == bool(waypoint.blend)
    if motion is Motion.LIN:
        assert check_tool(whole(legs), TOOL) > 0.3
        # Joints save nothing on corners as sharp as these; the tool does.
        stopping = PLANNER.plan_chain(ARM, three(motion), ARM.home, DT)
        steps = [sum(leg.trajectory.steps for leg in way) for way in (legs, stopping)]
        assert steps[0] < steps[1]
    goal = waypoints[-1].target
    assert isinstance(goal, SE3)
    assert max(PLAIN.errors(legs[-1].trajectory.q[-1], goal)) < 2e-6
    for before, after in pairwise(legs):
        assert before.trajectory.q[-1].tolist() == after.trajectory.q[0].tolist()


def test_a_blended_line_keeps_to_its_lines_outside_the_radius() -> None:
    waypoints = three(Motion.LIN, blend=0.03)
    p = tool(whole(PLANNER.plan_chain(ARM, waypoints, ARM.home, DT)))
    poses = [START, *(w.target for w in waypoints if isinstance(w.target, SE3))]
    lines = [Line(a, b) for a, b in pairwise(poses)]
    off = np.min([line.distances(p) for line in lines], axis=0)
    corners = np.array([pose.translation() for pose in poses[1:-1]])
    far = np.linalg.norm(p[:, None] - corners, axis=2).min(axis=1) > 0.0301
    assert off[far].max() < 1e-5
    assert 1e-3 < off.max() < 0.015


def test_joints_and_tool_motions_are_blended_into_each_other() -> None:
    above, there, away = at(0.15, 0.1, -0.1), at(0.15, 0.1, -0.25), at(0.0, 0.3, -0.1)
    waypoints = [
        Waypoint(name="above", target=above, blend=0.03),
        Waypoint(name="there", target=there, motion=Motion.LIN, blend=0.03),
        Waypoint(name="away", target=away),
    ]
    resting = [replace(waypoint, blend=0.0) for waypoint in waypoints]
    legs = PLANNER.plan_chain(ARM, resting, ARM.home, DT)
    # The planner would rather stop, which is quicker here: the blend alone is looked at.
    goals = [leg.trajectory.q[-1] for leg in legs]
    requests = [
        waypoint.request(ARM, IK, 1.0, judged(ARM, goal_pose(ARM, waypoint), q, IK.tolerance, 0))
        for waypoint, q in zip(waypoints, goals, strict=True)
    ]
    blended = Continuous().plan(ARM, ARM.home, requests, PANDA.profile, DT).trajectory
    legs = [replace(legs[0], trajectory=blended)]
    assert violations(LOOK, legs, PANDA.profile) == []
    assert stops(legs) == 0
    p = tool(whole(legs))
    for pose in (above, there):
        assert np.linalg.norm(p - pose.translation(), axis=1).min() < 0.03
    line = Line(above, there)
    middle = 0.5 * (above.translation() + there.translation())
    near = np.linalg.norm(p - middle, axis=1) < 0.04
    assert near.sum() > 20
    assert line.distances(p[near]).max() < 1e-5


@pytest.mark.parametrize("point", ["through", "centre"])
@pytest.mark.parametrize("pace", [1.0, 0.5])
def test_an_arc_is_kept_and_all_bounds_with_it(point: str, pace: float) -> None:
    centre = START.translation() + np.array([0.0, 0.1, 0.0])
    through = centre + 0.1 * np.array([np.sin(0.7), -np.cos(0.7), 0.0])
    goal = turned(shifted(START, np.array([0.1, 0.1, 0.0])), 2, 0.4)
    where = {"through": through} if point == "through" else {"centre": centre}
    waypoint = Waypoint(name="arc", target=goal, motion=Motion.CIRC, pace=pace, **where)
    leg = PLANNER.plan(ARM, waypoint, ARM.home, DT)
    p = tool(leg.trajectory.q)
    off = p - centre
    assert np.abs(np.linalg.norm(off, axis=1) - 0.1).max() < 1e-5
    assert np.abs(off[:, 2]).max() < 1e-5
    assert max(PLAIN.errors(leg.trajectory.q[-1], goal)) < 2e-6
    assert violations(LOOK, [leg], PANDA.profile.slowed(pace)) == []
    check_tool(leg.trajectory.q, TOOL, pace)
    assert leg.path is not None
    assert leg.path.distances(p).max() < 1e-5
    assert 1.0 <= leg.trajectory.duration / leg.lower_bound < 2.5


def test_where_joints_are_fast_the_tools_bounds_set_the_pace() -> None:
    """Centripetal acceleration counts: a small circle is gone round slowly."""
    quick = replace(PLANNER, continuous=Continuous(profile=PathProfile(linear=(0.5, 0.4, 50.0))))
    goal = shifted(START, np.array([0.0, 0.1, 0.0]))
    through = START.translation() + np.array([0.05, 0.05, 0.0])
    waypoint = Waypoint(name="arc", target=goal, motion=Motion.CIRC, through=through)
    leg = replace(quick, profile=PANDA.rated).plan(ARM, waypoint, ARM.home, DT)
    check_tool(leg.trajectory.q, quick.continuous.profile)
    speed = np.linalg.norm(np.diff(tool(leg.trajectory.q), axis=0), axis=1).max() / DT
    # v² / r <= a holds v below 0.141 m/s.
    assert 0.08 < speed <= np.sqrt(0.4 * 0.05) * 1.001


def test_the_tool_may_be_bounded_in_ptp_motions_too() -> None:
    bound = PathProfile(linear=(0.25, 1.0, 20.0), angular=(1.0, 5.0, 50.0))
    held = replace(PLANNER, continuous=Continuous(free=bound))
    waypoint = Waypoint(name="there", target=at(0.2, 0.3, -0.2))
    free = PLANNER.plan(ARM, waypoint, ARM.home, DT)
    leg = held.plan(ARM, waypoint, ARM.home, DT)
    with pytest.raises(AssertionError):
        check_tool(free.trajectory.q, bound)
    check_tool(leg.trajectory.q, bound)
    assert leg.trajectory.q[-1] == pytest.approx(free.trajectory.q[-1], abs=1e-12)
    assert violations(LOOK, [leg], PANDA.profile) == []


def refusal(waypoints: list[Waypoint], q: Vector = ARM.home) -> PlanError:
    with pytest.raises(PlanError) as caught:
        PLANNER.plan_chain(ARM, waypoints, q, DT)
    return caught.value


def test_shapes_that_are_none_are_refused() -> None:
    big = refusal(three(Motion.LIN, blend=0.13))
    assert big.waypoint == "second"
    assert "the blends at its ends would take" in big.explanation
    assert big.rejection is not None
    assert big.rejection.reason is RefusalReason.SHAPE
    mixed = three(Motion.LIN, blend=0.02)
    mixed[1] = replace(mixed[1], blend=0.0, stop=False)
    assert "do not go together" in str(refusal(mixed))
    meeting = three(Motion.LIN, stop=False)
    meeting[0] = replace(meeting[0], motion=Motion.PTP)
    assert "give a blend" in str(refusal(meeting))
    assert "it is the last" in str(refusal(three(Motion.LIN, stop=False)[:2]))
    twice = [three(Motion.LIN, blend=0.02)[0]] * 2
    assert "already is" in str(refusal([*twice, three(Motion.LIN)[2]]))
    straight = Waypoint(
        name="arc",
        target=at(0.2, 0.0, 0.0),
        motion=Motion.CIRC,
        through=START.translation() + np.array([0.1, 0.0, 0.0]),
    )
    assert "off the line" in str(refusal([straight]))


def test_alone_no_waypoint_can_be_passed() -> None:
    with pytest.raises(PlanError, match="nothing is known to follow"):
        PLANNER.plan(ARM, three(Motion.LIN, blend=0.02)[0], ARM.home, DT)


def test_a_refusal_names_segment_joint_and_time() -> None:
    q = ARM.home.copy()
    q[-1] = ARM.q_max[-1] - 0.5
    first = Waypoint(
        name="first",
        target=shifted(ARM.pose(q), np.array([0.1, 0.0, 0.0])),
        motion=Motion.LIN,
        blend=0.02,
    )
    target = turned(shifted(ARM.pose(q), np.array([0.1, 0.1, 0.0])), 2, 2.0)
    waypoints = [first, Waypoint(name="second", target=target, motion=Motion.LIN)]
    error = refusal(waypoints, q)
    found = error.rejection
    assert found is not None
    assert error.waypoint == "second"
    assert (found.reason, found.joint) == (RefusalReason.JOINT_LIMIT, "joint7")
    assert found.time is not None
    assert found.time > 0.1
    assert REFUSALS.doubt(q, waypoints, error) is None


def test_the_second_check_sees_through_a_wrong_reason() -> None:
    q = ARM.home.copy()
    q[-1] = ARM.q_max[-1] - 0.5
    goal = turned(ARM.pose(q), 2, 2.0)
    waypoints = [Waypoint(name="goal", target=goal, motion=Motion.LIN)]
    error = refusal(waypoints, q)
    found = error.rejection
    assert found is not None
    for wrong in (
        replace(found, joint="joint1"),
        replace(found, reason=RefusalReason.SINGULARITY),
        replace(found, reason=RefusalReason.PACE),
        replace(found, reason=RefusalReason.REACH, pose=tuple(ARM.pose(ARM.home).wxyz_xyz)),
        replace(found, reason=RefusalReason.SHAPE),
        replace(found, q=None),
    ):
        assert REFUSALS.doubt(q, waypoints, PlanError("goal", "no", wrong)) is not None
    far = [Waypoint(name="goal", target=at(3.0, 0.0, 0.0))]
    assert REFUSALS.doubt(q, far, PlanError("goal", "not reached")) is None
    reached = [Waypoint(name="goal", target=START)]
    assert REFUSALS.doubt(q, reached, PlanError("goal", "not reached")) is not None


def test_the_check_of_motions_sees_what_is_broken() -> None:
    leg = PLANNER.plan(ARM, Waypoint(name="there", target=at(0.1, 0.2, -0.2)), ARM.home, DT)
    assert violations(LOOK, [leg], PANDA.profile) == []
    slower = PANDA.profile.slowed(0.98)
    assert len(violations(LOOK, [leg], slower)) >= 4
    motion = leg.trajectory
    for field, size in (("q", 1e-4), ("v", 1e-2), ("a", 0.3)):
        bad = getattr(motion, field).copy()
        bad[len(bad) // 2, 3] += size
        assert violations(
            LOOK, [replace(leg, trajectory=replace(motion, **{field: bad}))], PANDA.profile
        )
    half = replace(leg, trajectory=motion.part(0, motion.steps // 2))
    assert "rest" in " ".join(violations(LOOK, [half], PANDA.profile))


def test_what_shapes_a_way_is_checked() -> None:
    point = np.array([0.1, 0.2, 0.3])
    for wrong, message in (
        ({"motion": Motion.CIRC}, "CIRC with neither through nor centre"),
        ({"motion": Motion.LIN, "through": point}, r"LIN with \['through'\]"),
        ({"motion": Motion.CIRC, "through": point, "centre": point}, "CIRC with one of"),
        ({"motion": Motion.CIRC, "through": point[:2]}, "through of waypoint"),
        ({"blend": -0.1}, "blend of waypoint 'w' must be 0 or more and finite"),
        ({"blend": np.nan}, "blend of waypoint"),
        ({"stop": False, "blend": 0.1}, "not to be stopped at"),
        ({"motion": Motion.CIRC, "centre": point, "stop": False}, "not to be stopped at"),
        ({"blend": 0.1, "grip": Grip(width=0.0, force=1.0)}, "grip at waypoint 'w'"),
    ):
        with pytest.raises(InvalidValueError, match=message):
            Waypoint(name="w", target=START, **wrong)
