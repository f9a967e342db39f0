"""Recording: every signal at the control rate, in preallocated columns.

Row k belongs to the instant t_k at which a control period starts. Its state, tool, object
and gripper signals are those of t_k; its references are those for t_k; its torques,
accelerations and contact forces are those of the period from t_k to t_k+1.
"""

import mmap
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

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


class Store(Protocol):
    """Where a recording keeps its rows."""

    def block(self, rows: int) -> "tuple[Matrix, NDArray[np.int64]]":
        """Return zeros (rows, columns), and a count (1,) of the rows that were filled.

        Raises:
            RecordingError: There is no room for them.
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


_CHUNKS = 15
"""Chunks in a piece of memory: a minute."""
CHUNK_ROWS = 4000
"""Rows that go to the sinks at once, unless asked otherwise: a row costs a Rerun file a third less
than in chunks of 400."""


class Recording:
    """Rows in the order of time, kept in memory or in a store and handed to sinks in chunks.

    A writer opens rows, adds one to `count` whenever one of them is filled, and calls `close_rows`.
    """

    _chunk: Matrix
    _count: NDArray[np.int64]
    _closed: int
    _handed_on: int

    def __init__(
        self, signals: Sequence[Signal], chunk_rows: int = CHUNK_ROWS, sinks: Sequence[Sink] = ()
    ) -> None:
        """Prepare the columns.

        Args:
            signals: The columns, in order.
            chunk_rows: Rows that go to the sinks at once.
            sinks: Receive the chunks.
        """
        self.signals = tuple(signals)
        self._width = sum(len(signal.labels) for signal in signals)
        self.chunk_rows = chunk_rows
        self.sinks = tuple(sinks)
        self.store: Store = _Memory(self._width)
        """Where the next chunks are kept."""
        self._full: list[Matrix] = []
        self._before = 0
        self._begin_chunk()

    def __len__(self) -> int:
        """Return the number of closed rows."""
        return self._before + self._closed

    @property
    def room(self) -> int:
        """Number of rows that can be opened at once."""
        return (len(self._chunk) or self.chunk_rows) - self._closed

    def open_rows(self, count: int) -> Matrix:
        """Return a view of the next rows to fill, (count, columns); count <= room.

        Raises:
            RecordingError: The store has no room for another chunk.
        """
        if not len(self._chunk):
            self._chunk, self._count = self.store.block(self.chunk_rows)
        return self._chunk[self._closed : self._closed + count]

    @property
    def count(self) -> NDArray[np.int64]:
        """How many rows of this chunk are filled (1,); the writer adds one after each."""
        return self._count

    def close_rows(self) -> None:
        """Add the rows that were filled; a full chunk goes to the sinks.

        Raises:
            RecordingError: A sink could not write them.
        """
        self._closed = int(self._count[0])
        if self._closed and self._closed == len(self._chunk):
            full, first = self._chunk, self._handed_on
            self._full.append(full)
            self._before += len(full)
            self._begin_chunk()
            self._hand_on(full[first:])

    def flush(self) -> None:
        """Send the rows of an unfinished chunk to the sinks; a second time does nothing.

        Raises:
            RecordingError: A sink could not write them.
        """
        first, self._handed_on = self._handed_on, self._closed
        if first < self._closed:
            self._hand_on(self._chunk[first : self._closed])

    def rows(self) -> Rows:
        """Return a copy of all closed rows."""
        return Rows(self.signals, np.concatenate(self._parts()))

    def hand_over(self) -> Rows:
        """Return all closed rows, and keep none of them: for who ends the recording.

        Whoever recorded may live on for long, as objects that refer to each other do. The rows of
        a run of minutes take hundreds of megabytes.
        """
        parts, store = self._parts(), self.store
        whole = store.whole(parts) if isinstance(store, _Memory) else None
        self.store, self._full, self._before = _Memory(self._width), [], len(self)
        self._begin_chunk()
        return Rows(self.signals, np.concatenate(parts) if whole is None else whole)

    def _begin_chunk(self) -> None:
        """Keep no chunk until rows are opened."""
        self._chunk, self._count = np.empty((0, self._width)), np.zeros(1, np.int64)
        self._closed = self._handed_on = 0

    def _parts(self) -> list[Matrix]:
        return [*self._full, self._chunk[: self._closed]]

    def _hand_on(self, values: Matrix) -> None:
        for sink in self.sinks:
            sink.write(Rows(self.signals, values))


class _Memory:
    """Keeps the rows in the memory of the process, side by side in pieces of many chunks.

    Memory of a piece is taken from the system as rows are filled.
    """

    def __init__(self, width: int) -> None:
        self._width = width
        self._piece = self._left = np.zeros((0, width))

    def block(self, rows: int) -> tuple[Matrix, NDArray[np.int64]]:
        """See `Store.block`."""
        if rows > len(self._left):
            # Of memory that was freed before, an allocator would write every page.
            pages = mmap.mmap(-1, 8 * _CHUNKS * rows * self._width)
            # Real-time kernels have no huge pages, whatever headers say.
            with suppress(AttributeError, OSError):
                pages.madvise(mmap.MADV_HUGEPAGE)
            zeros = np.frombuffer(pages)
            self._piece = self._left = zeros.reshape(_CHUNKS * rows, self._width)
        block, self._left = self._left[:rows], self._left[rows:]
        return block, np.zeros(1, np.int64)

    def whole(self, parts: Sequence[Matrix]) -> Matrix | None:
        """Return blocks as one matrix without copying them; None if they lie in several pieces."""
        count = sum(map(len, parts))
        taken = len(self._piece) - len(self._left)
        inside = taken and all(np.may_share_memory(part, self._piece) for part in parts)
        return self._piece[:count] if inside and count <= taken else None
