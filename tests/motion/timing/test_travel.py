import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.motion.timing.lower_bound import least_time
from robo47_qp.motion.timing.retiming import SectionedProfile

DT = 1e-3
section = st.tuples(
    st.floats(0.01, 0.5), st.floats(0.05, 2.0), st.floats(0.2, 5.0), st.floats(1.0, 50.0)
)


def planned(sections: list[tuple[float, ...]]) -> tuple[SectionedProfile, Vector, Matrix]:
    lengths, bounds = np.array([s[0] for s in sections]), np.array([s[1:] for s in sections])
    return SectionedProfile(lengths, bounds), lengths, bounds


@given(sections=st.lists(section, min_size=1, max_size=5))
def test_every_section_keeps_its_bounds(sections: list[tuple[float, ...]]) -> None:
    travel, lengths, bounds = planned(sections)
    s, v, a = travel.sampled(DT).T
    assert (s[0], v[0], a[0]) == (0.0, 0.0, 0.0)
    assert (s[-1], v[-1], a[-1]) == (pytest.approx(lengths.sum()), 0.0, 0.0)
    assert (np.diff(s) >= -1e-12).all()
    ends = np.cumsum(lengths)
    k = np.minimum(np.searchsorted(ends, s), len(lengths) - 1)
    assert (v <= bounds[k, 0] * (1 + 1e-6)).all()
    assert (np.abs(a) <= bounds[k, 1] * (1 + 1e-6)).all()
    most = np.maximum(bounds[k[1:], 2], bounds[k[:-1], 2])
    assert (np.abs(np.diff(a)) / DT <= most * (1 + 1e-6)).all()
    # Positions, speeds and accelerations belong together.
    assert np.abs(np.diff(s) - 0.5 * DT * (v[1:] + v[:-1])).max() <= bounds[:, 2].max() * DT**3
    assert np.abs(np.diff(v) - 0.5 * DT * (a[1:] + a[:-1])).max() <= bounds[:, 2].max() * DT**2


@given(
    length=st.floats(1e-3, 3.0), v=st.floats(0.05, 2.0), a=st.floats(0.2, 5.0), j=st.floats(1, 99)
)
def test_one_section_takes_the_least_time(length: float, v: float, a: float, j: float) -> None:
    travel = SectionedProfile(np.array([length]), np.array([[v, a, j]]))
    assert travel.duration == pytest.approx(least_time(length, v, a, j), rel=1e-6)


def test_a_slow_section_is_entered_and_left_at_its_own_speed() -> None:
    travel, lengths, _ = planned(
        [(1.0, 1.0, 3.0, 30.0), (0.1, 0.2, 3.0, 30.0), (1.0, 1.0, 3.0, 30.0)]
    )
    s, v, _ = travel.sampled(DT).T
    inside = (s >= lengths[0]) & (s <= lengths[0] + lengths[1])
    assert v[inside] == pytest.approx(np.full(inside.sum(), 0.2), abs=1e-4)
    assert v.max() == pytest.approx(1.0, abs=1e-3)


def test_a_section_too_short_to_brake_in_is_entered_slowly() -> None:
    travel, lengths, _ = planned([(1.0, 2.0, 3.0, 30.0), (0.01, 2.0, 0.5, 5.0)])
    s, v, _ = travel.sampled(DT).T
    entry = float(np.interp(lengths[0], s, v))
    # Braking from it takes just the section: ½ v T, T = 2 √(v / j).
    assert entry * np.sqrt(entry / 5.0) == pytest.approx(0.01, rel=0.05)


def brute(distance: float, v: float, a: float, j: float) -> float:
    """Time to cover half the way, by small steps of the jerk-limited rise; no formula."""
    best = np.inf
    for peak in np.linspace(1e-3, v, 4000):
        top = min(a, np.sqrt(peak * j))
        rise = peak / top + top / j
        coast = distance - peak * rise
        if coast >= 0.0:
            best = min(best, 2 * rise + coast / peak)
    return best


@pytest.mark.parametrize("distance", [0.001, 0.02, 0.3, 2.0])
def test_the_least_time_is_the_best_over_peak_speeds(distance: float) -> None:
    for v, a, j in ((1.0, 2.0, 10.0), (0.2, 5.0, 3.0), (2.0, 0.5, 90.0)):
        assert least_time(distance, v, a, j) == pytest.approx(brute(distance, v, a, j), rel=5e-3)


def test_without_a_bound_on_the_jerk_it_is_the_trapezoid() -> None:
    assert least_time(2.0, 1.0, 2.0, np.inf) == pytest.approx(2.0 + 0.5)
    assert least_time(0.1, 1.0, 2.0, np.inf) == pytest.approx(2 * np.sqrt(0.1 / 2.0))
    assert least_time(0.0, 1.0, 2.0, 3.0) == 0.0
