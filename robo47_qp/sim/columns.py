"""Columns: the joints' share of an array of MjData, in one piece or in several."""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise

import numpy as np

from robo47_qp.arrays import Vector


def spans(places: Sequence[int]) -> list[slice]:
    """Return the pieces of consecutive places, in their order."""
    breaks = [i for i, (a, b) in enumerate(pairwise(places), start=1) if b != a + 1]
    ends = [0, *breaks, len(places)]
    return [slice(places[a], places[b - 1] + 1) for a, b in pairwise(ends)]


class Columns:
    """Reads and writes some places of an array that keeps its place in memory."""

    def __init__(self, array: Vector, pieces: Sequence[slice]) -> None:
        """Take the views of the pieces."""
        self.views = tuple(array[piece] for piece in pieces)
        """One view per piece."""
        one = len(self.views) == 1
        self.read: Callable[[], Vector] = (
            self.views[0].copy if one else partial(np.concatenate, self.views)
        )
        """Return a copy of the numbers in one array."""
        self.whole: Vector = self.views[0] if one else np.concatenate(self.views)
        """The numbers in one array to write to, which `flush` brings to their places."""
        self._apart = () if one else tuple(self._parts())

    def write(self, values: Vector) -> None:
        """Set the numbers."""
        self.whole[:] = values
        self.flush()

    def flush(self) -> None:
        """Bring what was written into `whole` to its places."""
        for view, part in self._apart:
            view[:] = part

    def _parts(self) -> list[tuple[Vector, Vector]]:
        """Return each view with its part of `whole`."""
        ends = np.cumsum([0, *(len(view) for view in self.views)]).tolist()
        return [
            (view, self.whole[a:b]) for view, (a, b) in zip(self.views, pairwise(ends), strict=True)
        ]
