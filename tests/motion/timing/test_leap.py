import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from robo47_qp.motion.timing.state_to_state import speed_change, to_rest, to_state


@given(seed=st.integers(0, 10_000), still=st.booleans())
def test_how_far_a_motion_reaches_is_what_its_samples_tell(seed: int, still: bool) -> None:
    rng = np.random.default_rng(seed)
    start = rng.uniform(-2.0, 2.0, (3, 3))
    start[1:, 0] *= float(not still)
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
