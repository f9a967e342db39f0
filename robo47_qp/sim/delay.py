"""Delay: a signal as it arrives some time later; and random numbers that are drawn ahead."""

from collections.abc import Callable

import numpy as np

from robo47_qp._core.library import Structure
from robo47_qp.arrays import Matrix, Span, Vector, ends
from robo47_qp.constants import TIMESTEP

AHEAD = 512
"""Periods for which random numbers are there, once they are prepared."""


class Draws:
    """Random numbers, one row a period, drawn ahead so that the compiled core can take them, too.

    The numbers of a generator do not depend on how many are drawn at once.
    """

    def __init__(self, width: int, draw: Callable[[tuple[int, int]], Matrix]) -> None:
        """Draw rows of `width` numbers with `draw`, which is given a shape."""
        self._draw, self._rows = draw, draw((2 * AHEAD, width))
        self._at = np.zeros(1, np.int64)

    def next(self) -> Vector:
        """Return the numbers of the next period (width,)."""
        if self._at[0] == len(self._rows):
            self.prepare()
        row: Vector = self._rows[self._at[0]]
        self._at += 1
        return row

    def prepare(self) -> None:
        """Have numbers for the next `AHEAD` periods."""
        left = len(self._rows) - int(self._at[0])
        if left < AHEAD:
            self._rows[:left] = self._rows[self._at[0] :].copy()
            self._rows[left:] = self._draw((len(self._rows) - left, self._rows.shape[1]))
            self._at[0] = 0

    def compiled(self) -> Structure:
        """Return the same for the compiled core, on the arrays of this object."""
        return Structure("r47_draws", width=self._rows.shape[1], rows=self._rows, at=self._at)


def moments(span: Span) -> tuple[float, float]:
    """Return mean and standard deviation of the delay of a `Delay` [s].

    Where the range is wider than a period, they are less than those of what is drawn. With U
    drawn evenly and L' = min(U, L + 1) in periods,

        P(L > x) = P(U > x) P(L > x - 1)

    so that it is a product of as many straight lines as there are periods below x in the range.
    """
    low, high = _periods(span)
    width, (at, weights) = high - low, np.polynomial.legendre.leggauss(32)
    mean = square = 0.0
    for first in range(int(np.ceil(width))):
        half = 0.5 * (min(first + 1.0, width) - first)
        x = first + half * (1.0 + at)
        beyond = np.prod([1.0 - (x - k) / width for k in range(first + 1)], axis=0)
        mean += half * float(weights @ beyond)
        square += half * float(weights @ (2.0 * x * beyond))
    # Rounded, so that halves stay halves.
    return round(low + mean, 9) * TIMESTEP, float(np.sqrt(square - mean**2)) * TIMESTEP


def _periods(span: Span) -> tuple[float, float]:
    """Return a range in periods, rounded so that whole periods stay whole."""
    low, high = (round(end / TIMESTEP, 6) for end in ends(span))
    return low, high


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
        self._low, self._high = _periods(span)
        self._late, self._newest = np.zeros(1), np.zeros(1, np.int64)
        self._past: Matrix = np.zeros((int(self._high) + 2, 0))
        self._drawn: Draws | None = None

    @property
    def varies(self) -> bool:
        """True where the delay is drawn anew in every period."""
        return self._low < self._high

    def start(self, value: Vector, rng: np.random.Generator | None) -> Vector:
        """Begin with a signal that has had this value (k,) for ever, and return it.

        Args:
            value: The signal now.
            rng: Source of the delays, where they vary.
        """
        self._past = np.tile(value, (len(self._past), 1))
        self._late[0], self._newest[0] = self._low, 0
        self._drawn = None
        if self.varies and rng is not None:
            low, high = self._low, self._high
            self._drawn = Draws(1, lambda shape: rng.uniform(low, high, shape))
        return value.copy()

    def sample(self, value: Vector) -> Vector:
        """Add the value (k,) of this period, and return the one that arrives in it."""
        past, newest = self._past, int(self._newest[0] - 1) % len(self._past)
        past[newest], self._newest[0] = value, newest
        if self._drawn is not None:
            self._late[0] = min(float(self._drawn.next()[0]), self._late[0] + 1.0)
        periods = int(self._late[0])
        part = self._late[0] - periods
        newer: Vector = past[(newest + periods) % len(past)]
        if not part:
            return newer.copy()
        older = past[(newest + periods + 1) % len(past)]
        arrived: Vector = (1.0 - part) * newer + part * older
        return arrived

    def prepare(self) -> None:
        """Have delays for the next periods; see `Draws`."""
        if self._drawn is not None:
            self._drawn.prepare()

    def compiled(self) -> Structure:
        """Return the same for the compiled core, on the arrays of this object since `start`."""
        drawn = {} if self._drawn is None else {"drawn": self._drawn.compiled()}
        return Structure(
            "r47_delay",
            k=self._past.shape[1],
            length=len(self._past),
            past=self._past,
            newest=self._newest,
            late=self._late,
            **drawn,
        )
