"""The scenario, as a user meets it: files, exit codes, messages, and what Ctrl-C leaves."""

import json
import subprocess
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from rerun.chunk import RrdReader
from rich.console import Console

from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError, RecordingError, UnknownNameError
from robo47_qp.evaluation.benchmarks.ik.command import (
    CompareOptions,
    chosen,
    compare,
    compare_chosen,
)
from robo47_qp.evaluation.benchmarks.ik.comparison import Comparison, Field
from robo47_qp.evaluation.benchmarks.ik.judge import Judge
from robo47_qp.evaluation.benchmarks.ik.targets import uniform
from robo47_qp.files import claimed
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.solver import IkResult, IkSolver, Tolerance
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.tool_poses import Target
from tests.commands import assert_one_message, run_here, run_script

SCRIPT = Path(__file__).resolve().parents[2] / "scenarios" / "compare_ik.py"
SOLVERS = ("dls-position", "dls-clip", "lm", "fast")


@pytest.fixture(scope="module")
def done(
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[subprocess.CompletedProcess[str], Path]:
    folder = tmp_path_factory.mktemp("compare")
    arguments = ("--n", "5", "--log", "some/new/ik.rrd", "--peers", "--solvers", *SOLVERS)
    return run_script(*arguments, cwd=folder, script=SCRIPT), folder / "some" / "new"


def test_it_leaves_report_plot_and_recording(
    done: tuple[subprocess.CompletedProcess[str], Path],
) -> None:
    process, folder = done
    assert process.returncode == 0, process.stderr
    assert process.stderr == ""
    assert sorted(path.name for path in folder.iterdir()) == ["ik.json", "ik.png", "ik.rrd"]
    assert (folder / "ik.png").read_bytes()[:4] == b"\x89PNG"
    assert (folder / "ik.png").stat().st_size > 50_000
    for words in (*SOLVERS, "uniform: 5 targets", "near_singular", "wrong shape", "ik.json"):
        assert words in process.stdout


def test_the_report_has_a_row_per_solver_and_target_set(
    done: tuple[subprocess.CompletedProcess[str], Path],
) -> None:
    report = json.loads((done[1] / "ik.json").read_text(encoding="utf-8"))
    assert report["complete"] is True
    sets = ("uniform", "tabletop", "near_limits", "near_singular", "unreachable", "hostile")
    found = [(row["targets"], row["solver"]) for row in report["rows"]]
    assert found == [(name, solver) for name in sets for solver in SOLVERS]
    by_name = {(row["targets"], row["solver"]): row for row in report["rows"]}
    assert by_name["uniform", "fast"]["success"] == 1.0
    assert by_name["uniform", "dls-position"]["position_only"] == 1.0
    assert by_name["uniform", "dls-position"]["success"] == 0.0
    assert all(r["success"] == 0.0 for r in report["rows"] if r["targets"] == "hostile")


def test_the_recording_has_targets_and_failures_of_each_solver(
    done: tuple[subprocess.CompletedProcess[str], Path],
) -> None:
    # Without its end the reader would warn, and a warning is an error here.
    chunks = list(RrdReader(done[1] / "ik.rrd").stream())
    entities = {str(chunk.entity_path).replace("\\", "") for chunk in chunks}
    for solver in SOLVERS:
        assert f"/{solver}/targets/uniform" in entities
        assert f"/{solver}/arm/link7" in entities
        assert f"/{solver}/why" in entities
    why = next(c for c in chunks if str(c.entity_path).replace("\\", "") == "/dls-position/why")
    text = str(why.to_record_batch().to_pydict())
    assert "Failure 1 of" in text
    assert "mm" in text


def test_the_same_seed_gives_the_same_answers_in_another_process(
    done: tuple[subprocess.CompletedProcess[str], Path], tmp_path: Path
) -> None:
    choice = ("--solvers", "lm", "fast", "--targets", "tabletop", "hostile")
    again = run_here("--n", "5", "--json", *choice, cwd=tmp_path, script=SCRIPT, terminal=True)
    assert again.returncode == 0, again.stderr
    second: dict[str, Any] = json.loads(again.stdout)
    first = json.loads((done[1] / "ik.json").read_text(encoding="utf-8"))
    digests = {(row["targets"], row["solver"]): row["sha256"] for row in first["rows"]}
    assert len(second["rows"]) == 4
    for row in second["rows"]:
        assert row["sha256"] == digests[row["targets"], row["solver"]]


def test_bad_input_is_one_message(tmp_path: Path) -> None:
    done = run_here("--solvers", "magic", cwd=tmp_path, script=SCRIPT)
    assert_one_message(done, "magic", "dls-clip", "fast")


def test_a_file_that_cannot_be_written_is_found_before_anything_is_solved(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file")
    solver = Impatient()
    fields = {"uniform": Field(make=uniform, judge=Judge(PANDA))}
    comparison = Comparison(arm=Arm(PANDA), solvers={"one": solver}, fields=fields, n=9)
    options = CompareOptions(n=9, log=tmp_path / "taken" / "ik.rrd")
    with pytest.raises(RecordingError, match=r"taken.*cannot be written"):
        compare(comparison, options, Console(file=StringIO()), left_out={}, questions=())
    assert solver.asked == 0


class Impatient:
    """Is interrupted at its fourth target."""

    tolerance = Tolerance()

    def __init__(self, last: int = 5) -> None:
        self._solver, self.asked, self._last = LmIk(), 0, last

    def solve(self, arm: Arm, T_world_target: Target, q_seed: Vector) -> IkResult:
        self.asked += 1
        if self.asked == self._last:
            raise KeyboardInterrupt
        return self._solver.solve(arm, T_world_target, q_seed)


def test_ctrl_c_keeps_what_was_measured(tmp_path: Path) -> None:
    fields = {"uniform": Field(make=uniform, judge=Judge(PANDA))}
    solvers: dict[str, IkSolver] = {"lm": LmIk(), "impatient": Impatient()}
    comparison = Comparison(arm=Arm(PANDA), solvers=solvers, fields=fields, n=9, block=3, warm=0)
    console = Console(file=StringIO())
    options = CompareOptions(n=9, log=tmp_path / "ik.rrd")
    assert compare(comparison, options, console, left_out={}, questions=()) == 130
    report = json.loads((tmp_path / "ik.json").read_text(encoding="utf-8"))
    assert report["complete"] is False
    assert [row["n"] for row in report["rows"]] == [3, 3]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ik.json", "ik.png", "ik.rrd"]
    assert (tmp_path / "ik.rrd").stat().st_size > 10_000


def test_ctrl_c_before_anything_was_measured_names_no_file_that_is_not_there(
    tmp_path: Path,
) -> None:
    fields = {"uniform": Field(make=uniform, judge=Judge(PANDA))}
    solvers: dict[str, IkSolver] = {"impatient": Impatient(1)}
    comparison = Comparison(arm=Arm(PANDA), solvers=solvers, fields=fields, n=9, block=3, warm=0)
    screen = StringIO()
    options = CompareOptions(n=9, log=tmp_path / "ik.rrd")
    chosen = options, Console(file=screen, width=200)
    assert compare(comparison, *chosen, left_out={}, questions=()) == 130
    assert "interrupted; nothing was recorded yet" in screen.getvalue()
    assert [path.name for path in tmp_path.iterdir()] == ["ik.json"]
    assert "ik.json" in screen.getvalue()
    assert "ik.rrd" not in screen.getvalue()
    assert "ik.png" not in screen.getvalue()


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"n": 0}, "--n must be a whole number, 1 or more"),
        ({"seed": -1}, "--seed must be a whole number, 0 or more"),
        ({"log": Path("ik.txt")}, r"--log must be a file that ends with \.rrd"),
        ({"plot": Path("ik.gif")}, r"--plot must be a file that ends with \.png"),
    ],
)
def test_options_that_cannot_be_are_refused(wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidValueError, match=words):
        CompareOptions(**wrong)


def test_names_are_chosen_in_the_order_of_all() -> None:
    known = {"a": 1, "b": 2, "c": 3}
    assert chosen("solver", known, ()) == known
    assert list(chosen("solver", known, ("c", "a"))) == ["a", "c"]
    with pytest.raises(UnknownNameError, match="No solver is called 'd'; known: a, b, c"):
        chosen("solver", known, ("d",))


def test_without_choices_one_screen_answers_whether_dls_or_the_qp_is_better(
    tmp_path: Path,
) -> None:
    console = Console(file=StringIO(), width=80)
    assert compare_chosen(CompareOptions(n=4, log=tmp_path / "ik.rrd"), console) == 0
    assert isinstance(console.file, StringIO)
    lines = console.file.getvalue().splitlines()
    assert len(lines) <= 24
    text = " ".join(lines)
    assert "…" not in text
    assert "wider" not in text
    report = json.loads((tmp_path / "ik.json").read_text(encoding="utf-8"))
    for row in report["rows"]:
        (line,) = (line for line in lines if line.split()[0] == row["solver"])
        low, high = (f"{100 * bound:.1f}" for bound in row["interval"])
        assert f"{100 * row['success']:.1f} ({low} – {high})" in line
        if row["targets"] == "uniform":
            assert line.split()[-2:] == [f"{row['median_ms']:.2f}", f"{row['p99_ms']:.2f}"]
    for how, a, b in (
        ("From one start", "dls-tuned", "qp-daqp"),
        ("With restarts", "dls-tuned-multi", "qp-daqp-multi"),
    ):
        told = text.partition(how)[2]
        for test in report["paired"]:
            if (test["a"], test["b"]) == (a, b):
                assert f"{test['only_b']} to {test['only_a']} on {test['targets']}" in told


def test_a_second_comparison_with_the_same_files_is_refused(tmp_path: Path) -> None:
    log = tmp_path / "ik.rrd"
    log.write_text("of the first")
    options = CompareOptions(n=1, log=log, solvers=("lm",), targets=("uniform",))
    with (
        claimed(log),
        pytest.raises(RecordingError, match=r"ik\.rrd is being written by another process"),
    ):
        compare_chosen(options, Console(quiet=True))
    assert log.read_text() == "of the first"
