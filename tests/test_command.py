"""The command line, as a user meets it: exit codes, messages, files, and what survives a kill."""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader
from threadpoolctl import threadpool_info, threadpool_limits

from robo47_qp.cli import guarded, main
from robo47_qp.errors import RecordingError
from robo47_qp.evaluation.command import evaluate_chosen
from robo47_qp.evaluation.options import EvaluateOptions
from robo47_qp.report.run_plot import Plotter
from tests.commands import SCRIPT, assert_one_message, posix, recorded, run_here, run_script


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


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--ik", "magic"], ["magic", "qp", "dls"]),
        (["--qp-solver", "magic"], ["magic", "daqp", "osqp"]),
        (["--speed", "0"], ["speed must be", "found 0.0"]),
        (["--speed", "2"], ["speed must be", "found 2.0"]),
        (["--speed", "nan"], ["speed must be", "found nan"]),
        (["--pick", "nan", "0"], ["pick must be two finite numbers", "nan"]),
        (
            ["--place", "2", "0"],
            ["--place must be on the table (x -0.28 to 0.88, y -0.58 to 0.58)"],
        ),
        (["--place", "-0.4", "0"], ["--place must be on the table", "found (-0.4, 0.0)"]),
        (["--pick", "0.1", "-0.585"], ["--pick must be on the table", "found (0.1, -0.585)"]),
        (["--place", "0.88", "0.58"], ["Waypoint 'carry' cannot be planned", "no closer than"]),
        (["--seed", "-1"], ["seed", "-1"]),
        (["--seed", "1.5"], ["error: --seed must be a whole number, 0 or more; found '1.5'."]),
        (["--seed", "x"], ["error: --seed must be a whole number, 0 or more; found 'x'."]),
        (["--seed", "1", "--pick", "0.5", "0.1"], ["--pick must be left out with --seed", "0.5"]),
        (["--seed", "1", "--pick", "0.4", "0.2"], ["--pick must be left out with --seed", "0.4"]),
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
    done = run_here("--log", "run.rrd", "--pick", "0.88", "0.58", cwd=tmp_path)
    assert_one_message(done, "Waypoint 'approach' cannot be planned")
    for name, path in last.items():
        assert path.read_text() == f"the last {name}"
        assert path.stat().st_mtime == 1e9


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


def test_an_evaluation_ends_with_2_for_bad_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    log = str(tmp_path / "eval.rrd")
    for arguments in (["--task", "fly"], ["--workers", "0"], ["--policy", "nowhere:Policy"]):
        monkeypatch.setattr(sys, "argv", ["evaluate.py", "--log", log, "--json", *arguments])
        assert main(EvaluateOptions, evaluate_chosen, "", repeated=True) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert err.startswith("error: ")
        assert "Traceback" not in err


def test_a_plot_that_fails_leaves_the_report_and_what_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_: Plotter) -> None:
        raise RecordingError("The plot cannot be written: no ink.")

    monkeypatch.setattr(Plotter, "finish", refuse)
    done = run_here("--log", "cube.rrd", cwd=tmp_path)
    assert done.returncode == 2
    assert "success" in done.stdout
    assert "error: The plot cannot be written: no ink." in done.stderr
    assert "Traceback" not in done.stderr
    assert json.loads((tmp_path / "cube.json").read_text(encoding="utf-8"))["success"] is True


def test_an_option_that_is_given_twice_is_refused(tmp_path: Path) -> None:
    """The first of its values would be dropped."""
    script = Path(SCRIPT).with_name("compare_ik.py")
    words = ("--n", "1", "--solvers", "lm", "--solvers=qp")
    done = run_here(*words, cwd=tmp_path, script=script)
    assert_one_message(done, "--solvers must be given once, with all its values behind it")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("closed", ["<&-", ">&-", "<&- >&-"])
def test_a_service_without_standard_streams_evaluates(tmp_path: Path, closed: str) -> None:
    """Their numbers would be taken by the pipes and sockets of workers and policies."""
    policy = f"{Path(__file__).with_name('toy_policies.py')}:LazyPolicy"
    words = ["evaluate", "--task", "reach", "--policy", policy, "--episodes", "1"]
    words += ["--time-limit", "0.2", "--workers", "1", "--failures", "0", "--log", "e.rrd"]
    done = subprocess.run(
        ["sh", "-c", f'exec "$0" -m robo47_qp "$@" {closed}', sys.executable, *words],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    report = json.loads((tmp_path / "e.json").read_text(encoding="utf-8"))
    assert (report["judged"], report["errors"]) == (1, 0)
