import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robo47_qp.errors import InvalidValueError, PlanError, RefusalReason
from robo47_qp.model.arm import Arm, JointReference
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.retarget import Pursuit, retarget
from robo47_qp.motion.timing.lower_bound import least_time

ARM, DT, PROFILE = Arm(PANDA), 1e-3, PANDA.profile


def goal(rng: np.random.Generator) -> np.ndarray:
    return ARM.home + rng.uniform(-0.4, 0.4, ARM.n)


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000), every=st.integers(1, 400))
def test_a_goal_that_changes_while_moving_leaves_no_jump(seed: int, every: int) -> None:
    rng = np.random.default_rng(seed)
    pursuit = Pursuit(ARM, ARM.home, PROFILE, DT)
    states = [pursuit.reference]
    for k in range(800):
        if k % every == 0:
            pursuit.aim(goal(rng))
        states.append(pursuit.step())
    q, v, a = (np.array(x) for x in zip(*states, strict=True))
    assert (np.abs(v) <= PROFILE.v_max * (1 + 1e-6)).all()
    assert (np.abs(a) <= PROFILE.a_max * (1 + 1e-6)).all()
    assert (np.abs(np.diff(a, axis=0)) / DT <= PROFILE.j_max * (1 + 1e-6)).all()
    jerk = PROFILE.j_max.max()
    assert np.abs(np.diff(q, axis=0) - 0.5 * DT * (v[1:] + v[:-1])).max() <= jerk * DT**3
    assert np.abs(np.diff(v, axis=0) - 0.5 * DT * (a[1:] + a[:-1])).max() <= jerk * DT**2


def test_it_comes_to_rest_at_the_last_goal_and_stays() -> None:
    pursuit, rng = Pursuit(ARM, ARM.home, PROFILE, DT), np.random.default_rng(3)
    pursuit.aim(goal(rng))
    for _ in range(400):
        pursuit.step()
    last = goal(rng)
    pursuit.aim(last)
    for _ in range(5000):
        pursuit.step()
    end = pursuit.reference
    assert end.q == pytest.approx(last, abs=1e-12)
    assert pursuit.goal.tolist() == last.tolist()
    assert not end.v.any()
    assert not end.a.any()


def test_from_rest_it_takes_the_time_of_the_slowest_joint() -> None:
    rest = np.zeros(ARM.n)
    there = ARM.home + np.array([0.5, 0.1, 0.0, 0.2, -0.3, 0.2, 0.4])
    plan = retarget(ARM, JointReference(ARM.home, rest, rest), there, PROFILE, DT)
    best = least_time(0.5, PROFILE.v_max[0], PROFILE.a_max[0], PROFILE.j_max[0])
    assert best - 1e-9 <= plan.duration <= best + DT


def test_a_joint_that_cannot_turn_round_in_time_is_named() -> None:
    q, v = ARM.home.copy(), np.zeros(ARM.n)
    q[1], v[1] = ARM.q_max[1] - 0.05, 1.5
    with pytest.raises(PlanError, match=r"joint2 leaves its limits after 0\.0\d\d s") as caught:
        retarget(ARM, JointReference(q, v, np.zeros(ARM.n)), ARM.home, PROFILE, DT)
    found = caught.value.rejection
    assert found is not None
    assert (found.reason, found.joint) == (RefusalReason.JOINT_LIMIT, "joint2")
    assert found.q is not None
    assert found.q[1] > ARM.q_max[1]
    assert found.time == pytest.approx(0.05 / 1.5, abs=4e-3)


@pytest.mark.parametrize("side", [-1, 1])
def test_where_on_the_way_a_joint_leaves_its_limits_is_told(side: int) -> None:
    """Past either limit; the turn takes as long as full deceleration does, and back."""
    q, v = ARM.home.copy(), np.zeros(ARM.n)
    limit = ARM.q_max[1] if side > 0 else ARM.q_min[1]
    q[1], v[1] = limit - side * 0.1, side * 1.5
    with pytest.raises(PlanError, match="joint2 leaves its limits") as caught:
        retarget(ARM, JointReference(q, v, np.zeros(ARM.n)), q, PROFILE, DT)
    found = caught.value.rejection
    assert found is not None
    assert found.q is not None
    assert found.time is not None
    assert found.fraction is not None
    assert side * (found.q[1] - limit) > 0.0
    # The whole way by the same bounds, where there is room for it.
    apart = q.copy()
    apart[1] = 0.5 * (ARM.q_min[1] + ARM.q_max[1])
    whole = retarget(ARM, JointReference(apart, v, np.zeros(ARM.n)), apart, PROFILE, DT)
    assert found.fraction == pytest.approx(found.time / whole.duration, rel=1e-9)
    assert 0.0 < found.fraction < 0.5


def test_what_is_handed_out_can_be_written_to() -> None:
    pursuit = Pursuit(ARM, ARM.home, PROFILE, DT)
    there = ARM.home + 0.1
    pursuit.aim(there)
    there[:] = 7.0
    for array in (*pursuit.reference, pursuit.goal):
        array[:] = 7.0
    assert pursuit.reference.q.tolist() == ARM.home.tolist()
    assert not np.any(pursuit.reference.v)
    assert pursuit.goal == pytest.approx(ARM.home + 0.1)
    for _ in range(1000):
        pursuit.step()
    assert pursuit.reference.q == pytest.approx(ARM.home + 0.1, abs=1e-12)


def test_a_refused_goal_leaves_the_old_one() -> None:
    pursuit = Pursuit(ARM, ARM.home, PROFILE, DT)
    pursuit.aim(ARM.home + 0.1)
    outside = ARM.q_max + 0.1
    with pytest.raises(PlanError, match="leaves its limits"):
        pursuit.aim(outside)
    with pytest.raises(InvalidValueError, match="q_goal"):
        pursuit.aim(np.full(ARM.n, np.nan))
    assert pursuit.goal == pytest.approx(ARM.home + 0.1)
    for _ in range(3000):
        pursuit.step()
    assert pursuit.reference.q == pytest.approx(ARM.home + 0.1, abs=1e-12)
