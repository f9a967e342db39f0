"""When a tool that was disturbed has come to rest again."""

import numpy as np

from robo47_qp.arrays import Matrix
from robo47_qp.constants import TIMESTEP
from robo47_qp.evaluation.benchmarks.settling.settling import BAND, settling_time

_FINEST = 20e-6
"""Narrower bands would measure noise [m]."""
_LAST = 200
"""Periods at the end whose mean counts as the place of rest."""


def settled_after(errors: Matrix, moving: int, onset: int, periods: int) -> float:
    """Time from the end of a push, or of the motion, until the tool stays at its last place.

    The band is 2 % of the largest distance from that place, and no less than 20 µm. Without a
    push that is seen, the time counts from the end of the motion.

    Args:
        errors: Tool from its reference (N, 3) [m].
        moving: Periods of the motion.
        onset: Row at which a push may begin.
        periods: How long it may last.

    Returns:
        Time [s]; infinite where the tool is outside the band at the end.
    """
    away = np.linalg.norm(errors - errors[-_LAST:].mean(axis=0), axis=1)
    end = onset + periods
    pushed = away[end] > max(2 * away[onset], _FINEST)
    start = end if pushed else moving
    rest = away[start:]
    limit = max(BAND * rest.max(), _FINEST)
    if (rest <= limit).all():
        return 0.0
    # The band is a fraction of what is first: the limit stands in front.
    return max(0.0, settling_time(np.concatenate([[limit / BAND], rest]), TIMESTEP) - TIMESTEP)
