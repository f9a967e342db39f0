"""An evaluation from its options to its files."""

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from robo47_qp.command import FAILED, INTERRUPTED, OK
from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.episode import EpisodeResult, EpisodeSpec
from robo47_qp.evaluation.evaluation import Evaluation, code_digest
from robo47_qp.evaluation.executor import Executor, LocalProcesses
from robo47_qp.evaluation.failures import is_same, picked, record_failures
from robo47_qp.evaluation.journal import Journal, JournalError
from robo47_qp.evaluation.options import EvaluateOptions, policy_settings
from robo47_qp.evaluation.plots import plot_evaluation
from robo47_qp.evaluation.policy import CLASSICAL, Cell, PolicyDrive, PolicyReference
from robo47_qp.evaluation.progress import EvaluationBar
from robo47_qp.evaluation.ray_cluster import RayCluster
from robo47_qp.evaluation.summary import compared, summary, throughput
from robo47_qp.evaluation.task_episode import Drive, TaskEpisode, classical
from robo47_qp.evaluation.words import comparison_line, markdown, rate_line, throughput_line
from robo47_qp.files import claim, write_text
from robo47_qp.json_file import read_json
from robo47_qp.report import plain, versions
from robo47_qp.robot import Robot
from robo47_qp.task import Task


def evaluate(
    task: Task, robot: Robot, options: EvaluateOptions, console: Console, cell: Cell | None = None
) -> int:
    """Run an evaluation, or one episode of it, and write its files; returns the exit code.

    Args:
        task: What is to be done.
        robot: Who does it.
        options: All that was chosen.
        console: Where progress and the outcome are printed.
        cell: Makes the runner of a policy other than the classical stack.

    Returns:
        0 where it is done, whatever the success rate; 1 where an episode ended with an error of
        our own, or came out otherwise when it was replayed; 130 for Ctrl-C.

    Raises:
        Robo47Error: Bad input, or a file that cannot be written.
    """
    job = _Job(task=task, robot=robot, options=options, cell=cell)
    if options.replay is not None:
        return _replay(job, options.replay, console)
    evaluation = Evaluation(
        episode=job.episode(),
        settings=job.settings(),
        episodes=options.episodes,
        seed=options.seed,
    )
    against = _against(options, evaluation)
    for name, path in options.files.items():
        if name != "journal":
            claim(path)
    executor = job.executor()
    try:
        with EvaluationBar(console, options.episodes) as bar:
            done = evaluation.run(
                executor, options.files["journal"], bar.show, resume=options.resume
            )
    except KeyboardInterrupt:
        console.print("interrupted; all finished episodes are kept: go on with --resume")
        return INTERRUPTED
    figures = summary(evaluation.settings, done.results)
    if against is not None:
        figures["comparison"] = compared(figures, against)
    figures["timing"] = throughput(done.fresh, done.seconds, options.workers)
    _write(figures, options)
    failures = picked(done.results, options.failures)
    figures["replayed"] = record_failures(
        evaluation.episode, executor, failures, options.files["recording"]
    )
    _write(figures, options)
    _print_end(figures, options, console)
    return OK if _sound(figures) else FAILED


@dataclass(frozen=True, kw_only=True, eq=False)
class _Job:
    task: Task
    robot: Robot
    options: EvaluateOptions
    cell: Cell | None

    @property
    def policy(self) -> PolicyReference | None:
        """None for the classical stack."""
        name = self.options.policy
        return None if name == CLASSICAL else PolicyReference(text=name).absolute

    def episode(self) -> TaskEpisode:
        drive: Drive = classical
        if self.policy is not None:
            self.policy.load()
            if self.cell is None:
                raise InvalidValueError("--policy", self.options.policy, CLASSICAL)
            drive = PolicyDrive(reference=self.policy, cell=self.cell)
        return TaskEpisode(
            robot=self.robot,
            task=self.task,
            options=self.options.run_options,
            perturbation=self.options.perturbation,
            drive=drive,
            foreign=self.policy is not None,
        )

    def settings(self) -> dict[str, Any]:
        """All that results depend on."""
        policy, own = self.policy, Path(__file__).resolve().parents[1]
        tasks = Path(sys.modules[type(self.task).__module__].__file__ or "")
        digest = None if policy is None else policy.digest
        return {
            "task": plain(self.task),
            "robot": self.robot.name,
            "policy": policy_settings(self.options, digest),
            "perturbation": plain(self.options.perturbation),
            "timeout": self.options.timeout,
            "code": code_digest([own, tasks.parent]),
            "versions": versions(),
        }

    def executor(self) -> Executor:
        options = self.options
        kind = RayCluster if options.cluster == "ray" else LocalProcesses
        return kind(workers=options.workers, timeout=options.timeout)


def _replay(job: _Job, seed: int, console: Console) -> int:
    """One episode with its recording, in a process as all others."""
    options, settings = job.options, job.settings()
    path = options.log.with_name(f"{options.log.stem}-{job.task.name}-{seed}.rrd")
    report = path.with_suffix(".json")
    for file in (path, report):
        claim(file)
    before = _journalled(options, settings, seed)
    executor = LocalProcesses(workers=1, timeout=options.timeout)
    index = seed - options.seed if before is None else before.index
    spec = EpisodeSpec(index=index, seed=seed, recording=path.resolve())
    (result,) = executor.run(job.episode(), [spec])
    same = None if before is None else is_same(before, result)
    entry = {**result.entry(), "same_as_evaluated": same}
    _write_json(entry, report)
    if options.json:
        sys.stdout.write(json.dumps(entry, indent=2) + "\n")
    else:
        words = "success" if result.success else f"{result.failure}: {result.evidence}"
        console.print(f"seed {seed}: {escape(words)}", highlight=False)
        if result.error is not None:
            console.print(escape(result.error), highlight=False)
        if same is not None:
            console.print(f"  as in the evaluation, bit by bit: {'yes' if same else 'NO'}")
        console.print(f"  recording  {path}", highlight=False, soft_wrap=True)
    return FAILED if result.error is not None or same is False else OK


def _journalled(
    options: EvaluateOptions, settings: Mapping[str, Any], seed: int
) -> EpisodeResult | None:
    """What the evaluation with these settings, if there is one, says of an episode."""
    try:
        return Journal.read(options.files["journal"], settings).get(seed)
    except JournalError:
        return None


def _against(options: EvaluateOptions, evaluation: Evaluation) -> dict[str, Any] | None:
    """The result to compare with, known to be of the same worlds before anything runs."""
    if options.against is None:
        return None
    other = read_json(options.against, "Make it with scenarios/evaluate.py.")
    entries = [{"seed": spec.seed, "success": False} for spec in evaluation.specs]
    try:
        compared({"policy": "", "settings": evaluation.settings, "entries": entries}, other)
    except (KeyError, TypeError) as error:
        raise InvalidValueError(
            "--against", f"{options.against} without {error}", "a report of an evaluation"
        ) from error
    return other


def _sound(figures: Mapping[str, Any]) -> bool:
    return not figures["errors"] and all(figures["replayed"].values())


def _write(figures: Mapping[str, Any], options: EvaluateOptions) -> None:
    files = options.files
    _write_json(figures, files["report"])
    write_text(files["text"], markdown(figures, [files["plot"].name]))
    plot_evaluation(figures, files["plot"])


def _write_json(content: Mapping[str, Any], path: Path) -> None:
    write_text(path, json.dumps(content, indent=2, allow_nan=False))


def _print_end(figures: Mapping[str, Any], options: EvaluateOptions, console: Console) -> None:
    if options.json:
        sys.stdout.write(json.dumps(figures, indent=2, allow_nan=False) + "\n")
        return
    lines = [rate_line(figures)]
    lines += [f"  {cause:<10} {count}" for cause, count in figures["causes"].items()]
    if "comparison" in figures:
        lines.append(comparison_line(figures["comparison"]))
    if figures["timing"]:
        lines.append(throughput_line(figures["timing"]))
    lines += [f"  {name:<10} {path}" for name, path in options.files.items() if path.exists()]
    console.print(escape("\n".join(lines)), highlight=False, soft_wrap=True)
    if figures["errors"]:
        errors = [e["error"] for e in figures["entries"] if e["error"] is not None]
        console.print(
            f"[bold red]{len(errors)} episodes ended with an error of our own[/], the first:"
        )
        console.print(escape(errors[0]), highlight=False)
    other = [seed for seed, same in figures["replayed"].items() if not same]
    if other:
        console.print(f"[bold red]replayed, these seeds came out otherwise:[/] {other}")
