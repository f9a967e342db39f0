"""The command line, as a user meets it: exit codes, messages, files, and what survives a kill."""

import json
import os
import runpy
import signal
import subprocess
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from threading import Timer
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader
from threadpoolctl import threadpool_info, threadpool_limits

from robo47_qp.__main__ import main as robo47
from robo47_qp.cli import guarded
from robo47_qp.errors import RecordingError
from robo47_qp.files import claimed
from robo47_qp.report.rerun.reading import read_recording

SCRIPT = Path(__file__).resolve().parents[1] / "scenarios" / "pickplace.py"
posix = pytest.mark.skipif(sys.platform == "win32", reason="signals and limits of POSIX")


def run_script(
    *arguments: str,
    cwd: Path,
    script: Path = SCRIPT,
    file_limit: int | None = None,
    terminal: bool = False,
) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "COLUMNS": "1000"}
    for name in ("FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE"):
        environment.pop(name, None)
    if terminal:
        environment["FORCE_COLOR"] = "1"
    limited: list[str] = []
    if file_limit is not None:
        limited = [
            "-c",
            "import resource, runpy, sys\n"
            f"resource.setrlimit(resource.RLIMIT_FSIZE, ({file_limit}, {file_limit}))\n"
            "del sys.argv[0]\n"
            "runpy.run_path(sys.argv[0], run_name='__main__')",
        ]
    return subprocess.run(
        [sys.executable, *limited, str(script), *arguments],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


def run_here(
    *arguments: str, cwd: Path, script: Path = SCRIPT, terminal: bool = False
) -> subprocess.CompletedProcess[str]:
    """The same in this process, which saves the imports: for what is no matter of a process."""
    stdout, stderr = StringIO(), StringIO()
    on_terminate = signal.getsignal(signal.SIGTERM)
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(stdout), redirect_stderr(stderr):
        patch.chdir(cwd)
        patch.setenv("COLUMNS", "1000")
        for name in ("FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE"):
            patch.delenv(name, raising=False)
        if terminal:
            patch.setenv("FORCE_COLOR", "1")
        patch.setattr(sys, "argv", [str(script), *arguments])
        with pytest.raises(SystemExit) as ended:
            runpy.run_path(str(script), run_name="__main__")
    signal.signal(signal.SIGTERM, on_terminate)
    assert isinstance(ended.value.code, int)
    return subprocess.CompletedProcess(
        sys.argv, ended.value.code, stdout.getvalue(), stderr.getvalue()
    )


def recorded(path: Path) -> list[float]:
    """Times of all rows of signals in a file, with or without its end [s]."""
    times: list[float] = []
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="RRD file has no footer")
        reader = RrdReader(_whole_messages(path))
        for chunk in reader.stream():
            if str(chunk.entity_path).strip("/") == "signals" and not chunk.is_static:
                column = chunk.to_record_batch().column("time")
                times += [time.total_seconds() for time in column.to_pylist()]
    return sorted(times)


def _whole_messages(path: Path) -> Path:
    """A copy without what a kill cut in two: 12 bytes of header, then kind, length, payload."""
    data = path.read_bytes()
    assert data[:4] == b"RRF2"
    end = 12
    while end + 16 <= len(data):
        length = int.from_bytes(data[end + 8 : end + 16], "little")
        if end + 16 + length > len(data):
            break
        end += 16 + length
    copy = path.with_suffix(".whole.rrd")
    copy.write_bytes(data[:end])
    return copy


def assert_one_message(done: subprocess.CompletedProcess[str], *words: str) -> None:
    """Bad input: exit code 2 and one message on the standard error."""
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout.strip() == ""
    own, library = done.stderr.count("error:"), done.stderr.count("╭─")
    assert own + library == 1, done.stderr
    for word in words:
        assert word in done.stderr


# Success


@pytest.fixture(scope="module")
def success(
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[subprocess.CompletedProcess[str], Path]:
    folder = tmp_path_factory.mktemp("elsewhere")
    return run_script("--log", "some/new/folder/cube.rrd", cwd=folder), folder


def test_a_run_says_so_and_leaves_recording_report_and_plot(
    success: tuple[subprocess.CompletedProcess[str], Path],
) -> None:
    done, folder = success
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert "\nsuccess\n" in done.stdout
    where = folder / "some" / "new" / "folder"
    assert sorted(p.name for p in where.iterdir()) == ["cube.json", "cube.png", "cube.rrd"]
    assert [p.name for p in folder.iterdir()] == ["some"]
    for name in ("cube.json", "cube.png", "cube.rrd"):
        assert name in done.stdout
    assert (where / "cube.png").read_bytes()[:4] == b"\x89PNG"


def test_the_recording_has_every_row_of_the_run(
    success: tuple[subprocess.CompletedProcess[str], Path],
) -> None:
    _, folder = success
    where = folder / "some" / "new" / "folder"
    report = json.loads((where / "cube.json").read_text(encoding="utf-8"))
    times = recorded(where / "cube.rrd")
    np.testing.assert_allclose(times, np.arange(len(times)) * 1e-3, atol=1e-6)
    assert len(times) * 1e-3 == pytest.approx(report["metrics"]["cycle_time_s"])
    assert report["success"] is True
    assert report["settings"]["planner"]["ik"]["solver"]["class"] == "MinkIk"


def test_the_recording_is_closed_in_order_and_ends_with_a_summary(
    success: tuple[subprocess.CompletedProcess[str], Path],
) -> None:
    _, folder = success
    # Without its end the reader would warn, and a warning is an error here.
    reader = RrdReader(folder / "some" / "new" / "folder" / "cube.rrd")
    chunks = [c for c in reader.stream() if str(c.entity_path).strip("/") == "summary"]
    assert chunks
    assert "# Success" in str(chunks[-1].to_record_batch().to_pydict())


def test_json_is_all_there_is_on_the_standard_output(tmp_path: Path) -> None:
    choices = ("--ik", "dls", "--seed", "1", "--plot", "picture.png")
    # Where the output is a terminal, there is a progress bar.
    done = run_here("--json", "--log", "run.rrd", *choices, cwd=tmp_path, terminal=True)
    assert done.returncode == 0, done.stderr
    summary: dict[str, Any] = json.loads(done.stdout)
    assert summary == json.loads((tmp_path / "run.json").read_text(encoding="utf-8"))
    assert summary["success"] is True
    assert summary["seed"] == 1
    assert summary["settings"]["planner"]["ik"]["solver"]["class"] == "DlsIk"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["picture.png", "run.json", "run.rrd"]


# Tried and failed


STRICT = """
import sys
from robo47_qp.cli import RunOptions, main, run_task
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.tasks.pick_place.pick_place import PickPlace

def run(options, console):
    return run_task(PickPlace(place_tolerance=1e-9), PANDA, options, console)

sys.exit(main(RunOptions, run, "Place a cube to the nanometre."))
"""


def test_a_robot_that_tried_and_failed_exits_with_one_and_tells_why(tmp_path: Path) -> None:
    script = tmp_path / "strict.py"
    script.write_text(STRICT, encoding="utf-8")
    done = run_here("--log", str(tmp_path / "run.rrd"), cwd=tmp_path, script=script)
    assert done.returncode == 1, done.stderr
    assert done.stderr == ""
    assert "failed: place" in done.stdout
    summary = json.loads((tmp_path / "run.json").read_text(encoding="utf-8"))
    assert summary["success"] is False
    assert summary["failure"] == "place"
    assert "mm from its goal" in summary["evidence"]
    times = recorded(tmp_path / "run.rrd")
    assert len(times) * 1e-3 == pytest.approx(summary["metrics"]["cycle_time_s"])
    assert (tmp_path / "run.png").exists()


GENTLE = STRICT.replace("place_tolerance=1e-9", "force_max=0.5").replace(
    "sys.exit(main(RunOptions,",
    """from dataclasses import dataclass, replace
from robo47_qp.run.watchdog import Watchdog
from robo47_qp.stack import ClassicalStack

class Blind(Watchdog):
    def check(self, *_, **__):
        return None

class BlindStack(ClassicalStack):
    def scenario(self, *chosen):
        return replace(super().scenario(*chosen), watchdog=Blind())

@dataclass(frozen=True, kw_only=True)
class Unwatched(RunOptions):
    stack = BlindStack()

sys.exit(main(Unwatched,""",
)


def test_a_broken_promise_is_seen_wherever_one_looks(tmp_path: Path) -> None:
    """The cube weighs 1 N; the task allows half of that."""
    script = tmp_path / "gentle.py"
    script.write_text(GENTLE, encoding="utf-8")
    log = tmp_path / "run.rrd"
    done = run_here("--log", str(log), cwd=tmp_path, script=script)
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "run.json").read_text(encoding="utf-8"))
    [broken] = [finding for finding in summary["audit"] if not finding["ok"]]
    assert (broken["signal"], broken["limit"], broken["unit"]) == ("tool contact", 0.5, "N")
    size, time = f"{broken['extreme']:.4g} N", f"{broken['time']:.3f} s"
    told = f"tool contact: {size} at {time}, the limit is 0.5 N"
    assert f"violation  {told}" in done.stdout
    texts = {
        str(chunk.entity_path).strip("/"): chunk.to_record_batch().to_pydict()
        for chunk in RrdReader(log).stream()
        if str(chunk.entity_path).strip("/") == "summary"
    }
    assert f"| tool contact | 0.5 | {broken['extreme']:.4g} |" in str(texts["summary"])
    events = [
        str(chunk.to_record_batch().to_pydict())
        for chunk in RrdReader(log).stream()
        if str(chunk.entity_path).strip("/") == "events"
    ]
    assert any(f"violation: {told}" in event and "ERROR" in event for event in events)


# Bad input


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--ik", "magic"], ["magic", "qp", "dls"]),
        (["--qp-solver", "magic"], ["magic", "daqp", "osqp"]),
        (["--speed", "0"], ["speed must be", "found 0.0"]),
        (["--speed", "2"], ["speed must be", "found 2.0"]),
        (["--speed", "nan"], ["speed must be", "found nan"]),
        (["--pick", "nan", "0"], ["pick must be two finite numbers", "nan"]),
        (["--place", "2", "0"], ["Waypoint 'carry' cannot be planned", "beyond the reach"]),
        (["--seed", "-1"], ["seed", "-1"]),
        (["--seed", "1", "--pick", "0.5", "0.1"], ["--pick must be left out with --seed", "0.5"]),
        (["--speed", "1e-5"], ["speed"]),
    ],
    ids=" ".join,
)
def test_bad_input_is_told_and_nothing_is_left_behind(
    arguments: Sequence[str], words: Sequence[str], tmp_path: Path
) -> None:
    done = run_here("--log", "run.rrd", *arguments, cwd=tmp_path)
    assert_one_message(done, *words)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("files", "words"),
    [
        (["--log", "taken/run.rrd"], ["taken/run.rrd cannot be written"]),
        (["--plot", "taken/run.png"], ["taken/run.png cannot be written"]),
        (["--log", "run.json"], ["run.json"]),
        (["--log", "run.png"], ["run.png"]),
        (["--plot", "run.foo"], ["run.foo"]),
    ],
    ids=" ".join,
)
def test_files_that_cannot_be_are_told_before_anything_moves(
    files: Sequence[str], words: Sequence[str], tmp_path: Path
) -> None:
    """Below a file, one in the place of another, or of a kind that nobody can write."""
    (tmp_path / "taken").write_text("a file")
    done = run_here("--log", "run.rrd", *files, cwd=tmp_path)
    assert_one_message(done, *words)
    assert (tmp_path / "taken").read_text() == "a file"
    assert [p.name for p in tmp_path.iterdir()] == ["taken"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs the /dev/full of Linux")
def test_a_full_disk_is_told(tmp_path: Path) -> None:
    # The report and the plot stand beside it: a link keeps them out of /dev.
    (tmp_path / "run.rrd").symlink_to("/dev/full")
    done = run_here("--log", "run.rrd", cwd=tmp_path)
    assert_one_message(done, "run.rrd could not be written to its end", "No space left")
    assert not (tmp_path / "run.json").exists()


@posix
def test_a_disk_that_fills_up_is_told_and_what_was_recorded_can_be_read(tmp_path: Path) -> None:
    done = run_script("--log", "run.rrd", cwd=tmp_path, file_limit=17_000_000)
    # On a machine that is slow enough, it tells on the way how far it is.
    kept = [line for line in done.stdout.splitlines() if not line.startswith("seconds simulated: ")]
    done.stdout = "\n".join(kept)
    assert_one_message(done, "run.rrd was closed at", "make room")
    times = recorded(tmp_path / "run.rrd")
    assert len(times) >= 1000
    np.testing.assert_allclose(times, np.arange(len(times)) * 1e-3, atol=1e-6)


def test_a_rehearsal_that_fails_does_not_touch_the_last_recording(tmp_path: Path) -> None:
    last = {name: tmp_path / name for name in ("run.rrd", "run.json", "run.png")}
    for name, path in last.items():
        path.write_text(f"the last {name}")
        os.utime(path, (1e9, 1e9))
    done = run_here("--log", "run.rrd", "--pick", "2", "0", cwd=tmp_path)
    assert_one_message(done, "Waypoint 'approach' cannot be planned")
    for name, path in last.items():
        assert path.read_text() == f"the last {name}"
        assert path.stat().st_mtime == 1e9


# Broken off


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


@posix
def test_a_run_that_is_killed_can_be_recovered(
    success: tuple[subprocess.CompletedProcess[str], Path], tmp_path: Path
) -> None:
    """As that which was not, up to there; and what an earlier run left says nothing of this one."""
    for ending in (".json", ".png"):
        (tmp_path / f"run{ending}").write_text("of an earlier run")
    code, _, last = broken_off(tmp_path, signal.SIGKILL, at=1.19)
    assert code == -signal.SIGKILL
    assert {path.name for path in tmp_path.glob("run.*")} == {"run.lock", "run.rrd", "run.rows"}
    with redirect_stdout(StringIO()) as said:
        assert robo47(["recover", str(tmp_path / "run.rows")]) == 0
    assert {path.name for path in tmp_path.glob("run.*")} == {"run.rrd"}
    whole = read_recording(success[1] / "some" / "new" / "folder" / "cube.rrd")
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


# Two at once


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


def test_a_command_takes_one_thread_for_linear_algebra_and_then_gives_them_back() -> None:
    def threads() -> set[int]:
        return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}

    seen: list[set[int]] = []

    def command() -> int:
        seen.append(threads())
        return 0

    with threadpool_limits(2, user_api="blas"):
        assert guarded(command) == 0
        assert seen == [{1}]
        assert threads() == {2}
