"""Smoothness: a minimum-jerk motion has a known figure, and nothing else moves it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo47_qp.arrays import Matrix
from robo47_qp.report.metrics import smoothness

WAY = np.array([0.3, -0.2, 0.6])
BEST = -np.log(720 / 1.875**2)


def minimum_jerk(length: float, duration: float, count: int) -> tuple[Matrix, Matrix, float]:
    """Velocity and jerk of x = D (10 s³ - 15 s⁴ + 6 s⁵) (Flash and Hogan, 1985)."""
    period = duration / count
    s = ((np.arange(count) + 0.5) / count)[:, None]
    v = length / duration * (30 * s**2 - 60 * s**3 + 30 * s**4)
    jerk = length / duration**3 * (60 - 360 * s + 360 * s**2)
    along = WAY / np.linalg.norm(WAY)
    return v * along, jerk * along, period


@given(st.floats(0.01, 5.0), st.floats(0.05, 20.0))
def test_it_knows_neither_way_nor_time(length: float, duration: float) -> None:
    v, jerk, period = minimum_jerk(length, duration, 2000)
    if length / duration < 1e-3:
        return
    assert smoothness(v, jerk, period) == pytest.approx(BEST, abs=1e-5)
    assert abs(BEST + 5.32) < 5e-3


def test_shivering_is_less_smooth() -> None:
    v, jerk, period = minimum_jerk(0.3, 1.0, 1000)
    rough = jerk + 10.0 * np.sin(np.arange(1000))[:, None]
    worse = smoothness(v, rough, period)
    assert worse is not None
    assert worse < BEST - 0.3


def test_what_does_not_move_has_none() -> None:
    assert smoothness(np.zeros((5, 3)), np.ones((5, 3)), 1e-3) is None
    assert smoothness(np.zeros((0, 3)), np.zeros((0, 3)), 1e-3) is None
