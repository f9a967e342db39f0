"""An evaluation from its options to its files: one policy, or several on the same seeds."""

import json
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from robo47_qp.cli import FAILED, INTERRUPTED, OK
from robo47_qp.errors import InvalidValueError, RecordingError
from robo47_qp.evaluation.journal import Journal
from robo47_qp.evaluation.options import EvaluateOptions
from robo47_qp.evaluation.replay import evaluated, picked, record_failures, replay
from robo47_qp.evaluation.report.progress import EvaluationBar
from robo47_qp.evaluation.report.report import (
    EvaluationReport,
    PolicyComparison,
    check_paired,
    compare,
    compare_policies,
)
from robo47_qp.evaluation.report.words import (
    broken_line,
    cause_lines,
    causes_tail,
    comparison_line,
    counted,
    markdown,
    paired_markdown,
    rate_line,
    throughput_line,
)
from robo47_qp.files import check_writable, claimed, read_json, write_json, write_text
from robo47_qp.model.robot import Robot
from robo47_qp.report.provenance import provenance
from robo47_qp.run.task import Task

_COMPARISON = ("report", "text")
"""Files of `EvaluateOptions.files` that hold a comparison of several policies."""
_REPLACED = ("report", "text", "plot", "recording")
"""Files that an evaluation replaces; its journal is put aside."""
_LATE = "one of the two runs was ended by the limit of wall time (--timeout)"


class Job:
    """One policy on all seeds of an evaluation, and its files."""

    def __init__(self, task: Task, robot: Robot, options: EvaluateOptions) -> None:
        """Load the policy; the options are those of a single one.

        Raises:
            ClassLoadError: The policy cannot be loaded.
            InvalidValueError: The task is done before it begins.
        """
        self.origin = provenance()
        self.options, self.chosen = options, options.evaluation(task, robot)
        self.evaluation, self.executor = self.chosen.evaluation, self.chosen.executor

    def run(self, console: Console, title: str) -> EvaluationReport:
        """Run the episodes that the journal does not have, and write the report.

        Raises:
            ChangedError, JournalError, RecordingError, WorkerError: See `Evaluation.run`.
        """
        files = self.options.files
        with EvaluationBar(console, self.options.episodes, title) as bar:
            report = self.evaluation.run(self.executor, files["journal"], bar.results, resume=True)
        if self.options.against is not None:
            report = replace(report, comparison=compare(report, _other(self.options.against)))
        write_json(files["report"], self.told(report))
        return report

    @property
    def finished(self) -> bool:
        """True where the journal has an episode."""
        return bool(Journal.read(self.options.files["journal"], self.evaluation.settings))

    def told(self, report: EvaluationReport | PolicyComparison) -> dict[str, Any]:
        """Return what a report file holds: the report, and where it comes from."""
        return {**report.as_json(), "provenance": self.origin}

    def finish(self, report: EvaluationReport) -> EvaluationReport:
        """Record failures and write all files; returns the report with the replays.

        Raises:
            RecordingError, WorkerError: See `record_failures`.
        """
        files, failures = self.options.files, picked(report.results, self.options.failures)
        episode = self.evaluation.episode
        replayed = record_failures(episode, self.executor, failures, files["recording"])
        report = replace(report, replayed=replayed)
        write_json(files["report"], self.told(report))
        write_text(files["text"], markdown(report, [files["plot"].name]))
        _draw(report, files["plot"])
        return report


def _draw(report: EvaluationReport, path: Path) -> None:
    # Imported where it is drawn: an evaluation starts without Matplotlib.
    from robo47_qp.evaluation.report.plots import plot_evaluation

    plot_evaluation(report, path)


def evaluate(task: Task, robot: Robot, options: EvaluateOptions, console: Console) -> int:
    """Run an evaluation, or one episode of it, and write its files; returns the exit code.

    Of several policies, the first is the baseline.

    Returns:
        0 for a finished evaluation, whatever the success rate; 1 if an episode ended with an
        internal error or its replay differed; 130 for Ctrl-C.

    Raises:
        Robo47Error: Invalid input, or a file that cannot be written.
    """
    jobs = [Job(task, robot, one) for one in options.each]
    if options.replay is not None:
        return _replay(jobs[0], options.replay, console)
    with ExitStack() as stack:
        for path in dict.fromkeys([options.log, *(job.options.log for job in jobs)]):
            stack.enter_context(claimed(path))
        return _evaluated(jobs, options, console)


def _evaluated(jobs: Sequence[Job], options: EvaluateOptions, console: Console) -> int:
    """Run an evaluation whose files are this process's own; see `evaluate`."""
    several = len(jobs) > 1
    fresh = _prepare(jobs, options)
    if options.resume and fresh:
        told = f"nothing to continue, so from the first episode: no {', '.join(map(str, fresh))}"
        _print(console, [told])
    reports = []
    try:
        for job in jobs:
            name = job.options.contender.name
            reports.append(job.run(console, name if several else "episodes"))
            if several:
                _print(console, _outcome(name, reports[-1]))
    except KeyboardInterrupt:
        kept = "the finished episodes are kept: continue with --resume"
        done = any(job.finished for job in jobs)
        console.print(f"interrupted; {kept if done else 'no episode was finished'}")
        return INTERRUPTED
    # At the end: a resumed evaluation of several policies records the first ones only once.
    reports = [job.finish(report) for job, report in zip(jobs, reports, strict=True)]
    for job, report in zip(jobs, reports, strict=True):
        _print_unsound(report, job.options.files["journal"], console)
    if several:
        _conclude(jobs, reports, options, console)
    elif options.json:
        _print_json(jobs[0].told(reports[0]))
    else:
        _print(console, _summary(reports[0], options))
    return OK if all(report.sound for report in reports) else FAILED


def _prepare(jobs: Sequence[Job], options: EvaluateOptions) -> list[Path]:
    """Check files and pairing before anything runs, and create every journal.

    Returns the journals that were not there before.

    With --resume, all journals are read before one is opened, so that a refused evaluation leaves
    none with its settings. Without, all old ones are renamed now, so that a later --resume finds
    none of an earlier evaluation.
    """
    evaluations = [job.evaluation for job in jobs]
    every = [options.files, *(job.options.files for job in jobs)]
    for files in every:
        _check_replaced(files, options.against)
    if options.against is not None:
        seeds = [spec.seed for spec in evaluations[0].specs]
        check_paired(evaluations[0].settings, seeds, _other(options.against))
    for job in jobs:
        for path in (*job.options.files.values(), *(options.files[name] for name in _COMPARISON)):
            check_writable(path)
    journals = [(job.options.files["journal"], job.evaluation.settings) for job in jobs]
    fresh = [path for path, _ in journals if not path.exists()]
    if options.resume:
        for path, settings in journals:
            Journal.read(path, settings)
    # What an earlier evaluation left must not stand beside the beginning of this one.
    for files in every:
        for name in _REPLACED:
            files[name].unlink(missing_ok=True)
    for path, settings in journals:
        Journal(path, settings, resume=options.resume).close()
    return fresh


def _check_replaced(files: Mapping[str, Path], against: Path | None) -> None:
    """Check that the files to be replaced are an earlier evaluation's, and not needed.

    Raises:
        InvalidValueError: One of them is something else, or is to be compared with.
    """
    if against is not None and against.resolve() == files["report"].resolve():
        expected = "a report that is not written anew: name another --log"
        raise InvalidValueError("--against", against, expected)
    there = [files[name] for name in _REPLACED if files[name].exists()]
    if there and not files["journal"].exists() and not _is_report(files["report"]):
        expected = "a name that only files of evaluations have"
        raise InvalidValueError("--log", f"{there[0]}, which is none", expected)


def _is_report(path: Path) -> bool:
    try:
        return "provenance" in read_json(path, "")
    except RecordingError:
        return False


def _other(path: Path) -> EvaluationReport:
    """Read the report to compare with.

    Raises:
        RecordingError, InvalidValueError: There is no such file, or it is not a report.
    """
    content = read_json(path, "Make it with scenarios/evaluate.py.")
    try:
        return EvaluationReport.of_json(content)
    except (KeyError, TypeError) as error:
        found = f"{path} without {error}"
        raise InvalidValueError("--against", found, "a report of an evaluation") from error


def _replay(job: Job, seed: int, console: Console) -> int:
    """Run the episode of a seed again, recorded; returns the exit code."""
    options = job.options
    before = evaluated(job.evaluation, seed, options.files["journal"])
    path = options.log.with_name(f"{options.log.stem}-{job.chosen.task.name}-{seed}.rrd")
    report = path.with_suffix(".json")
    with claimed(path):
        check_writable(path)
        check_writable(report)
        report.unlink(missing_ok=True)
        executor = replace(job.chosen, workers=1, cluster="local").executor
        result, same = replay(job.evaluation, seed, executor, before, path)
        entry = {**result.entry(), "same_as_evaluated": same}
        write_json(report, entry)
    if options.json:
        _print_json(entry)
    else:
        words = "success" if result.success else f"{result.failure}: {result.explanation}"
        lines = [f"seed {seed}: {words}"]
        lines += [] if result.error is None else [f"  traceback  {report}"]
        if before is not None and result.error is None:
            words = {True: "yes", False: "NO", None: f"not compared: {_LATE}"}[same]
            lines.append(f"  identical to the evaluated episode: {words}")
        if result.audit_ok is not None:
            broken = ", ".join(result.broken_promises)
            lines.append(f"  audit kept: {'yes' if result.audit_ok else f'NO: {broken}'}")
        _print(console, [*lines, f"  recording  {path}"])
    return FAILED if result.error is not None or same is False else OK


def _conclude(
    jobs: Sequence[Job],
    reports: Sequence[EvaluationReport],
    options: EvaluateOptions,
    console: Console,
) -> None:
    """Write and print the comparison of several policies."""
    names = [job.options.files["report"].name for job in jobs]
    found = compare_policies(dict(zip(names, reports, strict=True)))
    told = jobs[0].told(found)
    write_json(options.files["report"], told)
    write_text(options.files["text"], paired_markdown(found))
    if options.json:
        _print_json(told)
        return
    lines = [comparison_line(comparison) for comparison in found.comparisons]
    lines += [f"  {name:<10} {options.files[name]}" for name in _COMPARISON]
    for name in ("report", "recording"):
        files = [job.options.files[name] for job in jobs]
        lines += [f"  {name:<10} {path}" for path in files if path.exists()]
    _print(console, lines)


def _outcome(name: str, report: EvaluationReport) -> list[str]:
    broken = broken_line(report)
    line = f"{name}: {rate_line(report)}{causes_tail(report)}"
    return [line, f"  {broken}"] if broken else [line]


def _summary(report: EvaluationReport, options: EvaluateOptions) -> list[str]:
    lines = [rate_line(report), *cause_lines(report)]
    if broken := broken_line(report):
        lines.append(broken)
    if report.comparison is not None:
        lines.append(comparison_line(report.comparison))
    if report.timing is not None:
        lines.append(throughput_line(report.timing))
    return lines + [f"  {n:<10} {path}" for n, path in options.files.items() if path.exists()]


def _print_unsound(report: EvaluationReport, journal: Path, console: Console) -> None:
    """Print internal errors, and replays that differed or were not compared."""
    if report.errors:
        count = counted(len(report.errors), "episode")
        console.print(f"[bold red]{count} ended with an internal error[/], the first:")
        _print(console, [report.errors[0].explanation, f"  tracebacks {journal}"])
    other = [seed for seed, same in report.replayed.items() if same is False]
    if other:
        console.print(f"[bold red]the replays of these seeds differed:[/] {other}")
    late = [seed for seed, same in report.replayed.items() if same is None]
    if late:
        _print(console, [f"the replays of these seeds were not compared: {late}; {_LATE}"])


def _print(console: Console, lines: Sequence[str]) -> None:
    console.print(escape("\n".join(lines)), highlight=False, soft_wrap=True)


def _print_json(content: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(content, indent=2, allow_nan=False) + "\n")
