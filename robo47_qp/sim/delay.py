"""Delay: a signal as it arrives some time later."""

from collections import deque

import numpy as np

from robo47_qp.arrays import Span, Vector, ends
from robo47_qp.constants import TIMESTEP


class Delay:
    """A signal that is sampled once per control period, read as it was some time ago.

    Between two samples the signal is a straight line; for torques, which are constant in a
    period, that is the mean over the period of a command that changes within it. Where the delay
    is a range, it is drawn anew in every period, and what has arrived is never followed by
    something older.
    """

    def __init__(self, span: Span) -> None:
        """Set the delay up, without a signal.

        Args:
            span: The delay, or the range that it is drawn from in every period [s].
        """
        # Rounded, so that whole periods stay whole.
        self._low, self._high = (round(end / TIMESTEP, 6) for end in ends(span))
        self._late = self._low
        self._past: deque[Vector] = deque(maxlen=int(self._high) + 2)

    @property
    def varies(self) -> bool:
        """True where the delay is drawn anew in every period."""
        return self._low < self._high

    def start(self, value: Vector) -> Vector:
        """Begin with a signal that has had this value (k,) for ever, and return it."""
        self._past.extend(value.copy() for _ in range(int(self._high) + 2))
        self._late = self._low
        return value.copy()

    def sample(self, value: Vector, rng: np.random.Generator | None) -> Vector:
        """Add the value (k,) of this period, and return the one that arrives in it.

        Args:
            value: The signal now.
            rng: Source of the delays, where they vary.
        """
        self._past.appendleft(value.copy())
        if self.varies and rng is not None:
            self._late = min(float(rng.uniform(self._low, self._high)), self._late + 1.0)
        periods = int(self._late)
        part = self._late - periods
        newer = self._past[periods]
        return newer if not part else (1.0 - part) * newer + part * self._past[periods + 1]
