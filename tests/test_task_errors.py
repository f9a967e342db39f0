"""Tasks whose code is wrong: told in a line with its place, and nothing of it is judged."""

from pathlib import Path
from typing import Any

import pytest
from rerun.chunk import RrdReader

from robo47_qp.__main__ import main as robo47
from tests.commands import recorded

TASK = """
from dataclasses import dataclass

from robo47_qp.run.steps import Wait
from robo47_qp.run.task import Task
from robo47_qp.tasks.table import add_table


@dataclass(frozen=True, kw_only=True)
class Broken(Task):
    name: str = "broken"

    def build_scene(self, spec):
        add_table(spec)

    def program(self, sensed):
        yield Wait(seconds=0.1)

    def verdict(self, simulation):
        return None
"""
WAIT, VERDICT, SCENE = "        yield Wait(seconds=0.1)\n", "return None", "add_table(spec)"
RAISES = (WAIT, f"{WAIT}        1 / 0\n")


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "1000")
    return tmp_path


def written(folder: Path, old: str, new: str) -> str:
    assert TASK.count(old) == 1
    (folder / "bad.py").write_text(TASK.replace(old, new), encoding="utf-8")
    return "bad.py:Broken"


@pytest.mark.parametrize(
    ("mistake", "told"),
    [
        (RAISES, "The program of broken raised ZeroDivisionError: division by zero, at bad.py:18."),
        (
            (WAIT, f"{WAIT}        yield 5\n"),
            "The program of broken raised InvalidValueError: what a program yields must be a Step, "
            "a Waypoint or a tuple of Waypoints; found 5, at bad.py:18.",
        ),
        (
            (WAIT, f"{WAIT}        return 5\n"),
            "What the program of broken returns must be a Failure, or None for a success; found 5.",
        ),
        ((WAIT, "        return\n"), "The program of broken must yield its steps; found None."),
        (
            (VERDICT, "return True"),
            "The verdict of broken must be a Failure, or None for a success; found True.",
        ),
        (
            (VERDICT, "return simulation.nothing"),
            "The verdict of broken raised AttributeError: 'Simulation' object has no attribute "
            "'nothing', at bad.py:20.",
        ),
    ],
    ids=["raises", "yields", "returns", "none", "judges", "misjudges"],
)
def test_an_error_is_told_with_its_line_and_what_was_recorded_is_kept(
    mistake: tuple[str, str], told: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert robo47(["run", written(here, *mistake)]) == 2
    said = capsys.readouterr()
    assert said.err == f"error: {told} The traceback is in logs/run.rrd.\n"
    assert said.out == ""
    assert [path.name for path in (here / "logs").iterdir()] == ["run.rrd"]
    events = [
        str(chunk.to_record_batch().to_pydict())
        for chunk in RrdReader(here / "logs" / "run.rrd").stream()
        if str(chunk.entity_path).strip("/") == "events"
    ]
    assert any("Traceback" in event and "ERROR" in event for event in events)
    if WAIT in mistake[1]:
        assert len(recorded(here / "logs" / "run.rrd")) == 100


def test_an_error_before_anything_moves_leaves_the_last_run(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "logs").mkdir()
    (here / "logs" / "run.json").write_text("of an earlier run")
    assert robo47(["run", written(here, SCENE, "spec['table']")]) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: The build_scene of broken raised TypeError: ")
    assert said.endswith(", at bad.py:14.\n")
    assert [path.name for path in (here / "logs").iterdir()] == ["run.json"]


def test_an_error_in_an_evaluation_is_a_line_and_no_rate(
    here: Path, capsys: pytest.CaptureFixture[Any]
) -> None:
    told = "The program of broken raised ZeroDivisionError: division by zero, at bad.py:18."
    chosen = ["evaluate", "--task", written(here, *RAISES), "--episodes", "1", "--workers", "1"]
    assert robo47(chosen) == 1
    said = capsys.readouterr().out
    assert f"1 episode ended with an internal error, the first:\n{told}\n" in said
    assert "no episode was judged\n" in said
    assert "Traceback" not in said
    assert "Traceback" in (here / "logs" / "eval.jsonl").read_text(encoding="utf-8")
    assert robo47([*chosen, "--replay", "0"]) == 1
    said = capsys.readouterr().out
    assert said.splitlines()[0] == f"seed 0: error: {told}"
    assert "Traceback" not in said
