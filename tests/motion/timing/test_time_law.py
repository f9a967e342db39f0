import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo47_qp.errors import InvalidValueError
from robo47_qp.model.robot import MotionProfile
from robo47_qp.motion.timing.lower_bound import least_time
from robo47_qp.motion.timing.rest_to_rest import (
    Cubic,
    Quintic,
    SCurve,
    TimeLaw,
    Trapezoid,
    plan_ptp,
)

DT = 1e-3
LAWS: list[TimeLaw] = [SCurve(), Trapezoid(), Cubic(), Quintic()]
every_law = pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
lengths, speeds = st.floats(1e-3, 3.0), st.floats(0.1, 3.0)
accelerations, jerks = st.floats(0.5, 9.0), st.floats(2.0, 99.0)


@every_law
@given(length=lengths, v=speeds, a=accelerations, j=jerks)
def test_a_law_keeps_its_bounds_and_ends_where_asked(
    law: TimeLaw, length: float, v: float, a: float, j: float
) -> None:
    s, ds, dds = law.run(length, np.array([v, a, j]), DT).T
    assert (s[0], ds[0], dds[0]) == (0.0, 0.0, 0.0)
    assert (s[-1], ds[-1], dds[-1]) == (length, 0.0, 0.0)
    # Differences of the positions alone: means of what they stand for.
    padded = np.concatenate([[0.0] * 3, s, [length] * 3])
    bounds = (v, a, j) if law.bounds_jerk else (v, a)
    for order, bound in enumerate(bounds, start=1):
        rate = np.abs(np.diff(padded, order)) / DT**order
        assert rate.max() <= bound * (1 + 1e-6) + 3e-15 * 2**order / DT**order
    assert (ds <= v * (1 + 1e-9)).all()
    assert (np.abs(dds) <= a * (1 + 1e-9)).all()
    # Their own rates are those of the positions, but for the jumps at corners and ends.
    assert np.abs(np.diff(s) - 0.5 * DT * (ds[1:] + ds[:-1])).max() <= a * DT**2
    np.testing.assert_allclose(s, length - s[::-1], rtol=0.0, atol=max(1e-9, v * DT * 1e-3))


@given(length=lengths, v=speeds, a=accelerations, j=jerks)
def test_durations_are_those_of_the_formulas_up_to_whole_periods(
    length: float, v: float, a: float, j: float
) -> None:
    bounds = np.array([v, a, j])
    expected = {
        "SCurve": least_time(length, v, a, j),
        "Trapezoid": length / v + v / a if length > v**2 / a else 2 * np.sqrt(length / a),
        "Cubic": max(1.5 * length / v, np.sqrt(6 * length / a)),
        # Peaks of the polynomial found on a grid.
        "Quintic": quintic_time(length, v, a, j),
    }
    for law in LAWS:
        duration = DT * (len(law.run(length, bounds, DT)) - 1)
        best = expected[type(law).__name__]
        assert best * (1 - 1e-5) - 1e-9 <= duration <= best * (1 + 1e-5) + DT + 1e-9


def quintic_time(length: float, v: float, a: float, j: float) -> float:
    x = np.linspace(0.0, 1.0, 2001)
    first = 30 * x**2 - 60 * x**3 + 30 * x**4
    second = 60 * x - 180 * x**2 + 120 * x**3
    third = 60 - 360 * x + 360 * x**2
    peaks = [length * np.abs(rate).max() for rate in (first, second, third)]
    return float(max(peaks[0] / v, np.sqrt(peaks[1] / a), np.cbrt(peaks[2] / j)))


def test_only_jerk_limited_laws_bound_the_jerk() -> None:
    bounds, jumps = np.array([1.0, 3.0, 10.0]), {}
    for law in LAWS:
        dds = law.run(1.0, bounds, DT)[:, 2]
        jumps[type(law).__name__] = np.abs(np.diff(dds)).max() / DT
        assert law.bounds_jerk == (jumps[type(law).__name__] < 10.001)
    assert min(jumps["Trapezoid"], jumps["Cubic"]) > 1000.0


@every_law
def test_a_ptp_motion_runs_the_same_line_under_any_law(law: TimeLaw) -> None:
    start, goal = np.array([0.1, -0.4, 0.3]), np.array([0.7, 0.2, 0.3])
    profile = MotionProfile.uniform(3, v=1.0, a=3.0, j=10.0)
    plan = plan_ptp(start, goal, profile, DT, law)
    assert plan.q[0].tolist() == start.tolist()
    assert plan.q[-1].tolist() == goal.tolist()
    way = (goal - start) / np.linalg.norm(goal - start)
    along = (plan.q - start) @ way
    assert np.abs(plan.q - start - along[:, None] * way).max() < 1e-12


@every_law
@pytest.mark.parametrize(
    ("length", "bounds", "name"),
    [
        (np.nan, (1, 1, 1), "position|length"),
        (1.0, (0, 1, 1), "velocity"),
        (1.0, (1, -1, 1), "acceleration"),
        (1.0, (1, 1, np.nan), "jerk"),
    ],
)
def test_numbers_that_are_none_are_refused(
    law: TimeLaw, length: float, bounds: tuple[float, ...], name: str
) -> None:
    with pytest.raises(InvalidValueError, match=name):
        law.run(length, np.array(bounds, dtype=float), DT)
