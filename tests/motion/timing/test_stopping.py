from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robo47_qp.errors import InvalidValueError, PlanError, RefusalReason
from robo47_qp.model.arm import Arm, JointReference
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.timing.rest_to_rest import plan_ptp
from robo47_qp.motion.timing.stopping import stop
from robo47_qp.motion.trajectory import Trajectory

PANDA_ARM, DT, SLACK = Arm(PANDA), 1e-3, 1.0 + 1e-6


def stop_time(v: float, a: float, a_max: float, j_max: float) -> float:
    """Shortest time to rest from v > 0: as from no acceleration, at the speed it came from."""
    came_from = v + a**2 / (2.0 * j_max)
    far = came_from > a_max**2 / j_max
    whole = came_from / a_max + a_max / j_max if far else 2.0 * sqrt(came_from / j_max)
    return whole + a / j_max


def hardest(q: float, v: float, a: float, a_max: float, j_max: float) -> float:
    """How far a joint gets when braked as hard as its bounds allow, v > 0: by small steps."""
    h, most = 1e-6, q
    while v > 0.0:
        a = max(a - j_max * h, -a_max)
        v += a * h
        q += v * h
        most = max(most, q)
    return most


def looked_at(arm: Arm, now: JointReference, motion: Trajectory) -> None:
    """What every stop promises."""
    profile = arm.robot.profile
    for first, given_ in zip((motion.q, motion.v, motion.a), now, strict=True):
        assert first[0].tolist() == given_.tolist()
    assert not motion.v[-1].any()
    assert not motion.a[-1].any()
    assert (motion.q >= arm.q_min - 2e-9).all()
    assert (motion.q <= arm.q_max + 2e-9).all()
    assert (np.abs(motion.a) <= profile.a_max * SLACK).all()
    assert (np.abs(motion.jerk) <= profile.j_max * SLACK).all()
    jerk = profile.j_max.max()
    v, a = motion.v, motion.a
    assert np.abs(np.diff(motion.q, axis=0) - 0.5 * DT * (v[1:] + v[:-1])).max() <= jerk * DT**3
    assert np.abs(np.diff(v, axis=0) - 0.5 * DT * (a[1:] + a[:-1])).max() <= jerk * DT**2


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_joint_that_accelerates_from_no_speed_stays_inside_its_range(side: float) -> None:
    """30 mrad before a limit, at rest for an instant, with its acceleration towards it."""
    zero, a = np.zeros(7), np.zeros(7)
    q, profile = PANDA.home.copy(), PANDA.profile
    q[6] = PANDA_ARM.q_max[6] - 0.03 if side > 0 else PANDA_ARM.q_min[6] + 0.03
    a[6] = side * profile.a_max[6]
    gets = hardest(0.0, 1e-12, profile.a_max[6], profile.a_max[6], profile.j_max[6])
    assert gets > 0.03
    with pytest.raises(PlanError, match="joint7"):
        stop(PANDA_ARM, JointReference(q, zero, a), profile, DT)
    q[6] -= side * gets
    looked_at(
        PANDA_ARM,
        JointReference(q, zero, a),
        stop(PANDA_ARM, JointReference(q, zero, a), profile, DT),
    )


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000), share=st.floats(0.02, 0.98))
def test_a_ptp_motion_stops_straight_on_as_fast_as_can_be(seed: int, share: float) -> None:
    rng, profile = np.random.default_rng(seed), PANDA.profile
    middle, half = (
        0.5 * (PANDA_ARM.q_min + PANDA_ARM.q_max),
        0.45 * np.ptp([PANDA_ARM.q_min, PANDA_ARM.q_max], axis=0),
    )
    ends = middle + rng.uniform(-half, half, (2, PANDA_ARM.n))
    motion = plan_ptp(ends[0], ends[1], profile, DT)
    k = round(share * motion.steps)
    now = JointReference(motion.q[k], motion.v[k], motion.a[k])
    stopped = stop(PANDA_ARM, now, profile, DT)
    looked_at(PANDA_ARM, now, stopped)
    way = (ends[1] - ends[0]) / np.abs(ends[1] - ends[0]).max()
    beside = stopped.q - ends[0]
    beside -= np.outer(beside @ way / (way @ way), way)
    assert np.abs(beside).max() < 1e-9
    bounds = [float((b / np.abs(way)).min()) for b in (profile.a_max, profile.j_max)]
    lead = int(np.abs(way).argmax())
    sign = np.sign(way[lead])
    best = stop_time(sign * now.v[lead], sign * now.a[lead], *bounds)
    assert best - 1e-6 <= stopped.duration <= best + DT + 1e-9


def moving(arm: Arm, rng: np.random.Generator) -> JointReference:
    """Somewhere in the middle, each joint with a speed and an acceleration of its own."""
    profile = arm.robot.profile
    q = 0.5 * (arm.q_min + arm.q_max) + rng.uniform(-0.1, 0.1, arm.n) * (arm.q_max - arm.q_min)
    v = rng.uniform(-0.5, 0.5, arm.n) * profile.v_max
    return JointReference(q, v, rng.uniform(-0.5, 0.5, arm.n) * profile.a_max)


def test_on_a_curve_all_joints_stop_with_the_slowest(arm: Arm) -> None:
    profile, rng = arm.robot.profile, np.random.default_rng(5)
    for _ in range(5):
        now = moving(arm, rng)
        stopped = stop(arm, now, profile, DT)
        looked_at(arm, now, stopped)
        signs = np.sign(now.v)
        rows = zip(signs * now.v, signs * now.a, profile.a_max, profile.j_max, strict=True)
        best = max(stop_time(*(float(x) for x in row)) for row in rows)
        assert stopped.duration >= best - 1e-6
        # Joints that must first turn round may take longer than `stop_time` tells.
        if (signs * now.a > 0.0).all():
            assert stopped.duration <= best + DT


def before_the_limit(gap: float, v: float, others: float) -> JointReference:
    q, speeds = PANDA_ARM.home.copy(), np.full(PANDA_ARM.n, others)
    q[1], speeds[1] = PANDA_ARM.q_max[1] - gap, v
    return JointReference(q, speeds, np.zeros(PANDA_ARM.n))


def test_before_a_limit_the_joints_stop_each_on_its_own() -> None:
    # Straight on, joint 2 would have to brake as slowly as the weakest joint does.
    a_max = PANDA.profile.a_max * np.array([0.5, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    profile = replace(PANDA.profile, a_max=a_max)
    now = before_the_limit(0.0, 1.0, 1.0)
    alone = stop_time(1.0, 0.0, float(profile.a_max[1]), float(profile.j_max[1]))
    slow = stop_time(1.0, 0.0, float(profile.a_max.min()), float(profile.j_max.min()))
    assert slow > alone * 1.05
    now.q[1] = PANDA_ARM.q_max[1] - 0.25 * (alone + slow)
    stopped = stop(PANDA_ARM, now, profile, DT)
    looked_at(PANDA_ARM, now, stopped)
    last = int((np.abs(stopped.v[:, 1]) > 1e-9).nonzero()[0][-1])
    assert last * DT == pytest.approx(alone, abs=2 * DT)


def test_right_before_a_limit_a_joint_brakes_harder_and_comes_back() -> None:
    profile, v = PANDA.profile, 1.0
    a_max, j_max = float(profile.a_max[1]), float(profile.j_max[1])
    soft = 0.5 * v * stop_time(v, 0.0, a_max, j_max)
    hard = hardest(0.0, v, 0.0, a_max, j_max)
    assert hard < 0.97 * soft
    for gap in (0.9 * soft + 0.1 * hard, hard + 1e-3 * (soft - hard)):
        now = before_the_limit(gap, v, 0.1)
        stopped = stop(PANDA_ARM, now, profile, DT)
        looked_at(PANDA_ARM, now, stopped)
        assert stopped.v[:, 1].min() < 0.0
        # No further back than needed.
        assert stopped.q[:, 1].max() > PANDA_ARM.q_max[1] - 1e-5


def test_a_limit_that_no_braking_keeps_is_told_with_joint_and_time() -> None:
    profile, v = PANDA.profile, 1.0
    hard = hardest(0.0, v, 0.0, float(profile.a_max[1]), float(profile.j_max[1]))
    now = before_the_limit(0.98 * hard, v, 0.1)
    said = r"joint2 leaves its limits after 0\.\d\d\d s however hard it brakes"
    with pytest.raises(PlanError, match=said) as caught:
        stop(PANDA_ARM, now, profile, DT)
    found = caught.value.rejection
    assert found is not None
    assert caught.value.waypoint == "stop"
    assert (found.reason, found.joint) == (RefusalReason.JOINT_LIMIT, "joint2")
    assert found.q is not None
    assert found.q[1] > PANDA_ARM.q_max[1]


def test_the_same_holds_at_the_lower_limit() -> None:
    profile, v = PANDA.profile, 1.0
    soft = 0.5 * v * stop_time(v, 0.0, float(profile.a_max[1]), float(profile.j_max[1]))
    q, speeds = PANDA_ARM.home.copy(), np.zeros(PANDA_ARM.n)
    q[1], speeds[1] = PANDA_ARM.q_min[1] + 0.98 * soft, -v
    now = JointReference(q, speeds, np.zeros(PANDA_ARM.n))
    looked_at(PANDA_ARM, now, stop(PANDA_ARM, now, profile, DT))
    q[1] = PANDA_ARM.q_min[1] + 0.1 * soft
    with pytest.raises(PlanError, match="joint2"):
        stop(PANDA_ARM, now, profile, DT)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_outside_its_limits_already_a_joint_still_stops(side: float) -> None:
    q, rest = PANDA_ARM.home.copy(), np.zeros(PANDA_ARM.n)
    q[3], v = (PANDA_ARM.q_max if side > 0.0 else PANDA_ARM.q_min)[3] + 0.01 * side, rest.copy()
    v[3] = -0.3 * side
    stopped = stop(PANDA_ARM, JointReference(q, v, rest), PANDA.profile, DT)
    assert (side * stopped.q[:, 3]).max() <= side * q[3] + 1e-9
    assert not stopped.v[-1].any()


def test_at_rest_it_stays(arm: Arm) -> None:
    rest = np.zeros(arm.n)
    stopped = stop(arm, JointReference(arm.home, rest, rest), arm.robot.profile, DT)
    assert stopped.steps == 0
    assert stopped.q[0].tolist() == arm.home.tolist()


def test_an_acceleration_at_no_speed_is_brought_to_rest(arm: Arm) -> None:
    rest, a = np.zeros(arm.n), 0.3 * arm.robot.profile.a_max
    now = JointReference(0.5 * (arm.q_min + arm.q_max), rest, a)
    looked_at(arm, now, stop(arm, now, arm.robot.profile, DT))


def test_faster_than_the_profile_it_is_braked_within_acceleration_and_jerk() -> None:
    slow = PANDA.profile.slowed(0.5)
    now = JointReference(PANDA_ARM.home, 0.6 * PANDA.profile.v_max, np.zeros(PANDA_ARM.n))
    stopped = stop(PANDA_ARM, now, slow, DT)
    assert (np.abs(stopped.a) <= slow.a_max * SLACK).all()
    assert (np.abs(stopped.v) <= np.abs(now.v) * SLACK).all()


def test_a_path_that_bends_by_next_to_nothing_keeps_the_jerk_as_closely_as_any() -> None:
    n, profile = PANDA_ARM.n, PANDA.profile
    v = 0.1 * profile.v_max
    for beside in (1e-10, 5e-10, -5e-10):
        a = np.zeros(n)
        a[3] = beside
        motion = stop(PANDA_ARM, JointReference(PANDA_ARM.home, v, a), profile, DT)
        assert (np.abs(motion.jerk) <= profile.j_max * (1.0 + 1e-9)).all()


def test_what_is_not_finite_is_refused() -> None:
    rest, broken = np.zeros(PANDA_ARM.n), np.full(PANDA_ARM.n, np.nan)
    for now, name in (
        (JointReference(broken, rest, rest), "position of the reference"),
        (JointReference(PANDA_ARM.home, broken, rest), "velocity of the reference"),
        (JointReference(PANDA_ARM.home, rest, broken), "acceleration of the reference"),
    ):
        with pytest.raises(InvalidValueError, match=name):
            stop(PANDA_ARM, now, PANDA.profile, DT)
    with pytest.raises(InvalidValueError, match="dt must be positive"):
        stop(PANDA_ARM, JointReference(PANDA_ARM.home, rest, rest), PANDA.profile, 0.0)
