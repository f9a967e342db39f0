import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo47_qp.errors import InvalidValueError
from robo47_qp.motion.timing.state_to_state import speed_change, to_rest, to_state


@given(seed=st.integers(0, 10_000), zero=st.sampled_from([[], [1], [2], [1, 2]]))
def test_how_far_a_motion_reaches_is_what_its_samples_tell(seed: int, zero: list[int]) -> None:
    """Also from a speed of exactly zero with an acceleration, where it turns within a phase."""
    rng = np.random.default_rng(seed)
    start = rng.uniform(-2.0, 2.0, (3, 3))
    start[zero, 0] = 0.0
    goal = np.stack([rng.uniform(-2.0, 2.0, 3), np.zeros(3), np.zeros(3)])
    v_max, a_max, j_max = (rng.uniform(low, 4 * low, 3) for low in (0.4, 1.0, 4.0))
    for motion in (to_rest(start, a_max, j_max), to_state(start, goal, v_max, a_max, j_max)):
        times = np.linspace(0.0, motion.duration, 400)
        x = np.array([motion.at(t)[0] for t in times])
        least, most = motion.reach
        assert (least <= x.min(axis=0) + 1e-9).all()
        assert (most >= x.max(axis=0) - 1e-9).all()
        near = 20.0 * times[1] ** 2
        assert (least >= x.min(axis=0) - near).all()
        assert (most <= x.max(axis=0) + near).all()


@given(seed=st.integers(0, 10_000))
def test_many_instants_at_once_are_those_one_by_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    v0, v1 = rng.uniform(0.0, 0.5, 2)
    motion = speed_change(
        rng.uniform(0.5, 3.0), v0, v1, rng.uniform((0.5, 1.0, 4.0), (2.0, 4.0, 40.0))
    )
    times = np.sort(rng.uniform(0.0, motion.duration, 50))
    times[0], times[-1] = 0.0, motion.duration
    one_by_one = np.array([motion.at(float(t)) for t in times])
    assert np.abs(motion.along(times) - one_by_one).max() < 1e-9


def test_a_start_at_the_bound_itself_is_planned() -> None:
    bounds = np.array([0.1665843094236507, 0.1091799194344632, 0.3287840767461138])
    length, v_goal = 0.01641251337663796, 0.1657826222307234
    start, goal = np.array([[0.0], [bounds[0]], [0.0]]), np.array([[length], [v_goal], [0.0]])
    with pytest.raises(InvalidValueError, match="Ruckig can plan"):
        to_state(start, goal, *bounds[:, None])
    motion = speed_change(length, bounds[0], v_goal, bounds)
    end = motion.at(motion.duration)
    assert end == pytest.approx(np.array([length, v_goal, 0.0]), abs=1e-12)
    speeds = [motion.at(t)[1] for t in np.linspace(0.0, motion.duration, 1000)]
    assert max(speeds) <= bounds[0] * (1.0 + 1e-9)
    assert motion.duration < 1.01 * length / v_goal
