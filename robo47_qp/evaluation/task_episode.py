"""TaskEpisode: an episode of a task in its own world, driven by the stack or by a policy."""

from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from time import perf_counter
from typing import Any, Protocol

import numpy as np

from robo47_qp.errors import (
    InvalidValueError,
    PlanError,
    RefusalReason,
    Robo47Error,
)
from robo47_qp.evaluation.episode import EpisodeResult, EpisodeSpec, failed
from robo47_qp.evaluation.perturbation import Perturbation
from robo47_qp.evaluation.policies import PolicyFailed
from robo47_qp.model.robot import Robot
from robo47_qp.report.audit.audit import audit
from robo47_qp.report.metrics import metrics
from robo47_qp.report.rerun.log import RerunLog
from robo47_qp.report.run_report import plain, report, summary_markdown
from robo47_qp.run import signals
from robo47_qp.run.failure import Cause, Failure
from robo47_qp.run.observers import Observer
from robo47_qp.run.recording import Sink
from robo47_qp.run.runner import Runner
from robo47_qp.run.scenario import Run, Scenario
from robo47_qp.run.task import Task
from robo47_qp.sim.disturbance import DisturbedSimulation
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack


class Drive(Protocol):
    """Brings a scenario from its start to its end; goes to worker processes by pickle."""

    def __call__(
        self,
        scenario: Scenario,
        simulation: Simulation,
        *,
        sinks: Sequence[Sink],
        observers: Sequence[Observer],
    ) -> Run:
        """Reset simulation and task from the scenario's seed, and run.

        Raises:
            PolicyFailed: The policy raised something.
            InvalidValueError: A command is none that can be carried out.
        """
        ...


def classical(
    scenario: Scenario,
    simulation: Simulation,
    *,
    sinks: Sequence[Sink],
    observers: Sequence[Observer],
) -> Run:
    """The classical stack; see `Drive`."""
    return Runner(scenario, simulation).run(sinks=sinks, observers=observers)


def recorded(drive: Drive, scenario: Scenario, simulation: Simulation, path: Path) -> Run:
    """Drive an episode and record it.

    Raises:
        RecordingError: The recording cannot be written.
        Robo47Error: See `Drive`; what was recorded up to there is kept.
    """
    columns = signals.all_signals(scenario.robot, simulation.objects)
    log = RerunLog(path, simulation.model, scenario.robot, columns)
    try:
        run = drive(scenario, simulation, sinks=[log], observers=[log])
        log.finish(summary_markdown(report(run, metrics(run), audit(run))))
    finally:
        log.close()
    return run


WALL = ("step_us", "real_time_factor")
"""Metrics of wall time."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TaskEpisode:
    """Episodes of a task under a drive; see `Episode`.

    The world is drawn from the episode's seed alone: scene, start, perturbation.
    """

    robot: Robot
    task: Task
    stack: ClassicalStack = ClassicalStack()
    """Inverse kinematics, controller and pace."""
    perturbation: Perturbation = Perturbation()
    drive: Drive = classical
    foreign: bool = False
    """See `Episode.foreign`."""

    def scenario(self, seed: int) -> Scenario:
        """The scenario of an episode."""
        task = self.task.variant(np.random.default_rng([seed, 2]))
        return self.stack.scenario(self.robot, task, seed)

    def simulation(self, scenario: Scenario, seed: int) -> DisturbedSimulation:
        """The world of an episode."""
        rng = np.random.default_rng([seed, 1])
        disturbance = self.perturbation.draw(rng)
        return DisturbedSimulation(self.robot, scenario.task.build_scene, disturbance, rng)

    def __call__(self, spec: EpisodeSpec) -> EpisodeResult:
        """See `Episode`."""
        started = perf_counter()
        scenario = self.scenario(spec.seed)
        simulation = self.simulation(scenario, spec.seed)
        wrong = plain(simulation.disturbance)
        try:
            run = self._driven(spec, scenario, simulation)
        except (PolicyFailed, PlanError, InvalidValueError) as error:
            if isinstance(error, InvalidValueError) and not self.foreign:
                raise
            failure = Failure(cause=_cause(error), evidence=str(error), time=simulation.time)
            timing = {"wall_s": perf_counter() - started}
            return failed(spec, failure, disturbance=wrong, timing=timing)
        return _judged(spec, run, wrong, started)

    def _driven(self, spec: EpisodeSpec, scenario: Scenario, simulation: Simulation) -> Run:
        if spec.recording is None:
            return self.drive(scenario, simulation, sinks=(), observers=())
        # Drawing is for the few episodes that someone looks at.

        return recorded(self.drive, scenario, simulation, spec.recording)


def _judged(spec: EpisodeSpec, run: Run, wrong: dict[str, object], started: float) -> EpisodeResult:
    figures = {**metrics(run)}
    timing = {name: figures.pop(name) for name in WALL if name in figures}
    broken = tuple(finding.signal for finding in audit(run) if not finding.ok)
    more: dict[str, Any] = {
        "measures": _plain(run.measures),
        "metrics": _plain({k: v for k, v in figures.items() if k not in run.measures}),
        "audit_ok": not broken,
        "broken_promises": broken,
        "disturbance": wrong,
        "sha256": sha256(run.rows.values.tobytes()).hexdigest(),
    }
    more["timing"] = {"wall_s": perf_counter() - started, **timing}
    if run.failure is not None:
        return failed(spec, run.failure, **more)
    return EpisodeResult(index=spec.index, seed=spec.seed, success=True, **more)


def _plain(figures: dict[str, float]) -> dict[str, object]:
    return {name: plain(value) for name, value in figures.items()}


def _cause(error: Robo47Error) -> Cause:
    if not isinstance(error, PlanError):
        return Cause.LIMIT
    rejection = error.rejection
    unreached = rejection is None or rejection.reason is RefusalReason.REACH
    return Cause.IK if unreached else Cause.PLAN
