"""A comparison from its options to its files."""

import json
import sys
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from robo47_qp.cli import INTERRUPTED, OK
from robo47_qp.evaluation.benchmarks.ik.answers import Answers
from robo47_qp.evaluation.benchmarks.ik.comparison import Comparison
from robo47_qp.evaluation.benchmarks.ik.failure_log import FailureLog
from robo47_qp.evaluation.benchmarks.ik.failure_words import figures_markdown
from robo47_qp.evaluation.benchmarks.ik.options import CompareOptions
from robo47_qp.evaluation.benchmarks.ik.plots import plot_comparison
from robo47_qp.evaluation.benchmarks.ik.rows import Question
from robo47_qp.evaluation.benchmarks.ik.summary import summary
from robo47_qp.evaluation.benchmarks.ik.terminal import LiveTable, paired_table, reasons_table
from robo47_qp.files import claim, write_text


def compare(
    comparison: Comparison,
    options: CompareOptions,
    console: Console,
    *,
    left_out: Mapping[str, str],
    questions: Sequence[Question],
) -> int:
    """Run a comparison and write its report, plot and recording; returns the exit code.

    What was measured is kept, whatever happens: the report is written after each target set,
    and after an interruption.

    Raises:
        RecordingError: A file cannot be written.
    """
    files = options.files
    for path in files.values():
        claim(path)
    for name, reason in left_out.items():
        console.print(f"left out: {name}; {escape(reason)}", highlight=False, soft_wrap=True)
    done: list[Sequence[Answers]] = []
    complete = False
    try:
        with LiveTable(console, comparison.n * len(comparison.fields)) as table:
            for field in comparison.run(table.show):
                table.close_field(field)
                done.append(field)
                write_text(
                    files["report"],
                    _text(summary(comparison, done, questions, left_out, complete=False)),
                )
        complete = True
    except KeyboardInterrupt:
        console.print("interrupted; what was measured so far is kept")
    figures = summary(comparison, done, questions, left_out, complete=complete)
    write_text(files["report"], _text(figures))
    if done:
        plot_comparison(comparison.arm, done, files["plot"])
        with closing(_log(comparison, files["recording"])) as log:
            log.write(done, figures_markdown(figures))
    if options.json:
        sys.stdout.write(_text(figures) + "\n")
    else:
        _print_end(figures, options, console)
    return OK if complete else INTERRUPTED


def _log(comparison: Comparison, path: Path) -> FailureLog:
    return FailureLog(path, comparison.arm.robot, list(comparison.solvers))


def _text(figures: Mapping[str, Any]) -> str:
    return json.dumps(figures, indent=2, allow_nan=False)


def _print_end(figures: Mapping[str, Any], options: CompareOptions, console: Console) -> None:
    asked = [test for test in figures["paired"] if test["planned"]]
    if asked:
        console.print(paired_table(asked))
    if figures["reasons"]:
        console.print(reasons_table(figures["reasons"]))
    for name, path in options.files.items():
        console.print(f"  {name:<10} {path}", highlight=False, soft_wrap=True)
