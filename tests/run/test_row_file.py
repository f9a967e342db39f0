"""Row files: what a killed run leaves, and what of a damaged file is told."""

import json
import os
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import mujoco
import numpy as np
import pytest

from robo47_qp._core.library import using
from robo47_qp.errors import RecordingError
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run import signals
from robo47_qp.run.recording import Recording
from robo47_qp.run.row_file import RowFile, read_rows
from robo47_qp.sim.signal import Signal
from tests.run.test_recording import SIGNALS, WIDTH, fill
from tests.runs import Reach, carry_out

posix = pytest.mark.skipif(sys.platform == "win32", reason="signals and limits of POSIX")
MODEL = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")


def row_file(path: Path) -> RowFile:
    return RowFile(path, MODEL, PANDA, SIGNALS)


def kept_in(store: RowFile) -> Recording:
    recording = Recording(SIGNALS, chunk_rows=4)
    recording.store = store
    return recording


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A file that was left with 6 of 8 rows and two events."""
    path = tmp_path / "new" / "run.rows"
    store = row_file(path)
    store.add({"event": "note", "text": "1 µm"})
    fill(kept_in(store), 6, 0)
    store.add({"event": "phase", "name": "end"})
    store.close()
    return path


def test_rows_and_events_come_back(path: Path) -> None:
    kept = read_rows(path)
    assert kept.robot == "panda"
    assert kept.rows.signals == SIGNALS
    np.testing.assert_array_equal(kept.rows.values, np.arange(6.0 * WIDTH).reshape(6, WIDTH))
    assert kept.events == [
        {"event": "note", "text": "1 µm"},
        {"event": "phase", "name": "end"},
    ]
    assert kept.model.ngeom == 1


def test_rows_are_in_the_file_at_once(tmp_path: Path) -> None:
    with closing(row_file(tmp_path / "run.rows")) as store:
        recording = kept_in(store)
        rows = recording.open_rows(2)
        for done in range(3):
            assert len(read_rows(tmp_path / "run.rows").rows) == done
            if done < 2:
                rows[done] = done
                recording.count[0] += 1


def test_a_file_without_rows_is_not_left_behind(tmp_path: Path) -> None:
    store = row_file(tmp_path / "run.rows")
    store.add({"event": "phase", "name": "start"})
    store.block(10)
    store.close()
    store.close()
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_removed_is_gone(tmp_path: Path) -> None:
    store = row_file(tmp_path / "run.rows")
    fill(kept_in(store), 3, 0)
    store.remove()
    store.close()
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_cut_off_anywhere_gives_its_rows_or_one_message(path: Path) -> None:
    whole, counts = path.read_bytes(), set()
    scene = whole.index(b"MJCB")
    begun = scene + 16 + int.from_bytes(whole[scene + 8 : scene + 16], "little")
    places = [*range(0, 900, 50), *range(len(whole) - 700, len(whole), 11)]
    for end in places:
        path.write_bytes(whole[:end])
        if end < begun:
            with pytest.raises(RecordingError, match=r"run\.rows cannot be read"):
                read_rows(path)
            continue
        kept = read_rows(path)
        counts.add(len(kept.rows))
        assert kept.model.ngeom == 1
        expected = np.arange(len(kept.rows) * WIDTH, dtype=float).reshape(-1, WIDTH)
        np.testing.assert_array_equal(kept.rows.values, expected)
    assert counts == {0, 4, 6}


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b"robo47 rows", b"robo48 rows", "does not hold the rows of a run"),
        (b'"unit": "count"', b'"unit"; "count"', "it is damaged"),
        (b'"robot"', b'"r0bot"', "it is damaged"),
        (b"ROWS", b"R0WS", "it is damaged at a part b'R0WS'"),
        (b"MJCB", b"MJCC", "it is damaged at a part b'MJCC'"),
        (b"world", b"wor1d", "its scene is not the one that was written"),
        (b'"form": 1', b'"form": 7', "was written in form 7 with robo47_qp"),
        (b'"mujoco": "4', b'"mujoco": "9', "Read it with those"),
    ],
)
def test_what_is_wrong_with_a_file_is_told(old: bytes, new: bytes, words: str, path: Path) -> None:
    content = path.read_bytes()
    assert old in content
    assert len(old) == len(new)
    path.write_bytes(content.replace(old, new, 1))
    with pytest.raises(RecordingError, match=words):
        read_rows(path)


def test_a_count_that_cannot_be_is_told(path: Path) -> None:
    content = bytearray(path.read_bytes())
    start = content.index(b"ROWS") + 16
    content[start] = 5
    path.write_bytes(content)
    with pytest.raises(RecordingError, match="5 of 4 rows filled"):
        read_rows(path)


def test_a_file_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"run\.rows cannot be read: No such file"):
        read_rows(tmp_path / "run.rows")


def test_a_file_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(RecordingError, match=r"run\.rows cannot be written"):
        row_file(tmp_path / "taken" / "run.rows")


@posix
def test_a_full_disk_is_told_and_keeps_what_was_written(tmp_path: Path) -> None:
    """Pages without room on the disk would end the process with SIGBUS."""
    import resource

    path = tmp_path / "run.rows"
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with closing(row_file(path)) as store:
        recording = kept_in(store)
        fill(recording, 4, 0)
        resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + 60, hard))
        try:
            with pytest.raises(RecordingError, match=r"run\.rows cannot be written: File too"):
                recording.open_rows(1)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert len(read_rows(path).rows) == 4


KILLED = """
import json, mmap, os, signal, sys, time
from pathlib import Path
import numpy as np
from robo47_qp.run.row_file import RowFile
from tests.runs import PANDA, Reach, make_runner

folder, total = Path(sys.argv[1]), int(sys.argv[2])
steps = np.frombuffer(mmap.mmap(-1, 8), np.int64)
for k, at in enumerate(np.random.default_rng().integers(1, total, 4).tolist()):
    runner, simulation = make_runner(Reach())
    step = simulation.step

    def counted(tau):
        step(tau)
        steps[0] += 1

    simulation.step = counted
    steps[0] = 0
    child = os.fork()
    if not child:
        store = RowFile(folder / f"{k}.rows", simulation.model, PANDA, runner.signals)
        runner.run(store=store, chunk_rows=400)
        time.sleep(60.0)
    while steps[0] < at:
        time.sleep(1e-4)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    print(json.dumps([at, int(steps[0])]))
"""
"""Runs a job four times in a process of its own, which is killed when a step of it has come."""


@posix
def test_a_killed_run_loses_at_most_one_row(tmp_path: Path) -> None:
    with using("numpy"):  # whose loop tells of every step
        whole = carry_out(Reach()).rows
    done = subprocess.run(
        [sys.executable, "-c", KILLED, str(tmp_path), str(len(whole))],
        cwd=Path(__file__).resolve().parents[2],
        env={**os.environ, "PYTHONWARNINGS": "ignore", "ROBO47_BACKEND": "numpy"},
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    ends = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(ends) == 4
    for k, (at, steps) in enumerate(ends):
        rows = read_rows(tmp_path / f"{k}.rows").rows
        assert steps - 1 <= len(rows) <= steps, at
        signals.derive(rows, PANDA)
        assert rows.signals == whole.signals
        np.testing.assert_array_equal(rows.values, whole.values[: len(rows)])


def test_the_name_of_a_signal_comes_back_with_all_that_it_says(tmp_path: Path) -> None:
    told = (Signal(name="a/b", labels=("µ", "ω"), unit="rad/s²", shown=False),)
    store = RowFile(tmp_path / "run.rows", MODEL, PANDA, told)
    _, count = store.block(1)
    count[0] = 1
    store.close()
    assert read_rows(tmp_path / "run.rows").rows.signals == told
