from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mink import SE3, SO3
from scipy.spatial.transform import Rotation, Slerp

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.ik.qp import QpIk
from robo47_qp.ik.solver import IkResult, IkSolver, Reason, Tolerance
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import MotionProfile, Robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.tool_poses import Target
from robo47_qp.motion.following.lin import Lin
from robo47_qp.motion.paths.segments import Line, PathProfile
from robo47_qp.motion.refusals import PathError
from robo47_qp.motion.trajectory import Trajectory
from tests.examples import shifted, turned
from tests.motion.timing.test_jerk_limited import shortest
from tests.plain_arm import PlainArm

DT = 1e-3
IK = QpIk()
FAST = 1e3


def goals(reach: float, turn: float) -> st.SearchStrategy[tuple[Vector, Vector]]:
    """Shifts [m] and turns [rad] of the tool."""
    along, about = st.floats(-reach, reach), st.floats(-turn, turn)
    three = st.tuples(along, along, along).map(np.array)
    three = three.filter(lambda shift: bool(np.linalg.norm(shift) > 0.01))
    return st.tuples(three, st.tuples(about, about, about).map(np.array))


def moved(pose: SE3, by: tuple[Vector, Vector]) -> SE3:
    return shifted(pose, by[0]) @ SE3.from_rotation(SO3.exp(by[1]))


ROOM = {"panda": 0.7, "slider6": 0.9, "ur5e": 0.5}
"""Share of the drawn motions that an arm has room for from home, in every direction: beyond it the
Panda's elbow is bent as far as it goes, and the UR5e's wrist is too close to the base axis."""


def drawn(arm: Arm, by: tuple[Vector, Vector]) -> SE3:
    """A goal within reach of home."""
    room = ROOM[arm.robot.name]
    return moved(arm.pose(arm.home), (room * by[0], room * by[1]))


def off_line(plain: PlainArm, q: Matrix, start: SE3, goal: SE3) -> tuple[float, float]:
    """How far the tool is from the straight line [m] and from its turn there [rad], at most."""
    ends = Rotation.from_quat([np.roll(pose.wxyz_xyz[:4], -1) for pose in (start, goal)])
    way = goal.translation() - start.translation()
    tools = [plain.tool(row) for row in q]
    from_start = np.array([position for position, _ in tools]) - start.translation()
    turns = Rotation.from_matrix([R for _, R in tools])
    if np.linalg.norm(way) > 1e-9:
        s = from_start @ way / (way @ way)
    else:
        s = (ends[0].inv() * turns).magnitude() / (ends[0].inv() * ends[1]).magnitude()
    away = np.linalg.norm(from_start - np.outer(s, way), axis=1)
    there = Slerp([0.0, 1.0], ends)(np.clip(s, 0.0, 1.0))
    return float(away.max()), float((there.inv() * turns).magnitude().max())


def check_joints(trajectory: Trajectory, profile: MotionProfile, slack: float = 0.02) -> float:
    """Differences of the positions keep the bounds; returns how much of them is used."""
    used = 0.0
    for order, name in enumerate(("v_max", "a_max", "j_max"), start=1):
        bound = getattr(profile, name)
        derivative = np.abs(np.diff(trajectory.q, order, axis=0)) / trajectory.dt**order
        assert (derivative <= bound * (1 + slack) + 1e-14 / trajectory.dt**order).all(), name
        used = max(used, float((derivative / bound).max()) ** (1 / order))
    return used


def tool_path(plain: PlainArm, trajectory: Trajectory) -> Matrix:
    return np.array([plain.tool(q)[0] for q in trajectory.q])


@dataclass(frozen=True, kw_only=True)
class Altered:
    """A solver with its answers changed."""

    by: Vector
    after: int = 0
    """Answers that are left as they are."""
    reason: Reason | None = None
    results: list[IkResult] = field(default_factory=list, compare=False)
    seeds: list[Vector] = field(default_factory=list, compare=False)
    solver: IkSolver = IK

    @property
    def tolerance(self) -> Tolerance:
        return self.solver.tolerance

    def solve(self, arm: Arm, T_world_target: Target, q_seed: Vector) -> IkResult:
        self.seeds.append(q_seed.copy())
        result = self.solver.solve(arm, T_world_target, q_seed)
        if len(self.results) >= self.after:
            result = replace(result, q=result.q + self.by, reason=self.reason, explanation="no")
        self.results.append(result)
        return result


def test_each_knot_starts_from_the_one_before(robot: Robot, arm: Arm) -> None:
    q_start = arm.home + 0.1
    goal = shifted(arm.pose(q_start), np.array([0.0, 0.0, -0.0995]))
    ik = Altered(by=np.zeros(arm.n))
    Lin(doublings=0, deviation=1e-3).plan(arm, ik, q_start, goal, robot.profile, DT)
    assert len(ik.seeds) == 10
    before = [q_start, *(result.q for result in ik.results[:-1])]
    assert np.array(ik.seeds).tolist() == np.array(before).tolist()


@settings(max_examples=10)
@given(by=goals(0.15, 0.5))
def test_the_tool_stays_on_the_straight_line_and_turns_steadily(
    robot: Robot, arm: Arm, plain: PlainArm, by: tuple[Vector, Vector]
) -> None:
    start, goal = arm.pose(arm.home), drawn(arm, by)
    trajectory, result = Lin().plan(arm, IK, arm.home, goal, robot.profile, DT)
    assert result.converged
    # Half of it for the spline, half for the tolerance of IK and the lag of the projection.
    away, askew = off_line(plain, trajectory.q[::7], start, goal)
    assert away < 1e-5
    assert askew < 2e-5


@settings(max_examples=10)
@given(by=goals(0.15, 0.5), pace=st.floats(0.3, 1.0))
def test_the_joints_keep_their_bounds_and_limits(
    robot: Robot, arm: Arm, plain: PlainArm, by: tuple[Vector, Vector], pace: float
) -> None:
    goal = drawn(arm, by)
    profile = robot.profile.slowed(pace)
    trajectory, _ = Lin().plan(arm, IK, arm.home, goal, profile, DT, pace)
    check_joints(trajectory, profile)
    assert all(plain.inside(q) for q in trajectory.q)


@settings(max_examples=10)
@given(by=goals(0.15, 0.5))
def test_the_motion_starts_and_ends_at_rest_where_asked(
    robot: Robot, arm: Arm, plain: PlainArm, by: tuple[Vector, Vector]
) -> None:
    goal = drawn(arm, by)
    trajectory, result = Lin().plan(arm, IK, arm.home, goal, robot.profile, DT)
    assert trajectory.dt == DT
    assert trajectory.q[0] == pytest.approx(arm.home, abs=1e-9)
    assert max(plain.errors(trajectory.q[-1], goal)) < 1.1e-6
    assert trajectory.end.q.tolist() == result.q.tolist()
    for end in (0, -1):
        assert trajectory.v[end] == pytest.approx(np.zeros(arm.n), abs=1e-9)
        assert trajectory.a[end] == pytest.approx(np.zeros(arm.n), abs=1e-9)
    assert (result.position_error, result.orientation_error) == pytest.approx(
        plain.errors(trajectory.q[-1], goal), abs=1e-9
    )


@settings(max_examples=5)
@given(by=goals(0.15, 0.5))
def test_velocity_and_acceleration_are_those_of_the_position(
    robot: Robot, arm: Arm, by: tuple[Vector, Vector]
) -> None:
    goal = drawn(arm, by)
    trajectory, _ = Lin().plan(arm, IK, arm.home, goal, robot.profile, DT)
    q, v, a = trajectory.q, trajectory.v, trajectory.a
    jerk = robot.profile.j_max
    speed = (q[2:] - q[:-2]) / (2 * DT)
    assert (np.abs(speed - v[1:-1]) <= jerk * DT**2).all()
    bend = (q[2:] - 2 * q[1:-1] + q[:-2]) / DT**2
    assert (np.abs(bend - a[1:-1]) <= jerk * DT + 1e-8).all()


@pytest.mark.parametrize("pace", [1.0, 0.5])
def test_the_tool_keeps_its_own_profile_and_uses_it(arm: Arm, plain: PlainArm, pace: float) -> None:
    """With joints fast enough, the tool's bounds alone set the time."""
    profile = PathProfile(linear=(0.2, 1.0, 10.0))
    goal = shifted(arm.pose(arm.home), np.array([0.1, -0.2, -0.1]))
    joints = MotionProfile.uniform(arm.n, v=FAST, a=FAST, j=FAST * FAST)
    lin = Lin(profile=profile)
    trajectory, _ = lin.plan(arm, IK, arm.home, goal, joints, DT, pace)
    path = tool_path(plain, trajectory)
    for order, bound in enumerate(profile.linear, start=1):
        differences = np.linalg.norm(np.diff(path, order, axis=0), axis=1) / DT**order
        assert differences.max() == pytest.approx(bound * pace**order, rel=0.02)
    length = float(np.linalg.norm(path[-1] - path[0]))
    v, a, j = (bound * pace**order for order, bound in enumerate(profile.linear, start=1))
    best = shortest(length, (v, a, j))
    assert best - 1e-6 <= trajectory.duration <= best + DT + 1e-6


def test_a_turn_on_the_spot_keeps_the_point_and_the_angular_profile(
    arm: Arm, plain: PlainArm
) -> None:
    start = arm.pose(arm.home)
    goal = turned(start, 2, 1.2)
    joints = MotionProfile.uniform(arm.n, v=FAST, a=FAST, j=FAST * FAST)
    profile = PathProfile(angular=(0.8, 3.0, 20.0))
    trajectory, _ = Lin(profile=profile).plan(arm, IK, arm.home, goal, joints, DT)
    away, askew = off_line(plain, trajectory.q[::7], start, goal)
    assert away < 1e-5
    assert askew < 1e-5
    assert np.abs(tool_path(plain, trajectory) - start.translation()).max() < 1e-5
    best = shortest(1.2, (0.8, 3.0, 20.0))
    assert best - 1e-6 <= trajectory.duration <= best + DT + 1e-6
    _, R = plain.tool(trajectory.q[trajectory.steps // 2])
    middle = start.rotation().as_matrix().T @ R
    assert Rotation.from_matrix(middle).as_rotvec() == pytest.approx([0, 0, 0.6], abs=1e-2)


def test_the_slower_of_moving_and_turning_sets_the_time(arm: Arm) -> None:
    start = arm.pose(arm.home)
    joints = MotionProfile.uniform(arm.n, v=FAST, a=FAST, j=FAST * FAST)
    goal = turned(shifted(start, np.array([0.0, 0.0, -0.05])), 2, 1.2)
    trajectory, _ = Lin().plan(arm, IK, arm.home, goal, joints, DT)
    alone, _ = Lin().plan(arm, IK, arm.home, turned(start, 2, 1.2), joints, DT)
    assert trajectory.duration == pytest.approx(alone.duration, abs=DT)


@pytest.mark.parametrize(
    ("v", "a", "j"), [(0.3, FAST, FAST**2), (FAST, 0.2, FAST**2), (FAST, FAST, 1.0)]
)
def test_where_a_joint_binds_time_is_stretched_as_much_as_needed(
    arm: Arm, plain: PlainArm, v: float, a: float, j: float
) -> None:
    goal = shifted(arm.pose(arm.home), np.array([0.1, -0.2, -0.1]))
    free = MotionProfile.uniform(arm.n, v=FAST, a=FAST, j=FAST * FAST)
    bound = MotionProfile.uniform(arm.n, v=v, a=a, j=j)
    quick, _ = Lin().plan(arm, IK, arm.home, goal, free, DT)
    slow, _ = Lin().plan(arm, IK, arm.home, goal, bound, DT)
    assert slow.duration > 1.2 * quick.duration
    assert 0.97 < check_joints(slow, bound) < 1.01
    # The same motion in another time: at the same fraction of it, the same place.
    for fraction in np.linspace(0.0, 1.0, 41):
        there = [plan.q[round(fraction * plan.steps)] for plan in (quick, slow)]
        # A fraction of a sample is missed at most.
        assert np.abs(there[0] - there[1]).max() <= 2 * DT * np.abs(quick.v).max()
    assert off_line(plain, slow.q[::7], arm.pose(arm.home), goal)[0] < 1e-5


def test_half_the_pace_takes_twice_the_time(robot: Robot, arm: Arm, plain: PlainArm) -> None:
    goal = shifted(arm.pose(arm.home), np.array([0.1, 0.1, -0.2]))
    full, _ = Lin().plan(arm, IK, arm.home, goal, robot.profile, DT)
    for pace in (0.5, 0.2):
        slowed = robot.profile.slowed(pace)
        slow, _ = Lin().plan(arm, IK, arm.home, goal, slowed, DT, pace)
        assert slow.duration == pytest.approx(full.duration / pace, rel=3e-3)
        assert slow.q[-1] == pytest.approx(full.q[-1], abs=1e-6)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_no_way_at_all_is_one_sample(robot: Robot, arm: Arm, axis: int) -> None:
    start = arm.pose(arm.home)
    for goal in (start, turned(start, axis, 1e-11), shifted(start, 1e-11 * np.eye(3)[axis])):
        trajectory, result = Lin().plan(arm, IK, arm.home, goal, robot.profile, DT)
        assert trajectory.steps == 0
        assert trajectory.q.tolist() == [arm.home.tolist()]
        assert not trajectory.v.any()
        assert not trajectory.a.any()
        assert result.converged
        assert result.q.tolist() == arm.home.tolist()


@pytest.mark.parametrize("size", [1e-8, 9e-7, 1.1e-6, 1e-4])
def test_a_tiny_way_is_gone_unless_the_tool_is_there(robot: Robot, arm: Arm, size: float) -> None:
    """What IK's tolerance counts as reached needs no motion."""
    start = arm.pose(arm.home)
    for goal in (shifted(start, np.array([0.0, size, 0.0])), turned(start, 1, size)):
        trajectory, result = Lin().plan(arm, IK, arm.home, goal, robot.profile, DT)
        assert result.converged
        assert (trajectory.steps >= 1) == (size > 1e-6)
        if trajectory.steps:
            check_joints(trajectory, robot.profile)


def test_a_line_to_the_end_of_the_reach_is_followed(
    robot: Robot, arm: Arm, plain: PlainArm
) -> None:
    """Near the stretched arm the joints run fast for little: time is stretched."""
    q_goal = plain.at(np.array([0.5, 0.75, 0.5, 0.93, 0.5, 0.55, 0.77, 0.5]))
    q_start = q_goal.copy()
    q_start[3] -= 0.5
    goal = arm.pose(q_goal)
    trajectory, _ = Lin().plan(arm, IK, q_start, goal, robot.profile, DT)
    check_joints(trajectory, robot.profile)
    assert off_line(plain, trajectory.q[::11], arm.pose(q_start), goal)[0] < 1e-5


def test_a_line_beyond_reach_fails_where_the_reach_ends(robot: Robot, arm: Arm) -> None:
    start = arm.pose(arm.home)
    goal = shifted(start, np.array([1.5, 0.0, 0.0]))
    message = r"the path fails \d+ % of the way: .* remain after|beyond the reach"
    with pytest.raises(PathError, match=message) as caught:
        Lin().plan(arm, IK, arm.home, goal, robot.profile, DT)
    # The tool starts 0.3 m in front of the base and reaches to less than 0.9 m.
    assert 0.1 < caught.value.fraction < 0.5
    assert f"{100 * caught.value.fraction:.0f} % of the way" in str(caught.value)


def test_an_exact_half_turn_is_not_taken_for_none(robot: Robot, arm: Arm, plain: PlainArm) -> None:
    q, planned = arm.home.copy(), 0
    q[-1] = arm.q_max[-1] - 0.1
    for half_turn in np.eye(4)[1:]:
        goal = arm.pose(q) @ SE3.from_rotation(SO3(half_turn))
        with suppress(PathError):
            trajectory, _ = Lin().plan(arm, IK, q, goal, robot.profile, DT)
            planned += 1
            assert max(plain.errors(trajectory.q[-1], goal)) < 1.1e-6
    # Of this one, the wrist leaves no room for any.
    assert planned or robot.name == "slider6"


@pytest.mark.parametrize("reason", [None, Reason.NOT_CONVERGED])
def test_an_answer_on_another_branch_or_none_leads_no_arm_astray(
    robot: Robot, arm: Arm, plain: PlainArm, reason: Reason | None
) -> None:
    start = arm.pose(arm.home)
    goal = shifted(start, np.array([0.0, 0.0, -0.0995]))
    by = np.zeros(arm.n)
    by[2] = -0.4
    liar = Altered(by=by, after=5, reason=reason)
    trajectory, _ = Lin().plan(arm, liar, arm.home, goal, robot.profile, DT)
    assert np.abs(np.diff(trajectory.q, axis=0)).max() < 0.01
    line = Line(start, goal)
    off = line.distances(np.array([plain.tool(q)[0] for q in trajectory.q]))
    assert off.max() < 10e-6
    assert max(plain.errors(trajectory.q[-1], goal)) < 2e-6


def test_a_path_that_cannot_be_kept_is_refused(robot: Robot, arm: Arm) -> None:
    goal = shifted(arm.pose(arm.home), np.array([0.0, 0.3, 0.0]))
    lin = Lin(deviation=1e-12, doublings=1, knot_spacing=0.05)
    message = r"of the way: 16 knots leave the tool \d+ µm off"
    with pytest.raises(PathError, match=message):
        lin.plan(arm, IK, arm.home, goal, robot.profile, DT)


def test_knots_are_doubled_until_the_line_is_kept(robot: Robot, arm: Arm, plain: PlainArm) -> None:
    goal = moved(arm.pose(arm.home), (np.array([0.1, 0.3, -0.2]), np.array([0.0, 0.0, 0.8])))
    coarse = Lin(knot_spacing=1.0, deviation=1e-6, doublings=6)
    ik = Altered(by=np.zeros(arm.n), solver=QpIk(tolerance=Tolerance(position=1e-9)))
    trajectory, _ = coarse.plan(arm, ik, arm.home, goal, robot.profile, DT)
    assert len(ik.results) in {8 + 16, 8 + 16 + 32, 8 + 16 + 32 + 64}
    assert off_line(plain, trajectory.q[::7], arm.pose(arm.home), goal)[0] < 3e-6


def test_as_many_knots_are_taken_as_the_deviation_asks_for() -> None:
    arm, plain = Arm(PANDA), PlainArm(PANDA)
    start = arm.pose(arm.home)
    goal = moved(start, (np.array([0.1, 0.3, -0.2]), np.array([0.0, 0.0, 0.8])))
    ik = QpIk(tolerance=Tolerance(position=1e-9, orientation=1e-9))
    for deviation in 10.0 ** -np.arange(3.0, 6.5, 0.5):
        lin = Lin(knot_spacing=1.0, deviation=float(deviation), doublings=6)
        trajectory, _ = lin.plan(arm, ik, arm.home, goal, PANDA.profile, DT)
        assert off_line(plain, trajectory.q[::7], start, goal)[0] <= 1.2 * deviation


def test_all_effort_is_told(robot: Robot, arm: Arm) -> None:
    goal = shifted(arm.pose(arm.home), np.array([0.1, 0.2, -0.1]))
    ik = Altered(by=np.zeros(arm.n))
    _, result = Lin().plan(arm, ik, arm.home, goal, robot.profile, DT)
    assert result.iterations == sum(answer.iterations for answer in ik.results)
    assert result.seconds == pytest.approx(sum(answer.seconds for answer in ik.results))
    assert len(ik.results) >= 20


def test_the_same_line_is_the_same_motion(robot: Robot, arm: Arm) -> None:
    goal = shifted(arm.pose(arm.home), np.array([0.1, 0.2, -0.1]))
    other = turned(goal, 2, 0.5)
    plans = [
        Lin().plan(belief, IK, arm.home, target, robot.profile, DT)[0]
        for belief, target in ((arm, goal), (arm, other), (arm, goal), (Arm(robot), goal))
    ]
    for again in plans[2:]:
        for name in ("q", "v", "a"):
            assert getattr(plans[0], name).tobytes() == getattr(again, name).tobytes()


def test_arguments_are_left_alone(robot: Robot, arm: Arm) -> None:
    q_start, goal = arm.home.copy(), shifted(arm.pose(arm.home), np.array([0.1, 0.0, 0.0]))
    kept = goal.wxyz_xyz.copy()
    for target in (goal, arm.pose(arm.home)):
        trajectory, _ = Lin().plan(arm, IK, q_start, target, robot.profile, DT)
        trajectory.q[:] = 7.0
    assert q_start.tolist() == arm.home.tolist()
    assert goal.wxyz_xyz.tolist() == kept.tolist()


def test_a_line_that_would_take_for_ever_is_refused(robot: Robot, arm: Arm) -> None:
    n = len(robot.joints)
    crawling = MotionProfile.uniform(n, v=1e-5, a=1.0, j=10.0)
    goal = shifted(arm.pose(arm.home), np.array([0.0, 0.1, 0.0]))
    with pytest.raises(PathError, match=r"it would have to be .* times slower"):
        Lin().plan(arm, IK, arm.home, goal, crawling, DT)
