"""Compare IK solvers on the same targets: damped least squares, QP, with and without restarts."""

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from rich.console import Console
from rich.markup import escape

from robo47_qp.arrays import Checked, Count, CountOrZero, Suffix
from robo47_qp.cli import INTERRUPTED, LOGS, OK, main, unset
from robo47_qp.errors import InvalidValueError, UnknownNameError
from robo47_qp.evaluation.benchmarks.ik.answers import Answers
from robo47_qp.evaluation.benchmarks.ik.catalogue import (
    FIRST_SETS,
    FIRST_SOLVERS,
    QUESTIONS,
    peers,
    solvers,
    target_sets,
)
from robo47_qp.evaluation.benchmarks.ik.comparison import Comparison, Start
from robo47_qp.evaluation.benchmarks.ik.failure_log import FailureLog, figures_markdown
from robo47_qp.evaluation.benchmarks.ik.summary import Question, summary
from robo47_qp.evaluation.benchmarks.ik.terminal import (
    LiveTable,
    first_answers,
    first_table,
    paired_table,
    reasons_table,
)
from robo47_qp.files import check_writable, claimed, write_text
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots import load_robot
from robo47_qp.report.provenance import provenance
from robo47_qp.report.terminal import print_files

Member = TypeVar("Member")


@dataclass(frozen=True, kw_only=True)
class CompareOptions(Checked):
    """Options of `robo47 compare-ik`."""

    robot: str = "panda"
    """Robot whose inverse kinematics is solved."""
    n: Count = 1000
    """Targets per target set."""
    seed: CountOrZero = 0
    """Seed of the targets."""
    solvers: tuple[str, ...] = ()
    """Names of the solvers to compare; if none is named all of them, but only those of DLS and QP
    without --targets, --all and --peers, too."""
    targets: tuple[str, ...] = ()
    """Names of the target sets; if none is named all of them, but only uniform and near_limits
    without --solvers, --all and --peers, too."""
    all: bool = False
    """Compare all solvers on all target sets, where none is named."""
    start: Literal["home", "random"] = "home"
    """Where every search starts: the robot's home, or a random configuration per target."""
    peers: bool = False
    """Also compare the solvers of other packages; those that are not installed are listed."""
    log: Annotated[Path, Suffix(".rrd")] = LOGS / "ik.rrd"
    """Recording to write; the report goes beside it, with the ending .json."""
    plot: Annotated[Annotated[Path, Suffix(".png")] | None, unset("PATH")] = None
    """Picture to write (PNG); by default beside the recording."""
    json: bool = False
    """Print the report as JSON on the standard output and nothing else."""

    def _label(self, field: str) -> str:
        return f"--{field}"

    @property
    def first(self) -> bool:
        """True where nothing is chosen: one screen answers which of DLS and QP is better."""
        return not (self.solvers or self.targets or self.all or self.peers)

    @property
    def files(self) -> dict[str, Path]:
        """Files that are written, by name."""
        return {
            "report": self.log.with_suffix(".json"),
            "plot": self.plot or self.log.with_suffix(".png"),
            "recording": self.log,
        }


def compare_command(args: Sequence[str] | None = None, prog: str | None = None) -> int:
    """Compare from the command line, and return the exit code; see `robo47_qp.cli.main`."""
    return main(CompareOptions, compare_chosen, __doc__, args=args, prog=prog)


def compare_chosen(options: CompareOptions, console: Console) -> int:
    """Run the comparison that was chosen, and return the exit code."""
    others, left_out = peers() if options.peers else ({}, {})
    robot = load_robot(options.robot)
    known, sets = solvers() | others, target_sets(robot)
    for name in options.solvers:
        if name in left_out:
            expected = f"one that is installed; {left_out[name].rstrip('.')}"
            raise InvalidValueError("--solvers", name, expected)
    comparison = Comparison(
        arm=Arm(robot),
        solvers=chosen("solver", known, FIRST_SOLVERS if options.first else options.solvers),
        fields=chosen("target set", sets, FIRST_SETS if options.first else options.targets),
        n=options.n,
        seed=options.seed,
        start=Start(options.start),
    )
    return compare(comparison, options, console, left_out=left_out, questions=QUESTIONS)


def chosen(kind: str, known: Mapping[str, Member], names: Iterable[str]) -> dict[str, Member]:
    """Return the named members, in the order of all; all if none is named.

    Raises:
        UnknownNameError: A name is not among those known.
    """
    wanted = tuple(names)
    for name in wanted:
        if name not in known:
            raise UnknownNameError(kind, name, known)
    return {name: member for name, member in known.items() if not wanted or name in wanted}


def compare(
    comparison: Comparison,
    options: CompareOptions,
    console: Console,
    *,
    left_out: Mapping[str, str],
    questions: Sequence[Question],
) -> int:
    """Run a comparison, write its report, plot and recording, and return the exit code.

    The report is written after each target set and after an interruption.

    Raises:
        RecordingError: A file cannot be written.
    """
    with claimed(options.log):
        return _compared(comparison, options, console, left_out, questions)


def _compared(
    comparison: Comparison,
    options: CompareOptions,
    console: Console,
    left_out: Mapping[str, str],
    questions: Sequence[Question],
) -> int:
    """Compare with files that are this process's own; see `compare`."""
    files = options.files
    for path in files.values():
        check_writable(path)
    for name, reason in left_out.items():
        console.print(f"left out: {name}; {escape(reason)}", highlight=False, soft_wrap=True)
    done: list[Sequence[Answers]] = []
    made, complete = provenance(), False
    try:
        total = comparison.n * len(comparison.fields)
        with LiveTable(console, total, leave=not options.first) as table:
            for field in comparison.run(table.show):
                table.close_field(field)
                done.append(field)
                write_text(
                    files["report"],
                    _text(summary(comparison, done, questions, left_out, made, complete=False)),
                )
        complete = True
    except KeyboardInterrupt:
        kept = "what was measured so far is kept" if done else "nothing was recorded yet"
        console.print(f"interrupted; {kept}")
    figures = summary(comparison, done, questions, left_out, made, complete=complete)
    write_text(files["report"], _text(figures))
    if done:
        from robo47_qp.evaluation.benchmarks.ik.plots import plot_comparison

        plot_comparison(comparison.arm, done, files["plot"])
        with closing(_log(comparison, files["recording"])) as log:
            log.write(done, figures_markdown(figures))
    if options.json:
        sys.stdout.write(_text(figures) + "\n")
    else:
        _print_end(figures, options, console)
        print_files(console, files if done else {"report": files["report"]})
    return OK if complete else INTERRUPTED


def _log(comparison: Comparison, path: Path) -> FailureLog:
    return FailureLog(path, comparison.arm.robot, list(comparison.solvers))


def _text(figures: Mapping[str, Any]) -> str:
    return json.dumps(figures, indent=2, allow_nan=False)


def _print_end(figures: Mapping[str, Any], options: CompareOptions, console: Console) -> None:
    asked = [test for test in figures["paired"] if test["planned"]]
    if options.first and figures["rows"]:
        console.print(first_table(figures["rows"]))
        console.print("\n".join(first_answers(asked)), highlight=False)
    elif asked:
        console.print(paired_table(asked))
    if figures["reasons"]:
        console.print(reasons_table(figures["reasons"]))
