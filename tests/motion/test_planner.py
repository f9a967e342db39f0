from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from mink import SE3, SO3

from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError, PlanError
from robo47_qp.ik.dls import DlsIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.qp import QpIk
from robo47_qp.ik.solver import IkSolver
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import MotionProfile, Robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.following.lin import Lin
from robo47_qp.motion.paths.segments import PathProfile
from robo47_qp.motion.planner import Leg, Planner
from robo47_qp.motion.waypoint import Motion, Place, Waypoint, tool_down
from tests.examples import inner_fractions, shifted, turned
from tests.motion.test_lin import check_joints, off_line
from tests.plain_arm import PlainArm

DT = 1e-3
FAR = SE3.from_rotation_and_translation(SO3.identity(), np.array([3.0, 0.0, 0.5]))


def planner(robot: Robot, pace: float = 1.0, ik: IkSolver | None = None) -> Planner:
    solver = MultiStart(solver=QpIk()) if ik is None else ik
    return Planner(ik=solver, profile=robot.profile, pace=pace)


def ahead(arm: Arm, motion: Motion, **changed: object) -> Waypoint:
    target = shifted(arm.pose(arm.home), np.array([0.1, 0.1, -0.2]))
    return replace(Waypoint(name="ahead", target=target, motion=motion), **changed)  # type: ignore[arg-type]


EVERY_MOTION = pytest.mark.parametrize("motion", [Motion.PTP, Motion.LIN])


@EVERY_MOTION
def test_a_leg_leads_from_the_start_to_the_waypoint_at_rest(
    robot: Robot, arm: Arm, plain: PlainArm, motion: Motion
) -> None:
    q_start = arm.home + 0.1
    waypoint = ahead(arm, motion)
    leg = planner(robot).plan(arm, waypoint, q_start, DT)
    assert isinstance(waypoint.target, SE3)
    assert leg.waypoint is waypoint
    assert leg.trajectory.dt == DT
    assert leg.trajectory.q[0] == pytest.approx(q_start, abs=1e-9)
    assert max(plain.errors(leg.trajectory.q[-1], waypoint.target)) < 1.1e-6
    for rest in (leg.trajectory.v, leg.trajectory.a):
        assert rest[[0, -1]] == pytest.approx(np.zeros((2, arm.n)), abs=1e-9)
    assert leg.ik.converged
    assert leg.ik.q.tolist() == leg.trajectory.q[-1].tolist()
    assert max(plain.errors(q_start, leg.T_world_start)) < 1e-9
    assert leg.T_world_goal.wxyz_xyz.tolist() == waypoint.target.wxyz_xyz.tolist()


@settings(max_examples=10)
@given(at=inner_fractions)
def test_the_answer_of_a_ptp_motion_does_not_depend_on_where_the_arm_comes_from(
    robot: Robot, arm: Arm, plain: PlainArm, at: Vector
) -> None:
    waypoint = ahead(arm, Motion.PTP)
    first = planner(robot).plan(arm, waypoint, arm.home, DT)
    other = planner(robot).plan(arm, waypoint, plain.at(at), DT)
    assert first.trajectory.q[-1].tolist() == other.trajectory.q[-1].tolist()
    assert np.abs(first.ik.q - arm.home).max() < 1.5


def test_a_ptp_motion_is_straight_in_joint_space_and_lin_in_the_world(
    robot: Robot, arm: Arm, plain: PlainArm
) -> None:
    target = shifted(arm.pose(arm.home), np.array([0.15, 0.3, -0.2]))
    ptp, lin = (
        planner(robot).plan(arm, ahead(arm, motion, target=target), arm.home, DT)
        for motion in (Motion.PTP, Motion.LIN)
    )
    way = ptp.trajectory.q[-1] - arm.home
    s = (ptp.trajectory.q - arm.home) @ way / (way @ way)
    assert np.abs(ptp.trajectory.q - arm.home - s[:, None] * way).max() < 1e-9
    start, goal = lin.T_world_start, lin.T_world_goal
    assert off_line(plain, lin.trajectory.q[::11], start, goal)[0] < 1e-5
    assert off_line(plain, ptp.trajectory.q[::11], start, goal)[0] > 1e-3


@EVERY_MOTION
def test_the_joints_keep_the_profile_at_every_pace(robot: Robot, arm: Arm, motion: Motion) -> None:
    for pace in (1.0, 0.4):
        leg = planner(robot, pace=pace).plan(arm, ahead(arm, motion), arm.home, DT)
        check_joints(leg.trajectory, robot.profile.slowed(pace))


@EVERY_MOTION
def test_the_pace_is_that_of_the_planner_times_that_of_the_waypoint(
    robot: Robot, arm: Arm, motion: Motion
) -> None:
    def duration(pace: float, own: float) -> float:
        waypoint = ahead(arm, motion, pace=own)
        return planner(robot, pace=pace).plan(arm, waypoint, arm.home, DT).trajectory.duration

    full = duration(1.0, 1.0)
    assert duration(0.5, 1.0) == pytest.approx(2 * full, abs=4 * DT)
    assert duration(1.0, 0.5) == pytest.approx(2 * full, abs=4 * DT)
    assert duration(0.5, 0.4) == pytest.approx(5 * full, abs=8 * DT)


def test_the_tool_slows_down_with_the_pace_also_where_no_joint_binds(
    robot: Robot, arm: Arm, plain: PlainArm
) -> None:
    quick = replace(planner(robot), profile=MotionProfile.uniform(arm.n, v=1e3, a=1e3, j=1e6))
    for planned, own in ((1.0, 1.0), (0.5, 1.0), (1.0, 0.5)):
        waypoint = ahead(arm, Motion.LIN, pace=own)
        leg = replace(quick, pace=planned).plan(arm, waypoint, arm.home, DT)
        path = np.array([plain.tool(q)[0] for q in leg.trajectory.q])
        fastest = np.linalg.norm(np.diff(path, axis=0), axis=1).max() / DT
        assert fastest == pytest.approx(PathProfile().linear[0] * planned * own, rel=0.01)


@EVERY_MOTION
def test_home_is_the_robots_own_configuration_or_at_least_its_pose(
    robot: Robot, arm: Arm, plain: PlainArm, motion: Motion
) -> None:
    waypoint = Waypoint(name="home", target=Place.HOME, motion=motion)
    q_start = arm.home + 0.15 * np.cos(np.arange(arm.n))
    leg = planner(robot).plan(arm, waypoint, q_start, DT)
    if motion is Motion.PTP:
        assert leg.trajectory.q[-1].tolist() == arm.home.tolist()
        assert leg.ik.iterations == 0
    assert max(plain.errors(leg.trajectory.q[-1], arm.pose(arm.home))) < 1.1e-6
    assert max(plain.errors(arm.home, leg.T_world_goal)) < 1e-9


def test_home_is_found_without_the_solver(robot: Robot, arm: Arm, plain: PlainArm) -> None:
    """Also where the solver would find another configuration for the pose of home."""
    q_start = plain.at(np.array([0.9, 0.2, 0.1, 0.3, 0.9, 0.6, 0.2, 0.5]))
    waypoint = Waypoint(name="home", target=Place.HOME)
    helpless = planner(robot, ik=DlsIk(max_iterations=0))
    leg = helpless.plan(arm, waypoint, q_start, DT)
    assert leg.trajectory.q[-1].tolist() == arm.home.tolist()


@EVERY_MOTION
def test_being_there_already_takes_no_time(robot: Robot, arm: Arm, motion: Motion) -> None:
    waypoint = ahead(arm, motion, target=arm.pose(arm.home))
    leg = planner(robot).plan(arm, waypoint, arm.home, DT)
    assert leg.trajectory.steps == 0
    assert leg.trajectory.q.tolist() == [arm.home.tolist()]
    assert leg.ik.converged


@EVERY_MOTION
def test_a_waypoint_out_of_reach_is_named_with_the_reason(
    robot: Robot, arm: Arm, motion: Motion
) -> None:
    waypoint = Waypoint(name="the moon", target=FAR, motion=motion)
    told = "(beyond the reach of the arm|remain after|comes no closer than|outside \\[)"
    message = rf"Waypoint 'the moon' cannot be planned: .*{told}"
    with pytest.raises(PlanError, match=message) as caught:
        planner(robot).plan(arm, waypoint, arm.home, DT)
    assert caught.value.waypoint == "the moon"
    assert caught.value.explanation
    assert caught.value.explanation in str(caught.value)


def test_a_ptp_waypoint_out_of_reach_tells_by_how_much(robot: Robot, arm: Arm) -> None:
    beyond = arm.beyond_reach(FAR.translation())
    with pytest.raises(PlanError, match=rf"the target is {beyond:.3f} m beyond the reach"):
        planner(robot).plan(arm, Waypoint(name="out", target=FAR), arm.home, DT)


def test_a_ptp_waypoint_that_is_not_found_tells_what_remains(robot: Robot, arm: Arm) -> None:
    waypoint = ahead(arm, Motion.PTP)
    message = r"Waypoint 'ahead' cannot be planned: .* mm and .*° remain after 1 iterations"
    with pytest.raises(PlanError, match=message):
        planner(robot, ik=QpIk(max_iterations=1)).plan(arm, waypoint, arm.home, DT)


def test_a_line_that_fails_on_the_way_tells_where(robot: Robot, arm: Arm) -> None:
    waypoint = Waypoint(name="through the wall", target=FAR, motion=Motion.LIN)
    message = r"'through the wall' cannot be planned: the path fails \d+ % of the way"
    with pytest.raises(PlanError, match=message):
        planner(robot).plan(arm, waypoint, arm.home, DT)


def test_a_line_through_a_joint_limit_cannot_be_planned(robot: Robot, arm: Arm) -> None:
    """Turning the tool on the spot goes on only as far as the wrist does."""
    q = arm.home.copy()
    q[-1] = arm.q_max[-1] - 0.5
    goal = turned(arm.pose(q), 2, 1.5)
    waypoint = Waypoint(name="unscrew", target=goal, motion=Motion.LIN)
    with pytest.raises(PlanError, match="'unscrew' cannot be planned: the path fails"):
        planner(robot, ik=QpIk()).plan(arm, waypoint, q, DT)


def test_a_robot_whose_home_is_outside_its_limits_cannot_go_home(robot: Robot) -> None:
    home = robot.home.copy()
    home[0] = 4.0
    astray = Arm(replace(robot, home=home))
    waypoint = Waypoint(name="home", target=Place.HOME)
    message = rf"Waypoint 'home' cannot be planned: {robot.joints[0]} is 1\.\d+ rad outside"
    with pytest.raises(PlanError, match=message):
        planner(robot).plan(astray, waypoint, robot.home, DT)


def test_a_line_is_planned_with_the_planners_own_settings(robot: Robot, arm: Arm) -> None:
    slow = Lin(profile=PathProfile(linear=(0.02, 0.75, 5.0)))
    usual = planner(robot)
    waypoint = ahead(arm, Motion.LIN)
    leg = replace(usual, lin=slow).plan(arm, waypoint, arm.home, DT)
    length = np.linalg.norm(leg.T_world_goal.translation() - leg.T_world_start.translation())
    assert leg.trajectory.duration > length / 0.02
    assert usual.plan(arm, waypoint, arm.home, DT).trajectory.duration < length / 0.1


@pytest.mark.parametrize("pace", [0.0, -1.0, 1.5, np.nan])
@EVERY_MOTION
def test_a_pace_that_is_none_is_refused(
    robot: Robot, arm: Arm, motion: Motion, pace: float
) -> None:
    with pytest.raises(InvalidValueError, match="pace must be above 0 and at most 1"):
        planner(robot, pace=pace).plan(arm, ahead(arm, motion), arm.home, DT)


def test_legs_can_be_joined(robot: Robot, arm: Arm) -> None:
    """Each leg ends where the next one starts: at the same sample."""
    q: Vector = arm.home
    for target, motion in (
        (tool_down([0.5, 0.1, 0.3]), Motion.PTP),
        (tool_down([0.5, 0.1, 0.15]), Motion.LIN),
        (tool_down([0.5, 0.1, 0.3]), Motion.LIN),
        (tool_down([0.4, -0.2, 0.3], 1.0), Motion.PTP),
    ):
        waypoint = Waypoint(name="next", target=target, motion=motion)
        leg: Leg = planner(robot).plan(arm, waypoint, q, DT)
        assert leg.trajectory.q[0] == pytest.approx(q, abs=1e-9)
        q = leg.trajectory.end.q


@EVERY_MOTION
def test_the_same_plan_is_made_twice(robot: Robot, arm: Arm, motion: Motion) -> None:
    first = planner(robot).plan(arm, ahead(arm, motion), arm.home, DT)
    planner(robot).plan(arm, Waypoint(name="home", target=Place.HOME), arm.home + 0.2, DT)
    for belief in (arm, Arm(robot)):
        again = planner(robot).plan(belief, ahead(arm, motion), arm.home, DT)
        assert again.trajectory.q.tobytes() == first.trajectory.q.tobytes()
        assert again.trajectory.a.tobytes() == first.trajectory.a.tobytes()


def test_what_is_planned_belongs_to_the_caller(robot: Robot, arm: Arm) -> None:
    q_start = arm.home.copy()
    waypoint = Waypoint(name="home", target=Place.HOME)
    leg = planner(robot).plan(arm, waypoint, q_start, DT)
    leg.trajectory.q[:] = 7.0
    leg.ik.q[:] = 7.0
    assert q_start.tolist() == arm.home.tolist() == robot.home.tolist()


@EVERY_MOTION
def test_a_start_that_is_not_finite_is_refused(robot: Robot, arm: Arm, motion: Motion) -> None:
    q_start = arm.home.copy()
    q_start[2] = np.nan
    with pytest.raises(InvalidValueError, match=r"q_start must be a vector of .* finite"):
        planner(robot).plan(arm, ahead(arm, motion), q_start, DT)


def test_a_line_of_no_length_outside_the_limits_is_refused(robot: Robot, arm: Arm) -> None:
    q_start = arm.home.copy()
    q_start[0] = arm.q_max[0] + 0.1
    here = Waypoint(name="here", target=arm.pose(q_start), motion=Motion.LIN)
    with pytest.raises(PlanError, match=r"'here' cannot be planned.*0\.100 (rad|m) outside"):
        planner(robot).plan(arm, here, q_start, DT)


@pytest.mark.parametrize("joint", range(7))
def test_a_line_from_far_outside_the_limits_is_refused(joint: int) -> None:
    arm = Arm(PANDA)
    q_start = arm.home.copy()
    q_start[joint] = arm.q_max[joint] + 0.3
    lower = SE3.from_translation(np.array([0.0, 0.0, -0.02])) @ arm.pose(q_start)
    there = Waypoint(name="there", target=lower, motion=Motion.LIN)
    with pytest.raises(PlanError, match="'there' cannot be planned"):
        planner(PANDA).plan(arm, there, q_start, DT)


@pytest.mark.parametrize("pace", [0.0, -1.0, 5.0, np.nan])
def test_a_pace_out_of_range_is_refused_whatever_the_waypoints_do(
    robot: Robot, pace: float
) -> None:
    with pytest.raises(InvalidValueError, match="pace must be above 0 and at most 1"):
        planner(robot, pace)
