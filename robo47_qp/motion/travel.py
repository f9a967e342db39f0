"""Travel: along a path of sections, each with its own bounds, from rest to rest."""

from collections.abc import Sequence
from math import ceil, sqrt

import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.motion.leap import Leap, leap

_HALVINGS = 60
_CAREFUL = 1.0 - 1e-6
"""A way that is just long enough is, by a rounding error, too short: then the only motion between
the two speeds goes back and forth."""


class Travel:
    """A path parameter over time: speed, acceleration and jerk bounded section by section.

    Between sections the acceleration is zero and the speed the largest that both allow and
    that can be reached from the ends: passes forward and backward over the sections, as in
    time-optimal control along paths (Bobrow, Dubowsky and Gibson, 1985), here with bounded
    jerk. Within a section it is time-optimal.
    """

    def __init__(self, lengths: Vector, bounds: Matrix) -> None:
        """Plan it.

        Args:
            lengths: Of the K sections (K,), positive.
            bounds: Speed, acceleration and jerk in each (K, 3), positive.
        """
        speeds = np.concatenate([[0.0], np.minimum(bounds[:-1, 0], bounds[1:, 0]), [0.0]])
        for k in range(len(lengths)):
            most = _reachable(speeds[k], lengths[k], *bounds[k, 1:])
            speeds[k + 1] = min(speeds[k + 1], most)
        for k in reversed(range(len(lengths))):
            most = _reachable(speeds[k + 1], lengths[k], *bounds[k, 1:])
            speeds[k] = min(speeds[k], most)
        self._starts = np.concatenate([[0.0], np.cumsum(lengths)])
        self._leaps: Sequence[Leap] = [
            leap(float(length), float(v0), float(v1), bound)
            for length, v0, v1, bound in zip(lengths, speeds[:-1], speeds[1:], bounds, strict=True)
        ]
        self._times = np.concatenate([[0.0], np.cumsum([one.duration for one in self._leaps])])

    @property
    def duration(self) -> float:
        """[s]."""
        return float(self._times[-1])

    def sampled(self, dt: float) -> Matrix:
        """Parameter and its first two derivatives every dt (N + 1, 3).

        Time is stretched to a whole number of periods, which no bound minds.
        """
        periods = max(1, ceil(self.duration / dt - 1e-9))
        pace = self.duration / (periods * dt)
        t = np.minimum(np.arange(periods + 1) * dt * pace, self.duration)
        section = np.clip(
            np.searchsorted(self._times, t, side="right") - 1, 0, len(self._leaps) - 1
        )
        rows = np.empty((periods + 1, 3))
        for k in np.unique(section).tolist():
            mine = section == k
            rows[mine] = self._leaps[k].along(t[mine] - self._times[k])
            rows[mine, 0] += self._starts[k]
        rows[-1] = self._starts[-1], 0.0, 0.0
        return rows * pace ** np.arange(3)


def _reachable(v: float, length: float, a_max: float, j_max: float) -> float:
    """Largest speed after a way that starts at speed v, without acceleration at both ends."""

    def way(rise: float) -> float:
        fast = rise > a_max**2 / j_max
        time = rise / a_max + a_max / j_max if fast else 2.0 * sqrt(rise / j_max)
        return (v + 0.5 * rise) * time

    low, high = 0.0, a_max
    while way(high) < length:
        high *= 2.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if way(middle) <= length else (low, middle)
    return v + low * _CAREFUL
