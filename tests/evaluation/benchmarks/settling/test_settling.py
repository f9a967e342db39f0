"""Settling time: judged by responses whose settling time is known in closed form."""

from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.special import lambertw

from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.benchmarks.settling.settling import settling_time

DT = 1e-3


def second_order(t: Vector, omega: float, zeta: float) -> Vector:
    """Error of x'' + 2 ζ ω x' + ω² x = 0 from x = 1 at rest, ζ < 1."""
    damped = omega * np.sqrt(1.0 - zeta**2)
    swing = np.cos(damped * t) + zeta * omega / damped * np.sin(damped * t)
    response: Vector = np.exp(-zeta * omega * t) * swing
    return response


@pytest.mark.parametrize("band", [0.02, 0.05])
def test_a_first_order_lag_settles_after_a_logarithm(band: float) -> None:
    t = np.arange(0.0, 3.0, DT)
    for tau in (0.05, 0.3):
        time = settling_time(0.7 * np.exp(-t / tau), DT, band)
        assert time == pytest.approx(tau * np.log(1.0 / band), abs=5e-6)


def test_a_critically_damped_system_settles_where_lambert_says() -> None:
    # (1 + ω t) exp(-ω t) = b  <=>  ω t = -1 - W₋₁(-b / e), 5.834 for 2 %
    omega, t = 20.0, np.arange(0.0, 2.0, DT)
    exact = (-1.0 - lambertw(-0.02 / np.e, -1).real) / omega
    assert exact * omega == pytest.approx(5.8339, abs=1e-4)
    assert settling_time((1 + omega * t) * np.exp(-omega * t), DT) == pytest.approx(exact, abs=5e-6)


@pytest.mark.parametrize("zeta", [0.1, 0.3, 0.5, 0.7, 0.79])
def test_a_ringing_system_settles_at_its_last_crossing(zeta: float) -> None:
    omega, t = 12.0, np.arange(0.0, 8.0, DT)
    time = settling_time(np.abs(second_order(t, omega, zeta)), DT)
    # The extremes lie half a period apart; the last one outside leads to the last crossing.
    half = np.pi / (omega * np.sqrt(1.0 - zeta**2))
    peaks = half * np.arange(60)
    outside = np.flatnonzero(np.abs(second_order(peaks, omega, zeta)) > 0.02)[-1]

    def beyond(at: float) -> float:
        return float(abs(second_order(np.array([at]), omega, zeta)[0]) - 0.02)

    # Between an extreme and the next zero the error only falls.
    fine = np.linspace(peaks[outside], peaks[outside + 1], 4001)
    zero = fine[np.argmin(np.abs(second_order(fine, omega, zeta)))]
    assert time == pytest.approx(brentq(beyond, peaks[outside], zero), abs=1e-5)


@given(scale=st.floats(1e-6, 1e6), period=st.floats(1e-4, 10.0))
def test_neither_the_size_nor_the_unit_of_time_matters(scale: float, period: float) -> None:
    errors = np.array([1.0, 0.5, 0.011, 0.2, 0.03, 0.01, 0.0, 0.019])
    assert settling_time(errors, 1.0) == pytest.approx(4.5)
    assert settling_time(scale * errors, period) == pytest.approx(4.5 * period)


def test_only_the_last_time_outside_counts() -> None:
    errors = np.array([1.0, 0.0, 0.0, 0.04, 0.0, 0.0])
    assert settling_time(errors, 0.1) == pytest.approx(0.35)
    assert settling_time(errors, 0.1, 0.05) == pytest.approx(0.095)


def test_the_band_is_that_of_the_start_and_not_of_the_largest_error() -> None:
    assert settling_time(np.array([1.0, 5.0, 0.04, 0.0, 0.0]), 1.0) == pytest.approx(2.5)


def test_on_the_band_is_inside() -> None:
    assert settling_time(np.array([1.0, 0.5, 0.5]), 1.0, 0.5) == pytest.approx(1.0)


@pytest.mark.parametrize("tail", [[0.021], [0.0, 0.0, 0.5]])
def test_outside_at_the_end_is_never(tail: list[float]) -> None:
    assert settling_time(np.array([1.0, *tail]), DT) == inf


@pytest.mark.parametrize(
    ("errors", "period", "band", "message"),
    [
        ([1.0, np.nan], DT, 0.02, "errors must be two finite sizes or more; found.* 1 numbers"),
        ([1.0, np.inf, np.inf], DT, 0.02, "2 numbers"),
        ([1.0, -0.5], DT, 0.02, "1 numbers that are negative"),
        ([1.0], DT, 0.02, "shape \\(1,\\)"),
        ([[1.0, 0.0]] * 2, DT, 0.02, "shape \\(2, 2\\)"),
        ([0.0, 0.0], DT, 0.02, "errors\\[0\\] must be above 0"),
        ([1.0, 0.0], 0.0, 0.02, "period must be positive"),
        ([1.0, 0.0], np.nan, 0.02, "period must be positive"),
        ([1.0, 0.0], DT, 1.0, "band must be between 0 and 1"),
        ([1.0, 0.0], DT, 0.0, "band must be between 0 and 1"),
    ],
)
def test_what_cannot_settle_is_told(
    errors: list[float], period: float, band: float, message: str
) -> None:
    with pytest.raises(InvalidValueError, match=message):
        settling_time(np.array(errors), period, band)
