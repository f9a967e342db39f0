"""A run that ends before its first control period is over is told like any other."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robo47_qp.cli import FAILED, run_command
from robo47_qp.errors import ArmStopped
from robo47_qp.evaluation.episode import EpisodeSpec
from robo47_qp.evaluation.task_episode import TaskEpisode
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run.control_loop import ControlLoop
from robo47_qp.run.failure import Cause
from robo47_qp.tasks.reach.reach import Reach


@pytest.fixture
def _stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(*_: Any, **__: Any) -> None:
        raise ArmStopped("the cable is out")

    monkeypatch.setattr(ControlLoop, "_run", stopped)


@pytest.mark.usefixtures("_stopped")
def test_a_run_without_rows_is_a_failure_with_its_cause(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "run.rrd"
    assert run_command("reach", args=["--log", str(log)], prog="run") == FAILED
    assert "the cable is out" in capsys.readouterr().out
    assert {path.name for path in tmp_path.iterdir()} == {"run.rrd", "run.json", "run.png"}


@pytest.mark.usefixtures("_stopped")
@pytest.mark.parametrize("recorded", [False, True])
def test_so_is_an_episode(recorded: bool, tmp_path: Path) -> None:
    recording = tmp_path / "episode.rrd" if recorded else None
    episode = TaskEpisode(robot=PANDA, task=Reach())
    result = episode(EpisodeSpec(index=0, seed=3, recording=recording))
    assert (result.cause, result.audit_ok) == (Cause.ARM.value, None)
    assert result.metrics is not None
    assert all(np.isfinite(value) for value in result.metrics.values())
