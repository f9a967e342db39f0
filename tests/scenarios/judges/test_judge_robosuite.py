"""What is told of episodes that robosuite judged: counts, causes, and the table of a page."""

import json
from pathlib import Path
from typing import Any

import pytest

from robo47_qp.errors import InvalidValueError, UnknownNameError
from scenarios import judge_robosuite
from scenarios.judge_robosuite import JudgeOptions, finished, summary
from scenarios.papers import judges

ORIGIN = {"commit": "0123456789abcdef", "date": "2026-01-02"}
MADE = {"commit": ORIGIN["commit"], "changed": False}
MINE = {"commit": ORIGIN["commit"], "seeds": [1, 4]}


def line(seed: int, **more: Any) -> dict[str, Any]:
    figures = {"success": True, "cause": "", "seconds": 5.0, "speed": 0.5, "saturated": 0.0}
    return {"task": "Lift", "seed": seed, "noisy": False, **figures, **more}


LINES = [
    line(1),
    line(2, seconds=7.0, speed=0.8, saturated=0.2),
    line(3, success=False, cause="grasp: the fingers closed to 0.1 mm", seconds=1.0),
    line(4, success=False, cause="verdict", saturated=0.1),
    {"task": "Lift", "seed": 5, "noisy": False, "success": False, "error": "it broke"},
]


def test_episodes_that_broke_down_are_not_judged() -> None:
    row = summary("Lift", LINES, noisy=False)
    assert (row["judged"], row["successes"], row["errors"]) == (4, 2, 1)
    assert row["causes"] == {"grasp": 1, "verdict": 1}
    assert (row["seconds"], row["speed"], row["saturated"]) == (6.0, 0.8, 0.05)
    # Wilson (1927) by hand: p = 1/2, n = 4, z = 1.96.
    assert row["interval"] == pytest.approx([0.150, 0.850], abs=5e-4)


def test_without_a_judged_episode_nothing_is_claimed() -> None:
    row = summary("Lift", LINES[4:], noisy=True)
    assert (row["judged"], row["interval"], row["seconds"]) == (0, [0.0, 1.0], None)


def test_the_table_has_a_row_for_each_task(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [{**summary("Lift", LINES, noisy=noisy), **MINE} for noisy in (False, True)]
    found = {**ORIGIN, "rows": rows}
    monkeypatch.setattr(judges, "is_kept", lambda name: name == "judge_robosuite")
    monkeypatch.setattr(judges, "kept", {"judge_robosuite": found}.__getitem__)
    first, second, _, origin = judges.robosuite().splitlines()[2:]
    cells = [cell.strip() for cell in first.split("|")][1:-1]
    assert cells[:3] == ["`Lift`", "none", "2 of 4"]
    assert cells[3:5] == ["15.0–85.0 %", "grasp 1, verdict 1"]
    assert cells[5:] == ["6.0 s", "80 %", "5.0 %", "100 %", "1–4", "`0123456`"]
    assert second.startswith("| `Lift` | 2 mm, 2° |")
    assert second.endswith("| – | 1–4 | `0123456` |")
    assert origin.startswith("Commit `0123456789`")


def test_what_cannot_be_judged_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(judge_robosuite, "JUDGE", tmp_path)
    JudgeOptions(tasks=("Lift",))
    with pytest.raises(UnknownNameError, match="Fold"):
        JudgeOptions(tasks=("Fold",))
    with pytest.raises(InvalidValueError, match=r"poses must be true, noisy, or both"):
        JudgeOptions(tasks=("Wipe",), true_poses=False)
    monkeypatch.setattr(judge_robosuite, "JUDGE", tmp_path / "none")
    with pytest.raises(InvalidValueError, match="make judges"):
        JudgeOptions()


def test_true_and_noisy_poses_are_judged_as_asked_for(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(judge_robosuite, "JUDGE", tmp_path)
    tasks = ("Lift", "Wipe")
    both = [("Lift", False), ("Wipe", False), ("Lift", True)]
    assert JudgeOptions(tasks=tasks).asked == both
    assert JudgeOptions(tasks=tasks, noise=False).asked == both[:2]
    assert JudgeOptions(tasks=tasks, true_poses=False).asked == both[2:]


def report(path: Path, **more: Any) -> JudgeOptions:
    """Options to go on with a report of Lift, whole, and Stack, in which an episode broke down."""
    rows = [summary("Lift", LINES[:4], noisy=False), summary("Stack", LINES, noisy=False)]
    failures = [LINES[2], {**LINES[4], "task": "Stack"}]
    found = {"changed": False, "rows": [{**row, **MINE, **more} for row in rows]}
    path.write_text(json.dumps({**found, "failures": failures}))
    return JudgeOptions(seed=1, episodes=4, report=path, resume=True)


@pytest.fixture
def path(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setattr(judge_robosuite, "JUDGE", tmp_path)
    return tmp_path / "report.json"


def test_resuming_keeps_whole_rows(path: Path) -> None:
    rows, failures = finished(report(path), MADE, [("Lift", False), ("Stack", False)])
    assert [row["task"] for row in rows] == ["Lift"]  # an episode of Stack broke down
    assert failures == [LINES[2]]


@pytest.mark.parametrize("other", [{"commit": "fedcba"}, {"seeds": [1, 5]}, {"seeds": [2, 5]}])
def test_resuming_judges_anew_what_is_asked_for_and_of_another_run(
    path: Path, other: dict[str, Any]
) -> None:
    options = report(path, **other)
    assert finished(options, MADE, [("Lift", False), ("Stack", False)]) == ([], [])
    rows, failures = finished(options, MADE, [("Lift", True), ("Stack", False)])
    assert [row["task"] for row in rows] == ["Lift"]
    assert failures == [LINES[2]]


@pytest.mark.parametrize(("theirs", "mine"), [(True, False), (False, True)])
def test_rows_that_no_commit_makes_are_not_resumed(path: Path, theirs: bool, mine: bool) -> None:
    options = report(path)
    found = json.loads(path.read_text())
    path.write_text(json.dumps({**found, "changed": theirs}))
    with pytest.raises(InvalidValueError, match="without changes of files"):
        finished(options, {**MADE, "changed": mine}, [("Lift", False)])
