"""TaskEpisode: an episode of a task in its own world, by the classical stack or by a policy."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from hashlib import sha256
from time import perf_counter
from typing import Any

import numpy as np

from robo47_qp.errors import InvalidValueError, PlanError
from robo47_qp.evaluation.episode import EpisodeResult, EpisodeSpec, exempt_findings, failed
from robo47_qp.evaluation.perturbation import Perturbation
from robo47_qp.files import plain
from robo47_qp.model.robot import Robot
from robo47_qp.report.audit.audit import audit
from robo47_qp.report.metrics import metrics
from robo47_qp.report.run_report import report, summary_markdown
from robo47_qp.run.failure import Cause, Failure, refusal
from robo47_qp.run.foreign_code import Blamed
from robo47_qp.run.runner import Driver, ProgramDriver, Runner
from robo47_qp.run.scenario import Run, Scenario
from robo47_qp.run.task import Task
from robo47_qp.sim.disturbance import DisturbedSimulation
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack

WALL = ("step_us", "real_time_factor")
"""Metrics that depend on wall time."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TaskEpisode:
    """Episodes of a task; see `Episode`.

    The world of an episode depends on its seed alone: scene, start and perturbation.
    """

    robot: Robot
    task: Task
    stack: ClassicalStack = ClassicalStack()
    """Inverse kinematics, controller and pace."""
    perturbation: Perturbation = Perturbation()
    time_limit: float | None = None
    """Simulated time for the task, in place of `Task.time_limit` [s]."""
    driver: Callable[[], Driver] = ProgramDriver
    """Returns the driver of an episode; sent to worker processes by pickle."""
    foreign: bool = False
    """See `Episode.foreign`."""

    def scenario(self, seed: int) -> Scenario:
        """Return the scenario of an episode."""
        task = self.task.variant(np.random.default_rng([seed, 2]))
        scenario = self.stack.scenario(self.robot, task, seed)
        if self.time_limit is None:
            return scenario
        return replace(scenario, watchdog=replace(scenario.watchdog, time_limit=self.time_limit))

    def simulation(
        self, scenario: Scenario, seed: int, *, drawn: bool = True
    ) -> DisturbedSimulation:
        """Return the world of an episode; `drawn` is that of `Simulation`."""
        rng = np.random.default_rng([seed, 1])
        disturbance = self.perturbation.draw(rng, scenario.task.usual_time)
        return DisturbedSimulation(
            self.robot,
            scenario.task.build_scene,
            disturbance,
            rng,
            goals_asked_for=scenario.task.goals_asked_for,
            drawn=drawn,
        )

    def __call__(self, spec: EpisodeSpec) -> EpisodeResult:
        """See `Episode`."""
        with Blamed(type(self.task)):
            return self._run(spec)

    def _run(self, spec: EpisodeSpec) -> EpisodeResult:
        started = perf_counter()
        scenario = self.scenario(spec.seed)
        simulation = self.simulation(scenario, spec.seed, drawn=spec.recording is not None)
        wrong = plain(simulation.disturbance)
        try:
            run = self._driven(spec, scenario, simulation)
        except (PlanError, InvalidValueError) as error:
            if isinstance(error, InvalidValueError) and not self.foreign:
                raise
            failure = Failure(cause=Cause.LIMIT, evidence=str(error))
            if isinstance(error, PlanError):
                failure = refusal(error)
            failure = replace(failure, time=simulation.time)
            timing = {"wall_s": perf_counter() - started}
            return failed(spec, failure, disturbance=wrong, timing=timing)
        return _judged(spec, run, wrong, started)

    def _driven(self, spec: EpisodeSpec, scenario: Scenario, simulation: Simulation) -> Run:
        runner = Runner(scenario, simulation, self.driver())
        if spec.recording is None:
            return runner.run()
        # Workers that record nothing start in less time without Rerun.
        from robo47_qp.report.rerun.log import RerunLog

        log = RerunLog(spec.recording, simulation.model, scenario.robot, runner.signals)
        try:
            run = runner.run(sinks=[log], observers=[log])
            log.finish(summary_markdown(report(run, metrics(run), audit(run))))
        finally:
            log.close()
        return run


def _judged(spec: EpisodeSpec, run: Run, wrong: dict[str, object], started: float) -> EpisodeResult:
    figures = {**metrics(run)}
    timing = {name: figures.pop(name) for name in WALL if name in figures}
    findings = audit(run)
    broken = tuple(finding.signal for finding in findings if not finding.ok)
    more: dict[str, Any] = {
        "measures": {k: plain(v) for k, v in run.measures.items()},
        "metrics": {k: plain(v) for k, v in figures.items() if k not in run.measures},
        # Where nothing was recorded, nothing was kept.
        "audit_ok": not broken if len(run.rows) else None,
        "broken_promises": broken,
        "exempt": exempt_findings(findings),
        "disturbance": wrong,
        "sha256": sha256(run.rows.values.data.cast("B") if len(run.rows) else b"").hexdigest(),
    }
    more["timing"] = {"wall_s": perf_counter() - started, **timing}
    if run.failure is not None:
        return failed(spec, run.failure, **more)
    return EpisodeResult(index=spec.index, seed=spec.seed, success=True, **more)
