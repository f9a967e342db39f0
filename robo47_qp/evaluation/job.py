"""Job: one policy on all seeds of an evaluation, from its options to its files."""

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.episode import EpisodeResult
from robo47_qp.evaluation.evaluation import Evaluation, code_digest
from robo47_qp.evaluation.failures import picked, record_failures
from robo47_qp.evaluation.options import EvaluateOptions, policy_settings
from robo47_qp.evaluation.policies import CLASSICAL, Cell, PolicyDrive
from robo47_qp.evaluation.report.plots import plot_evaluation
from robo47_qp.evaluation.report.progress import EvaluationBar
from robo47_qp.evaluation.report.summary import summary, throughput
from robo47_qp.evaluation.report.words import counted, markdown
from robo47_qp.evaluation.task_episode import Drive, TaskEpisode, classical
from robo47_qp.evaluation.workers.executor import Executor, LocalProcesses
from robo47_qp.evaluation.workers.ray_cluster import RayCluster
from robo47_qp.files import claim, write_text
from robo47_qp.model.robot import Robot
from robo47_qp.report.run_report import plain, versions
from robo47_qp.run.task import Task


@dataclass(frozen=True, kw_only=True, eq=False)
class Job:
    """A policy, what it is to do, and where the results go."""

    task: Task
    robot: Robot
    options: EvaluateOptions
    """Of a single policy."""
    cell: Cell | None
    """Makes the runner of a policy other than the classical stack."""

    @cached_property
    def evaluation(self) -> Evaluation:
        """What is to be run.

        Raises:
            PolicyLoadError: The policy cannot be had.
            InvalidValueError: There is no cell for it.
        """
        return Evaluation(
            episode=self._episode(),
            settings=self._settings(),
            episodes=self.options.episodes,
            seed=self.options.seed,
        )

    @property
    def executor(self) -> Executor:
        """Where it is run."""
        options = self.options
        kind = RayCluster if options.cluster == "ray" else LocalProcesses
        return kind(workers=options.workers, timeout=options.timeout)

    def claim(self) -> None:
        """Make sure that all files but the journal, which does so itself, can be written.

        Raises:
            RecordingError: One cannot.
        """
        for name, path in self.options.files.items():
            if name != "journal":
                claim(path)

    def run(self, console: Console, *, resume: bool, title: str = "episodes") -> dict[str, Any]:
        """All episodes; their figures.

        Raises:
            JournalError, RecordingError, WorkerError: See `Evaluation.run`.
        """
        options = self.options
        with EvaluationBar(console, options.episodes, title) as bar:
            done = self.evaluation.run(
                self.executor, options.files["journal"], bar.show, resume=resume
            )
        figures = summary(self.evaluation.settings, done.results)
        figures["timing"] = throughput(done.fresh, done.seconds, options.workers)
        return figures

    def keep(self, figures: Mapping[str, Any]) -> None:
        """Write the report as JSON."""
        write_json(figures, self.options.files["report"])

    def finish(self, figures: dict[str, Any]) -> None:
        """Record failures, whose outcome goes into the figures, and write all files.

        Raises:
            RecordingError, WorkerError: See `record_failures`.
        """
        files = self.options.files
        results = [EpisodeResult.of_entry(entry) for entry in figures["entries"]]
        failures = picked(results, self.options.failures)
        figures["replayed"] = record_failures(
            self.evaluation.episode, self.executor, failures, files["recording"]
        )
        self.keep(figures)
        write_text(files["text"], markdown(figures, [files["plot"].name]))
        plot_evaluation(figures, files["plot"])

    def _episode(self) -> TaskEpisode:
        reference = self.options.contender.reference
        drive: Drive = classical
        if reference is not None:
            reference.load()
            if self.cell is None:
                raise InvalidValueError("--policy", self.options.contender.name, CLASSICAL)
            drive = PolicyDrive(reference=reference, cell=self.cell)
        return TaskEpisode(
            robot=self.robot,
            task=self.task,
            options=self.options.run_options,
            perturbation=self.options.perturbation,
            drive=drive,
            foreign=reference is not None,
        )

    def _settings(self) -> dict[str, Any]:
        """All that results depend on."""
        reference, own = self.options.contender.reference, Path(__file__).resolve().parents[1]
        tasks = Path(sys.modules[type(self.task).__module__].__file__ or "")
        digest = None if reference is None else reference.digest
        return {
            "task": plain(self.task),
            "robot": self.robot.name,
            "policy": policy_settings(self.options, digest),
            "perturbation": plain(self.options.perturbation),
            "speed": self.options.speed,
            "timeout": self.options.timeout,
            "code": code_digest([own, tasks.parent]),
            "versions": versions(),
        }


def sound(figures: Mapping[str, Any]) -> bool:
    """True where no episode ended with an error of our own, and replays were the same."""
    return not figures["errors"] and False not in figures["replayed"].values()


def print_unsound(figures: Mapping[str, Any], console: Console) -> None:
    """Tell what is not `sound`."""
    if figures["errors"]:
        errors = [e["error"] for e in figures["entries"] if e["error"] is not None]
        console.print(
            f"[bold red]{counted(len(errors), 'episode')} ended with an error of our own[/], "
            "the first:"
        )
        console.print(escape(errors[0]), highlight=False)
    other = [seed for seed, same in figures["replayed"].items() if same is False]
    if other:
        console.print(f"[bold red]replayed, these seeds came out otherwise:[/] {other}")


def write_json(content: Mapping[str, Any], path: Path) -> None:
    """Write a JSON file.

    Raises:
        RecordingError: It cannot be written.
    """
    write_text(path, json.dumps(content, indent=2, allow_nan=False))
