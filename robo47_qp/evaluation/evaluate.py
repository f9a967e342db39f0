"""An evaluation from its options to its files."""

import json
import sys
from typing import Any

from rich.console import Console
from rich.markup import escape

from robo47_qp.cli import FAILED, INTERRUPTED, OK
from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.evaluation import Evaluation
from robo47_qp.evaluation.job import Job, print_unsound, sound
from robo47_qp.evaluation.options import EvaluateOptions
from robo47_qp.evaluation.policies import Cell
from robo47_qp.evaluation.replay import replay
from robo47_qp.evaluation.report.summary import compared
from robo47_qp.evaluation.report.words import (
    broken_line,
    cause_lines,
    comparison_line,
    rate_line,
    throughput_line,
)
from robo47_qp.evaluation.several import evaluate_several
from robo47_qp.files import read_json
from robo47_qp.model.robot import Robot
from robo47_qp.run.task import Task


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
    jobs = [Job(task=task, robot=robot, options=one, cell=cell) for one in options.each]
    if len(jobs) > 1:
        return evaluate_several(jobs, options, console)
    if options.replay is not None:
        return replay(jobs[0], options.replay, console)
    return _evaluate_one(jobs[0], console)


def _evaluate_one(job: Job, console: Console) -> int:
    options = job.options
    against = _against(options, job.evaluation)
    job.claim()
    try:
        figures = job.run(console, resume=options.resume)
    except KeyboardInterrupt:
        console.print("interrupted; all finished episodes are kept: go on with --resume")
        return INTERRUPTED
    if against is not None:
        figures["comparison"] = compared(figures, against)
    # First of all, what took long: the rest can be made again from the journal.
    job.keep(figures)
    job.finish(figures)
    _print_end(figures, options, console)
    return OK if sound(figures) else FAILED


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


def _print_end(figures: dict[str, Any], options: EvaluateOptions, console: Console) -> None:
    print_unsound(figures, console)
    if options.json:
        sys.stdout.write(json.dumps(figures, indent=2, allow_nan=False) + "\n")
        return
    lines = [rate_line(figures)]
    lines += cause_lines(figures)
    if broken := broken_line(figures):
        lines.append(broken)
    if "comparison" in figures:
        lines.append(comparison_line(figures["comparison"]))
    if figures["timing"]:
        lines.append(throughput_line(figures["timing"]))
    lines += [f"  {name:<10} {path}" for name, path in options.files.items() if path.exists()]
    console.print(escape("\n".join(lines)), highlight=False, soft_wrap=True)
