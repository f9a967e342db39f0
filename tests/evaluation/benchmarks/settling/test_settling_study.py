"""Studies of settling times: what they print and report, and starts that do not settle."""

import json
from io import StringIO
from math import inf
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.benchmarks.settling.study import StudyOptions, conclude


def concluded(path: Path, times: list[float]) -> tuple[bool, str]:
    text = StringIO()
    console = Console(file=text, width=200)
    options = StudyOptions(report=path, seconds=3.0, starts=len(times), seed=4)
    columns = {"offset": [f"#{i}" for i in range(len(times))]}
    return conclude(options, np.array(times), columns, {"more": [1]}, console), text.getvalue()


def test_the_mean_is_told_and_reported(tmp_path: Path) -> None:
    path = tmp_path / "new" / "study.json"
    good, text = concluded(path, [0.2, 0.5, 0.3, 0.6])
    assert good
    assert "mean settling time 0.4000 s" in text
    assert "standard deviation 0.1581 s" in text
    assert [line.split() for line in text.splitlines() if "#" in line] == [
        ["0", "#0", "0.2000"],
        ["1", "#1", "0.5000"],
        ["2", "#2", "0.3000"],
        ["3", "#3", "0.6000"],
    ]
    report = json.loads(path.read_text())
    assert report["metrics"] == {
        "mean_settling_time_s": pytest.approx(0.4),
        "shortest_settling_time_s": 0.2,
        "longest_settling_time_s": 0.6,
    }
    assert report["settling_times_s"] == [0.2, 0.5, 0.3, 0.6]
    assert report["settings"] == {"seconds": 3.0, "starts": 4, "seed": 4, "band": 0.02}
    assert report["more"] == [1]


def test_a_start_that_does_not_settle_leaves_no_mean_and_no_old_report(tmp_path: Path) -> None:
    path = tmp_path / "study.json"
    path.write_text("the last one")
    good, text = concluded(path, [0.2, inf, inf])
    assert not good
    assert "2 of 3 starts did not settle within 3.0 s" in text
    assert "mean settling time" not in text
    assert not path.exists()


@pytest.mark.parametrize(
    ("choice", "value"),
    [("starts", 0), ("seed", -1), ("seconds", 0.0), ("seconds", np.nan), ("seconds", 1e9)],
)
def test_choices_out_of_range_are_told(tmp_path: Path, choice: str, value: float) -> None:
    choices = {"report": tmp_path / "a.json", "seconds": 1.0, choice: value}
    with pytest.raises(InvalidValueError, match=f"--{choice} must be .*; found {value}"):
        StudyOptions(**choices)  # type: ignore[arg-type]
