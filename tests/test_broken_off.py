"""Commands that are broken off, and what of their recordings is left."""

import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from threading import Timer
from typing import Any

import numpy as np
import pytest

from robo47_qp.__main__ import main as robo47
from robo47_qp.errors import RecordingError
from robo47_qp.files import claimed
from robo47_qp.report.rerun import recovery
from robo47_qp.report.rerun.reading import read_recording
from robo47_qp.run.row_file import read_rows
from robo47_qp.run.runner import Runner
from tests.commands import SCRIPT, assert_one_message, posix, recorded, run_here

ANNOUNCE = """
import runpy, signal, sys
from robo47_qp.run.observers import RealTime

# Where tests run in the background, Ctrl-C is ignored unless asked for again.
signal.signal(signal.SIGINT, signal.default_int_handler)
tick = RealTime.tick

def announced(self, simulation):
    tick(self, simulation)
    sys.stdout.write(f"at {simulation.time}\\n")
    sys.stdout.flush()

RealTime.tick = announced
del sys.argv[0]
runpy.run_path(sys.argv[0], run_name="__main__")
"""
"""Tells the time of a run, so that a test can end it at one."""


def broken_off(folder: Path, how: signal.Signals, at: float) -> tuple[int, str, float]:
    """Exit code, standard error, and last time told of a run that was ended."""
    watcher = folder / "announce.py"
    watcher.write_text(ANNOUNCE, encoding="utf-8")
    log = str(folder / "run.rrd")
    with subprocess.Popen(
        [sys.executable, str(watcher), str(SCRIPT), "--realtime", "--log", log],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        guard = Timer(60.0, process.kill)
        guard.start()
        assert process.stdout is not None
        last = 0.0
        for time in _times(process.stdout):
            last = time
            if time >= at:
                process.send_signal(how)
                break
        rest, stderr = process.communicate()
        guard.cancel()
    last = max([last, *_times(rest.splitlines())])
    return process.returncode, stderr, last


def _times(lines: Sequence[str] | Any) -> Iterator[float]:
    for line in lines:
        if line.startswith("at "):
            yield float(line[3:])


@posix
@pytest.mark.parametrize("how", ["SIGINT", "SIGTERM"])
def test_a_run_that_is_interrupted_leaves_all_that_was_recorded(how: str, tmp_path: Path) -> None:
    for ending in (".json", ".png"):
        (tmp_path / f"run{ending}").write_text("of an earlier run")
    code, stderr, last = broken_off(tmp_path, signal.Signals[how], at=1.19)
    assert code == 130
    assert stderr.strip() == "interrupted; what was recorded so far is kept"
    assert last < 5.0
    times = recorded(tmp_path / "run.rrd")
    np.testing.assert_allclose(times, np.arange(len(times)) * 1e-3, atol=1e-6)
    assert times[-1] > last - 0.0015
    assert {path.name for path in tmp_path.glob("run.*")} == {"run.rrd", "run.whole.rrd"}


def test_a_run_that_is_interrupted_while_it_plans_says_that_nothing_was_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(_: Runner) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Runner, "rehearse", interrupted)
    assert robo47(["run", "reach", "--log", str(tmp_path / "run.rrd")]) == 130
    assert capsys.readouterr().err == "interrupted; nothing was recorded yet\n"
    assert list(tmp_path.iterdir()) == []


@posix
def test_a_run_that_is_killed_can_be_recovered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As that which was not, up to there; and what an earlier run left says nothing of this one."""
    for ending in (".json", ".png"):
        (tmp_path / f"run{ending}").write_text("of an earlier run")
    code, _, last = broken_off(tmp_path, signal.SIGKILL, at=1.19)
    assert code == -signal.SIGKILL
    assert {path.name for path in tmp_path.glob("run.*")} == {"run.lock", "run.rrd", "run.rows"}
    with monkeypatch.context() as patch:
        kept = replace(read_rows(tmp_path / "run.rows"), events=[{"evend": "note"}])
        patch.setattr(recovery, "read_rows", lambda _: kept)
        with pytest.raises(RecordingError, match=r"it is damaged \(no event: .*evend"):
            recovery.recover(tmp_path / "run.rows")
    with redirect_stdout(StringIO()) as said:
        assert robo47(["recover", str(tmp_path / "run.rows")]) == 0
    assert {path.name for path in tmp_path.glob("run.*")} == {"run.rrd"}
    assert run_here("--log", "whole/run.rrd", cwd=tmp_path).returncode == 0
    whole = read_recording(tmp_path / "whole" / "run.rrd")
    left = read_recording(tmp_path / "run.rrd")
    count = len(left.rows)
    assert f"run.rrd holds {(count - 1) * 1e-3:.3f} s" in said.getvalue()
    assert count * 1e-3 > last - 0.0015
    assert left.rows.signals == whole.rows.signals
    np.testing.assert_array_equal(left.rows.values, whole.rows.values[:count])
    assert left.phases == whole.phases[: len(left.phases)]
    assert len(left.phases) >= 1
    notes = [note for note in whole.notes if note.time <= left.rows["time"][-1, 0]]
    assert [note.time for note in left.notes[:-1]] == [note.time for note in notes]
    assert left.notes[-1].text.endswith("made from the rows that it left")
    assert left.summary is None


@pytest.mark.parametrize("name", ["run.rows", "run.rrd", "other.rows"])
def test_what_cannot_be_recovered_is_told(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "run.rows").write_bytes(b"something else")
    assert robo47(["recover", str(tmp_path / name)]) == 2
    said = capsys.readouterr().err
    assert said.count("error:") == 1
    assert name in said.replace("\n", "")
    assert [path.name for path in tmp_path.iterdir()] == ["run.rows"]


@pytest.mark.parametrize("command", ["run", "recover"])
def test_two_cannot_write_the_same_files(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The second is refused before anything moves, and the files of the first stay."""
    for name in ("run.rrd", "run.json", "run.png", "run.rows"):
        (tmp_path / name).write_text(f"of the first: {name}")
    with claimed(tmp_path / "run.rrd"):
        if command == "run":
            assert_one_message(
                run_here("--log", "run.rrd", cwd=tmp_path),
                "run.rrd is being written by another process",
            )
        else:
            assert robo47(["recover", str(tmp_path / "run.rows")]) == 2
            assert "is being written by another process" in " ".join(
                capsys.readouterr().err.split()
            )
        for name in ("run.rrd", "run.json", "run.png", "run.rows"):
            assert (tmp_path / name).read_text() == f"of the first: {name}"
    assert not (tmp_path / "run.lock").exists()


@posix
def test_what_a_killed_process_has_claimed_is_free_again(tmp_path: Path) -> None:
    program = (
        "import os, signal, sys; from pathlib import Path\n"
        "from robo47_qp.files import claimed\n"
        "with claimed(Path(sys.argv[1])):\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    log = tmp_path / "run.rrd"
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", program, str(log)], cwd=SCRIPT.parents[1], check=False
        )
        assert done.returncode == -signal.SIGKILL
    assert (tmp_path / "run.lock").exists()
    with claimed(log), pytest.raises(RecordingError, match="another process"), claimed(log):
        pass
    assert not (tmp_path / "run.lock").exists()
