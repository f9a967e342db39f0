import json
from pathlib import Path

import pytest
from rich.console import Console

from robo47_qp.evaluation.benchmarks.ik import same_step
from scenarios.same_step import SameStepOptions, run


def test_it_tells_how_far_steps_are_from_exact_ones(tmp_path: Path) -> None:
    out = tmp_path / "same.json"
    assert run(SameStepOptions(n=6, report=out), Console(quiet=True)) == 0
    told = json.loads(out.read_text())
    assert {"command", "commit", "date", "machine", "versions"} <= told.keys()
    assert told["figures"]["lm"]["largest_from_exact_rad"] < 1e-9


def test_a_wrong_step_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    step = same_step.step_of
    monkeypatch.setattr(same_step, "step_of", lambda *of: step(*of) * (1.0 + 1e-6))
    options = SameStepOptions(n=3, report=tmp_path / "same.json")
    assert run(options, Console(quiet=True)) == 1
