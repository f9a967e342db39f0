"""Several policies evaluated on the same seeds, one after the other, and compared."""

import json
import sys
from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.markup import escape

from robo47_qp.cli import FAILED, INTERRUPTED, OK
from robo47_qp.evaluation.job import (
    Job,
    print_unsound,
    sound,
    write_json,
)
from robo47_qp.evaluation.journal import Journal
from robo47_qp.evaluation.options import EvaluateOptions
from robo47_qp.evaluation.report.paired import paired
from robo47_qp.evaluation.report.paired_words import paired_markdown
from robo47_qp.evaluation.report.words import (
    broken_line,
    causes_tail,
    comparison_line,
    rate_line,
)
from robo47_qp.files import claim, write_text

COMPARISON = ("report", "text")
"""Files of `EvaluateOptions.files` that hold the comparison."""


def evaluate_several(jobs: Sequence[Job], options: EvaluateOptions, console: Console) -> int:
    """Run every policy, the first of which is the baseline; returns the exit code.

    Raises:
        Robo47Error: Bad input, before anything runs, or a file that cannot be written.
    """
    _prepare(jobs, options)
    reports = []
    try:
        for job in jobs:
            name = job.options.contender.name
            reports.append(job.run(console, resume=True, title=name))
            job.keep(reports[-1])
            line = f"{name}: {rate_line(reports[-1])}{causes_tail(reports[-1])}"
            broken = broken_line(reports[-1])
            told = [line, f"  {broken}"] if broken else [line]
            console.print(escape("\n".join(told)), highlight=False, soft_wrap=True)
    except KeyboardInterrupt:
        console.print(
            "interrupted; all finished episodes of all policies are kept: go on with --resume"
        )
        return INTERRUPTED
    # Only now, so that what is resumed does not record the failures of the first ones again.
    for job, report in zip(jobs, reports, strict=True):
        job.finish(report)
    names = [job.options.files["report"].name for job in jobs]
    figures = paired(dict(zip(names, reports, strict=True)))
    write_json(figures, options.files["report"])
    write_text(options.files["text"], paired_markdown(figures))
    _print_end(figures, reports, jobs, options, console)
    return OK if all(map(sound, reports)) else FAILED


def _prepare(jobs: Sequence[Job], options: EvaluateOptions) -> None:
    """Refuse what cannot be had before anything runs, and open every journal.

    With --resume all are read before one is begun: a refused evaluation leaves none with settings
    that the right one would be refused for. Without it, all old ones are put aside now: an
    interruption leaves none that a later --resume would take for one of this evaluation.
    """
    settings = [job.evaluation.settings for job in jobs]
    for name in COMPARISON:
        claim(options.files[name])
    journals = [job.options.files["journal"] for job in jobs]
    for job, journal in zip(jobs, journals, strict=True):
        job.claim()
        claim(journal)
    if options.resume:
        for journal, asked in zip(journals, settings, strict=True):
            Journal.read(journal, asked)
    for journal, asked in zip(journals, settings, strict=True):
        Journal(journal, asked, resume=options.resume).close()


def _print_end(
    figures: dict[str, Any],
    reports: Sequence[dict[str, Any]],
    jobs: Sequence[Job],
    options: EvaluateOptions,
    console: Console,
) -> None:
    for report in reports:
        print_unsound(report, console)
    if options.json:
        sys.stdout.write(json.dumps(figures, indent=2, allow_nan=False) + "\n")
        return
    lines = [comparison_line(comparison) for comparison in figures["comparisons"]]
    lines += [f"  {name:<10} {options.files[name]}" for name in COMPARISON]
    for name in ("report", "recording"):
        files = [job.options.files[name] for job in jobs]
        lines += [f"  {name:<10} {path}" for path in files if path.exists()]
    console.print(escape("\n".join(lines)), highlight=False, soft_wrap=True)
