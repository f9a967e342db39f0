import numpy as np
import pytest
from hypothesis import assume, given

from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import MotionProfile, Robot
from robo47_qp.motion.timing.rest_to_rest import plan_ptp
from robo47_qp.motion.trajectory import Trajectory, hold
from tests.examples import fractions
from tests.motion.timing.test_jerk_limited import shortest
from tests.plain_arm import PlainArm

DT = 1e-3
PROFILES = pytest.mark.parametrize("which", ["profile", "rated"])


def differences(trajectory: Trajectory, order: int) -> Vector:
    """Largest derivative of the positions in each joint (n,)."""
    differences = np.diff(trajectory.q, order, axis=0) / trajectory.dt**order
    largest: Vector = np.abs(differences).max(axis=0)
    return largest


@PROFILES
@given(a=fractions, b=fractions)
def test_a_ptp_motion_is_a_straight_line_in_joint_space(
    robot: Robot, plain: PlainArm, which: str, a: Vector, b: Vector
) -> None:
    q_start, q_goal = plain.at(a), plain.at(b)
    way = q_goal - q_start
    assume(np.abs(way).max() > 1e-3)
    trajectory = plan_ptp(q_start, q_goal, getattr(robot, which), DT)
    s = (trajectory.q - q_start) @ way / (way @ way)
    assert np.abs(trajectory.q - q_start - s[:, None] * way).max() < 1e-9
    assert (np.diff(s) >= -1e-12).all()


@PROFILES
@given(a=fractions, b=fractions)
def test_a_ptp_motion_keeps_the_profile_and_the_joint_limits(
    robot: Robot, plain: PlainArm, which: str, a: Vector, b: Vector
) -> None:
    profile: MotionProfile = getattr(robot, which)
    q_start, q_goal = plain.at(a), plain.at(b)
    assume(np.abs(q_goal - q_start).max() > 0.01)
    trajectory = plan_ptp(q_start, q_goal, profile, DT)
    bounds = (profile.v_max, profile.a_max, profile.j_max)
    for order, bound in enumerate(bounds, start=1):
        assert (differences(trajectory, order) <= bound * (1 + 1e-6) + 1e-14 / DT**order).all()
    for derivative, bound in zip(
        (trajectory.v, trajectory.a, trajectory.jerk), bounds, strict=True
    ):
        assert (np.abs(derivative) <= bound * (1 + 1e-6)).all()
    assert (trajectory.q >= plain.q_min - 1e-12).all()
    assert (trajectory.q <= plain.q_max + 1e-12).all()


@given(a=fractions, b=fractions)
def test_a_ptp_motion_starts_and_ends_at_rest(
    robot: Robot, plain: PlainArm, a: Vector, b: Vector
) -> None:
    q_start, q_goal = plain.at(a), plain.at(b)
    trajectory = plan_ptp(q_start, q_goal, robot.profile, DT)
    assert trajectory.q[0] == pytest.approx(q_start, abs=1e-12)
    assert trajectory.q[-1].tolist() == q_goal.tolist()
    for rest in (trajectory.v[0], trajectory.a[0], trajectory.v[-1], trajectory.a[-1]):
        assert rest == pytest.approx(np.zeros(len(q_start)), abs=1e-12)
    end = trajectory.end
    assert end.q.tolist() == q_goal.tolist()
    assert end.v.tolist() == end.a.tolist() == [0.0] * len(q_goal)


@given(a=fractions, b=fractions)
def test_the_joint_with_the_longest_way_is_moved_as_fast_as_it_may(
    robot: Robot, plain: PlainArm, a: Vector, b: Vector
) -> None:
    q_start, q_goal = plain.at(a), plain.at(b)
    assume(np.abs(q_goal - q_start).max() > 1e-3)
    profile = MotionProfile.uniform(plain.n, v=1.0, a=3.0, j=20.0)
    trajectory = plan_ptp(q_start, q_goal, profile, DT)
    best = shortest(float(np.abs(q_goal - q_start).max()), (1.0, 3.0, 20.0))
    assert best - 1e-9 <= trajectory.duration <= best + DT + 1e-9


@pytest.mark.parametrize("dt", [5e-4, 1e-3, 4e-3])
def test_samples_are_a_period_apart(robot: Robot, arm: Arm, dt: float) -> None:
    q_goal = arm.home + 0.3
    trajectory = plan_ptp(arm.home, q_goal, robot.profile, dt)
    assert trajectory.dt == dt
    assert trajectory.duration == pytest.approx(trajectory.steps * dt)
    assert trajectory.steps == len(trajectory.q) - 1 == len(trajectory.jerk)
    speed = np.diff(trajectory.q, axis=0) / dt
    between = 0.5 * (trajectory.v[1:] + trajectory.v[:-1])
    room = float(robot.profile.j_max.max()) * dt**2
    np.testing.assert_allclose(speed, between, rtol=0.0, atol=room)


def test_a_slower_profile_takes_more_time_over_the_same_line(robot: Robot, arm: Arm) -> None:
    q_goal = arm.home + np.linspace(-0.5, 0.5, arm.n)
    full = plan_ptp(arm.home, q_goal, robot.profile, DT)
    for pace in (0.5, 0.1):
        slow = plan_ptp(arm.home, q_goal, robot.profile.slowed(pace), DT)
        assert slow.duration == pytest.approx(full.duration / pace, abs=DT / pace + DT)


def test_no_way_is_one_sample_at_rest(robot: Robot, arm: Arm) -> None:
    trajectory = plan_ptp(arm.home, arm.home, robot.profile, DT)
    assert trajectory.steps == 0
    assert trajectory.duration == 0.0
    assert trajectory.q.tolist() == [arm.home.tolist()]
    assert trajectory.v.tolist() == trajectory.a.tolist() == [[0.0] * arm.n]
    assert trajectory.jerk.shape == (0, arm.n)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("which", [0, 1])
def test_a_configuration_that_is_not_finite_is_refused(
    robot: Robot, arm: Arm, bad: float, which: int
) -> None:
    ends = [arm.home.copy(), arm.home + 0.1]
    ends[which][-1] = bad
    with pytest.raises(InvalidValueError, match="position must be finite"):
        plan_ptp(ends[0], ends[1], robot.profile, DT)


def test_ends_belong_to_the_caller(robot: Robot, arm: Arm) -> None:
    trajectory = plan_ptp(arm.home, arm.home + 0.1, robot.profile, DT)
    kept = trajectory.q.copy(), trajectory.v.copy(), trajectory.a.copy()
    for part in trajectory.end:
        part[:] = 7.0
    for before, after in zip(kept, (trajectory.q, trajectory.v, trajectory.a), strict=True):
        assert before.tolist() == after.tolist()
    trajectory.q[:] = 7.0
    assert plan_ptp(arm.home, arm.home + 0.1, robot.profile, DT).q.tolist() == kept[0].tolist()


@pytest.mark.parametrize("steps", [0, 1, 250])
def test_holding_still_takes_the_time_asked_for(arm: Arm, steps: int) -> None:
    q = arm.home.copy()
    still = hold(q, steps, DT)
    q[:] = 7.0
    assert still.steps == steps
    assert still.duration == pytest.approx(steps * DT)
    assert (still.q == arm.home).all()
    assert not still.v.any()
    assert not still.a.any()
    still.v[:] = 1.0
    assert not still.a.any()
