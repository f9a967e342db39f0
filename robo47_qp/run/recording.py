"""Recording: every signal at the control rate, in preallocated columns.

Row k belongs to the instant t_k at which a control period starts. Its state, tool, object
and gripper signals are those of t_k; its references are those for t_k; its torques,
accelerations and contact forces are those of the period from t_k to t_k+1.
"""

from collections.abc import Iterable, Sequence
from typing import Protocol

import numpy as np

from robo47_qp.arrays import Matrix
from robo47_qp.errors import UnknownNameError
from robo47_qp.sim.signal import Signal


class Sink(Protocol):
    """Takes a recording as it grows."""

    def write(self, rows: "Rows") -> None:
        """Take the next rows; they do not change any more.

        Raises:
            RecordingError: The rows cannot be kept.
        """
        ...


class Rows:
    """A block of rows of all signals."""

    def __init__(self, signals: Sequence[Signal], values: Matrix) -> None:
        """Wrap `values` of shape (rows, total number of columns)."""
        self.signals = tuple(signals)
        self.values = values
        self._slices = slices(signals)

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.values)

    def __getitem__(self, name: str) -> Matrix:
        """Columns of one signal, shape (rows, columns): a view.

        Raises:
            UnknownNameError: No signal has this name.
        """
        if name not in self._slices:
            raise UnknownNameError("signal", name, self._slices)
        return self.values[:, self._slices[name]]


def slices(signals: Iterable[Signal]) -> dict[str, slice]:
    """Where each signal's columns are."""
    found, start = {}, 0
    for signal in signals:
        found[signal.name] = slice(start, start + len(signal.labels))
        start += len(signal.labels)
    return found


class Recording:
    """Rows in the order of time, kept in memory and handed to sinks in chunks.

    A writer fills `open_rows(count)` and calls `close_rows(count)`.
    """

    def __init__(
        self, signals: Sequence[Signal], chunk_rows: int = 400, sinks: Sequence[Sink] = ()
    ) -> None:
        """Prepare the columns.

        Args:
            signals: The columns, in order.
            chunk_rows: Rows that are handed on at once; a run that is killed loses no more.
            sinks: See `sinks`.
        """
        self.signals = tuple(signals)
        self._width = sum(len(signal.labels) for signal in signals)
        self._chunk_rows = chunk_rows
        self.sinks = tuple(sinks)
        """Who gets the chunks."""
        self._chunks: list[Matrix] = []
        self._chunk = self._empty()
        self._filled = 0

    def __len__(self) -> int:
        """Number of rows that are closed."""
        return len(self._chunks) * self._chunk_rows + self._filled

    @property
    def room(self) -> int:
        """Rows that can be opened at once."""
        return self._chunk_rows - self._filled

    def open_rows(self, count: int) -> Matrix:
        """The next rows to fill, shape (count, columns), a view; count <= room."""
        return self._chunk[self._filled : self._filled + count]

    def close_rows(self, count: int) -> None:
        """Add the rows that were filled; a full chunk goes to the sinks.

        Raises:
            RecordingError: A sink could not keep them.
        """
        self._filled += count
        if self._filled == self._chunk_rows:
            full, self._chunk, self._filled = self._chunk, self._empty(), 0
            self._chunks.append(full)
            self._hand_on(full)

    def flush(self) -> None:
        """Hand the rows of an unfinished chunk to the sinks; call once, at the end.

        Raises:
            RecordingError: A sink could not keep them.
        """
        if self._filled:
            self._hand_on(self._chunk[: self._filled])

    def rows(self) -> Rows:
        """All closed rows, copied together."""
        return Rows(self.signals, np.concatenate([*self._chunks, self._chunk[: self._filled]]))

    def _hand_on(self, values: Matrix) -> None:
        for sink in self.sinks:
            sink.write(Rows(self.signals, values))

    def _empty(self) -> Matrix:
        return np.zeros((self._chunk_rows, self._width))
