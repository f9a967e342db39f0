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
    """Receives a recording while it is made."""

    def write(self, rows: "Rows") -> None:
        """Receive the next rows, which are final.

        Raises:
            RecordingError: The rows cannot be written.
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
        """Return the number of rows."""
        return len(self.values)

    def __getitem__(self, name: str) -> Matrix:
        """Return a view of the columns of a signal, (rows, columns).

        Raises:
            UnknownNameError: No signal has this name.
        """
        if name not in self._slices:
            raise UnknownNameError("signal", name, self._slices)
        return self.values[:, self._slices[name]]


def slices(signals: Iterable[Signal]) -> dict[str, slice]:
    """Return the columns of each signal by its name."""
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
            chunk_rows: Rows that go to the sinks at once; a killed run loses at most as many.
            sinks: Receive the chunks.
        """
        self.signals = tuple(signals)
        self._width = sum(len(signal.labels) for signal in signals)
        self._chunk_rows = chunk_rows
        self.sinks = tuple(sinks)
        self._chunks: list[Matrix] = []
        self._chunk = self._empty()
        self._filled = 0

    def __len__(self) -> int:
        """Return the number of closed rows."""
        return len(self._chunks) * self._chunk_rows + self._filled

    @property
    def room(self) -> int:
        """Number of rows that can be opened at once."""
        return self._chunk_rows - self._filled

    def open_rows(self, count: int) -> Matrix:
        """Return a view of the next rows to fill, (count, columns); count <= room."""
        return self._chunk[self._filled : self._filled + count]

    def close_rows(self, count: int) -> None:
        """Add the rows that were filled; a full chunk goes to the sinks.

        Raises:
            RecordingError: A sink could not write them.
        """
        self._filled += count
        if self._filled == self._chunk_rows:
            full, self._chunk, self._filled = self._chunk, self._empty(), 0
            self._chunks.append(full)
            self._hand_on(full)

    def flush(self) -> None:
        """Send the rows of an unfinished chunk to the sinks; call once, at the end.

        Raises:
            RecordingError: A sink could not write them.
        """
        if self._filled:
            self._hand_on(self._chunk[: self._filled])

    def rows(self) -> Rows:
        """Return a copy of all closed rows."""
        return Rows(self.signals, np.concatenate([*self._chunks, self._chunk[: self._filled]]))

    def _hand_on(self, values: Matrix) -> None:
        for sink in self.sinks:
            sink.write(Rows(self.signals, values))

    def _empty(self) -> Matrix:
        return np.zeros((self._chunk_rows, self._width))
