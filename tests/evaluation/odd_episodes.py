"""Evaluations of a task that fails at odd times, run in the process of the tests."""

import json
import pickle
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from robo47_qp.evaluation import evaluation
from robo47_qp.evaluation.episode import Episode, EpisodeResult, EpisodeSpec
from robo47_qp.evaluation.options import EvaluateOptions
from robo47_qp.evaluation.workers.worker import run_guarded
from robo47_qp.run.failure import Cause, Failure
from robo47_qp.sim.simulation import Simulation
from tests.runs import Reach

QUIET = Console(quiet=True)


@dataclass(frozen=True, kw_only=True)
class Odd(Reach):
    """Gives up at odd times: a task that sometimes fails, and can have a bug."""

    rise: float = 0.005
    buggy: bool = False

    def verdict(self, simulation: Simulation) -> Failure | None:
        if self.buggy:
            raise ZeroDivisionError("a bug of ours")
        if simulation.time == 0.0:
            return Failure(cause=Cause.PLACE, evidence="nothing has moved")
        friction = float(simulation.model.geom("table").friction[0])
        if friction > 1.1:
            return Failure(cause=Cause.PLACE, evidence=f"friction {friction:.3f}")
        return None


def options(tmp_path: Path, **chosen: Any) -> EvaluateOptions:
    settings = {"episodes": 3, "workers": 2, "log": tmp_path / "eval.rrd"}
    settings["perturbations"] = {"friction": chosen.pop("friction", "0.7:1.3")}
    return EvaluateOptions(**{**settings, **chosen})


def read(tmp_path: Path, name: str = "eval.json") -> dict[str, Any]:
    found: dict[str, Any] = json.loads((tmp_path / name).read_text())
    return found


class InProcess:
    """Runs episodes here, as they come out of a pickle."""

    interrupted_after: int | None = None

    def __init__(self, *, workers: int, timeout: float) -> None:
        self.workers = workers

    def run(self, episode: Episode, specs: Sequence[EpisodeSpec]) -> Iterator[EpisodeResult]:
        episode = pickle.loads(pickle.dumps(episode))
        for k, spec in enumerate(specs):
            if k == self.interrupted_after:
                raise KeyboardInterrupt
            yield run_guarded(episode, spec)


@pytest.fixture(autouse=True, scope="module")
def in_process() -> Iterator[None]:
    """Starting workers takes longer than the episodes; tests of workers are elsewhere."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(evaluation, "LocalProcesses", InProcess)
        yield
