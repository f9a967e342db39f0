"""Recordings: every row handed on once, in order, and kept."""

import errno
import mmap
from dataclasses import dataclass, field
from weakref import ref

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo47_qp.arrays import Matrix
from robo47_qp.errors import RecordingError, UnknownNameError
from robo47_qp.run.control_loop import BLOCK_END
from robo47_qp.run.recording import CHUNK_ROWS, Recording, Rows, _Memory, slices
from robo47_qp.sim.signal import Signal
from tests.runs import Reach, make_runner

SIGNALS = (
    Signal(name="time", labels=("t",), unit="s"),
    Signal(name="a/b", labels=("x", "y"), unit="m"),
    Signal(name="c", labels=("one", "two", "three"), unit="count"),
)
WIDTH = 6


@dataclass
class Keeper:
    """Keeps what it was given, and a copy of it."""

    given: list[Rows] = field(default_factory=list)
    copies: list[Matrix] = field(default_factory=list)

    def write(self, rows: Rows) -> None:
        self.given.append(rows)
        self.copies.append(rows.values.copy())


class Full:
    def write(self, rows: Rows) -> None:
        raise RecordingError("the disk is full")


def fill(recording: Recording, count: int, first: int) -> Matrix:
    """Write rows with values that occur nowhere else, as far as there is room at a time."""
    values = (first * WIDTH + np.arange(count * WIDTH, dtype=float)).reshape(count, WIDTH)
    done = 0
    while done < count:
        n = min(recording.room, count - done)
        recording.open_rows(n)[:] = values[done : done + n]
        recording.count[0] += n
        recording.close_rows()
        done += n
    return values


@given(st.integers(1, 9), st.lists(st.integers(0, 14), max_size=8))
def test_sinks_get_every_row_once_and_in_order(chunk: int, counts: list[int]) -> None:
    sinks = (Keeper(), Keeper())
    recording = Recording(SIGNALS, chunk_rows=chunk, sinks=sinks)
    written = [np.empty((0, WIDTH))]
    for count in counts:
        written.append(fill(recording, count, len(recording)))
        assert len(recording) == sum(len(block) for block in written)
        assert 1 <= recording.room <= chunk
        for sink in sinks:
            assert len(sink.copies) == len(recording) // chunk
    expected = np.concatenate(written)
    np.testing.assert_array_equal(recording.rows().values, expected)
    recording.flush()
    for sink in sinks:
        got = np.concatenate([np.empty((0, WIDTH)), *sink.copies])
        np.testing.assert_array_equal(got, expected)
        assert all(len(block) for block in sink.copies)
        for rows, copy in zip(sink.given, sink.copies, strict=True):
            np.testing.assert_array_equal(rows.values, copy)
    np.testing.assert_array_equal(recording.rows().values, expected)


def test_room_shrinks_with_every_row_and_is_whole_again_after_a_chunk() -> None:
    recording = Recording(SIGNALS, chunk_rows=5)
    room = []
    for k in range(11):
        room.append(recording.room)
        fill(recording, 1, k)
    assert room == [5, 4, 3, 2, 1, 5, 4, 3, 2, 1, 5]


def test_chunks_end_where_blocks_end() -> None:
    """So that a run is the same whatever is recorded of it."""
    assert CHUNK_ROWS % BLOCK_END == 0
    keeper = Keeper()
    recording = Recording(SIGNALS, sinks=[keeper])
    fill(recording, CHUNK_ROWS - 1, 0)
    assert not keeper.given
    fill(recording, 1, CHUNK_ROWS - 1)
    assert [len(rows) for rows in keeper.given] == [CHUNK_ROWS]


def test_rows_that_were_opened_but_not_closed_do_not_count() -> None:
    keeper = Keeper()
    recording = Recording(SIGNALS, chunk_rows=4, sinks=[keeper])
    fill(recording, 2, 0)
    recording.open_rows(2)[:] = 99.0
    assert len(recording) == 2
    assert len(recording.rows()) == 2
    recording.flush()
    assert keeper.copies[0].max() < 99.0


def test_flush_with_nothing_unfinished_hands_nothing_on() -> None:
    keeper = Keeper()
    recording = Recording(SIGNALS, chunk_rows=4, sinks=[keeper])
    recording.flush()
    fill(recording, 4, 0)
    recording.flush()
    assert [len(rows) for rows in keeper.given] == [4]


def test_all_rows_are_a_copy() -> None:
    recording = Recording(SIGNALS, chunk_rows=4)
    fill(recording, 6, 0)
    recording.rows().values[:] = -1.0
    assert recording.rows().values.min() >= 0.0


def test_the_error_of_a_sink_reaches_the_writer() -> None:
    recording = Recording(SIGNALS, chunk_rows=2, sinks=[Full()])
    fill(recording, 1, 0)
    with pytest.raises(RecordingError, match="the disk is full"):
        recording.flush()
    with pytest.raises(RecordingError, match="the disk is full"):
        fill(recording, 1, 1)
    assert len(recording) == 2


def test_signals_are_found_by_name() -> None:
    values = np.arange(12.0).reshape(2, WIDTH)
    rows = Rows(SIGNALS, values)
    assert len(rows) == 2
    np.testing.assert_array_equal(rows["time"], [[0], [6]])
    np.testing.assert_array_equal(rows["a/b"], [[1, 2], [7, 8]])
    np.testing.assert_array_equal(rows["c"], [[3, 4, 5], [9, 10, 11]])
    assert slices(SIGNALS) == {"time": slice(0, 1), "a/b": slice(1, 3), "c": slice(3, 6)}


def test_a_signal_is_a_view() -> None:
    rows = Rows(SIGNALS, np.zeros((2, WIDTH)))
    rows["c"][:, 1] = 7.0
    np.testing.assert_array_equal(rows.values[:, 4], [7.0, 7.0])


def test_an_unknown_signal_is_named() -> None:
    with pytest.raises(UnknownNameError, match=r"No signal is called 'd'; known: time, a/b, c\."):
        Rows(SIGNALS, np.zeros((2, WIDTH)))["d"]


def test_a_flush_hands_on_what_is_left_and_nothing_twice() -> None:
    keeper = Keeper()
    recording = Recording(SIGNALS, chunk_rows=4, sinks=[keeper])
    written = fill(recording, 3, 0)
    recording.flush()
    recording.flush()
    written = np.concatenate([written, fill(recording, 3, 3)])
    recording.flush()
    assert [len(rows) for rows in keeper.given] == [3, 1, 2]
    np.testing.assert_array_equal(np.concatenate(keeper.copies), written)


def test_rows_count_as_they_are_filled() -> None:
    """A writer that is broken off leaves those before."""
    recording = Recording(SIGNALS, chunk_rows=4)
    rows = recording.open_rows(4)
    rows[0] = 1.0
    recording.count[0] += 1
    rows[1] = 2.0
    recording.close_rows()
    assert len(recording) == 1
    assert recording.room == 3


def test_rows_that_are_handed_over_are_the_same_and_gone() -> None:
    """In one piece of memory and in several, with a chunk that is not full."""
    for count in (1, 7, 200):
        recording = Recording(SIGNALS, chunk_rows=4)
        for k in range(count):
            row = recording.open_rows(1)
            row[:] = k + np.arange(row.shape[1])
            recording.count[0] += 1
            recording.close_rows()
        copied = recording.rows().values
        whole = recording.hand_over().values
        np.testing.assert_array_equal(whole, copied)
        assert len(whole) == len(recording) == count
        assert len(recording.rows()) == 0
        # It could go on, with what comes after.
        fill(recording, 3, 1000)
        assert len(recording) == count + 3
        assert len(recording.rows()) == 3


def test_the_rows_of_a_run_are_gone_with_it() -> None:
    """Though the objects that recorded them live on: a run of minutes takes hundreds of MB."""
    runner, _ = make_runner(Reach())
    run = runner.run()
    memory: object = run.rows.values
    while isinstance(memory, np.ndarray):
        memory = memory.base
    assert isinstance(memory, memoryview)
    pages = ref(memory.obj)
    del run, memory
    assert pages() is None
    assert len(runner.loop.recording) > 100


def test_rows_are_kept_where_the_kernel_has_no_huge_pages(monkeypatch: pytest.MonkeyPatch) -> None:
    class Plain(mmap.mmap):
        def madvise(self, *_: int) -> None:
            raise OSError(errno.EINVAL, "Invalid argument")

    monkeypatch.setattr(mmap, "mmap", Plain)
    block, _ = _Memory(WIDTH).block(10)
    assert block.shape == (10, WIDTH)
