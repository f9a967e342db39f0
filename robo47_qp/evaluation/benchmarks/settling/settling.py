"""Settling time: when an error has come to stay inside a band."""

from math import inf

import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import InvalidValueError

BAND = 0.02
"""The usual band: 2 % of the error at the start [-]."""
_FINEST = 20e-6
"""Least band after a disturbance; below is noise [m]."""
_LAST = 200
"""Periods at the end whose mean is the final position."""


def settling_time(errors: Vector, period: float, band: float = BAND) -> float:
    """The last time at which an error is outside the band; it stays inside from then on.

    The band is a fraction of the error at the start, after a step of the reference: the step
    itself (Ogata, Modern Control Engineering, 2010, sec. 5-3). Between the last sample outside
    and the next one, the error is taken as a straight line, so that the time is not rounded to
    the period and moves smoothly with the response.

    Args:
        errors: Size of the error at the instants 0, period, 2 period, ... (N,).
        period: Time between samples [s].
        band: Fraction of `errors[0]`, between 0 and 1.

    Returns:
        Time [s]; infinite where the error is outside the band at the end.

    Raises:
        InvalidValueError: Nothing to settle from, or numbers that are none.
    """
    wrong = int((~(np.isfinite(errors) & (errors >= 0.0))).sum())
    if errors.ndim != 1 or len(errors) < 2 or wrong:
        found = f"shape {errors.shape} with {wrong} numbers that are negative or not finite"
        raise InvalidValueError("errors", found, "two finite sizes or more")
    if errors[0] == 0.0:
        raise InvalidValueError("errors[0]", 0.0, "above 0: without it there is nothing to settle")
    if not (np.isfinite(period) and period > 0.0):
        raise InvalidValueError("period", period, "positive and finite [s]")
    if not 0.0 < band < 1.0:
        raise InvalidValueError("band", band, "between 0 and 1")
    limit = band * errors[0]
    last = int(np.flatnonzero(errors > limit)[-1])
    if last == len(errors) - 1:
        return inf
    outside, inside = errors[last], errors[last + 1]
    return float(period * (last + (outside - limit) / (outside - inside)))


def settling_after_disturbance(errors: Matrix, moving: int, onset: int, periods: int) -> float:
    """Return the time from the end of a push, or of the motion, until the tool stays at rest.

    The band is 2 % of the largest distance from the final position, at least 20 µm. Without a
    push that shows in the error, the time counts from the end of the motion.

    Args:
        errors: Error of the tool position (N, 3) [m].
        moving: Control periods of the motion.
        onset: Row at which a push may begin.
        periods: Control periods that it may last.

    Returns:
        Time [s]; infinite if the tool is outside the band at the end.
    """
    away = np.linalg.norm(errors - errors[-_LAST:].mean(axis=0), axis=1)
    end = onset + periods
    pushed = away[end] > max(2 * away[onset], _FINEST)
    start = end if pushed else moving
    rest = away[start:]
    limit = max(BAND * rest.max(), _FINEST)
    if (rest <= limit).all():
        return 0.0
    # `settling_time` takes the band as a fraction of the first error.
    return max(0.0, settling_time(np.concatenate([[limit / BAND], rest]), TIMESTEP) - TIMESTEP)
