"""Terminal output of a comparison: live tables of results, reasons and paired tests."""

from collections.abc import Mapping, Sequence
from time import monotonic
from types import TracebackType
from typing import Any

from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.text import Text

from robo47_qp.evaluation.benchmarks.ik.answers import Answers
from robo47_qp.evaluation.benchmarks.ik.summary import rows
from robo47_qp.report.figures_table import FiguresTable
from robo47_qp.report.progress import Steps

_REFRESH = 1.0
"""Time between two updates of the table [s]."""
_COLUMNS = (
    *("success %", "95 % interval", "tight %", "outside", "median ms", "p99 ms", "own ms"),
    *("missed", "free %", "point %", "p95 ms"),
)
_SINGLE, _AGAIN = ("dls-tuned", "qp-daqp"), ("dls-tuned-multi", "qp-daqp-multi")
"""What is compared to answer "DLS or QP?", from one start and with restarts."""


class LiveTable:
    """Table of the current target set, with a progress bar over all targets."""

    def __init__(self, console: Console, total: int, *, leave: bool = True) -> None:
        """Create a progress bar over `total` targets; `leave` keeps finished tables."""
        self._leave = leave
        self._progress = Progress(
            TextColumn("{task.description:<14}"),
            BarColumn(bar_width=40),
            MofNCompleteColumn(),
            TextColumn("targets"),
            TimeElapsedColumn(),
        )
        self._bar = self._progress.add_task("start", total=total)
        self._live = Live(self._progress, console=console, transient=True, auto_refresh=False)
        self._lines = Steps(console, total, "targets", bar=False)
        self._before, self._next = 0, 0.0

    def __enter__(self) -> "LiveTable":
        """Show the table."""
        self._live.start()
        self._lines.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Remove the table."""
        self._live.stop()

    def show(self, field: Sequence[Answers], done: int) -> None:
        """Advance the progress bar, and redraw it and the table about once a second."""
        name = field[0].targets.name
        self._progress.update(self._bar, completed=self._before + done, description=name)
        self._lines.show(self._before + done, name)
        if monotonic() >= self._next:
            # Between two blocks: a thread that draws would be timed with the solvers.
            table = Group(field_table(rows(field)), self._progress)
            self._live.update(table, refresh=True)
            self._next = monotonic() + _REFRESH

    def close_field(self, field: Sequence[Answers]) -> None:
        """Leave the finished table of a target set on the screen."""
        self._before += field[0].n
        if self._leave and field[0].targets.reachable is not False:
            self._live.console.print(field_table(rows(field)), "")
        self._live.update(self._progress)


def field_table(figures: Sequence[Mapping[str, Any]]) -> FiguresTable:
    """Return the table of one target set."""
    first = figures[0]
    title = f"{first['targets']}: {first['n']} targets, {first['reached_by_any']} reached by any"
    table = FiguresTable(("solver", *_COLUMNS), texts=("solver",), title=title)
    for row in figures:
        low, high = row["interval"]
        table.add_row(
            row["solver"],
            f"{100 * row['success']:.2f}",
            f"{100 * low:.2f} – {100 * high:.2f}",
            f"{100 * row['tight']:.2f}",
            _bad(row["limit_violations"]),
            *(f"{row[name]:.3f}" for name in ("median_ms", "p99_ms", "own_median_ms")),
            _bad(row["missed"]),
            f"{100 * row['collision_free']:.2f}",
            f"{100 * row['position_only']:.2f}",
            f"{row['p95_ms']:.3f}",
        )
    return table


def first_table(figures: Sequence[Mapping[str, Any]]) -> FiguresTable:
    """Return the one table of the answer to "DLS or QP?": success on each target set, and time."""
    sets = list(dict.fromkeys(row["targets"] for row in figures))
    own = {(row["solver"], row["targets"]): row for row in figures}
    title = f"Success (95 % interval) on {figures[0]['n']} targets each; times of {sets[0]}"
    headings = ("solver", *(f"{name} %" for name in sets), "median ms", "p99 ms")
    table = FiguresTable(headings, texts=("solver",), title=title)
    for solver in dict.fromkeys(row["solver"] for row in figures):
        told = [own[solver, name] for name in sets if (solver, name) in own]
        cells = [
            f"{100 * row['success']:.1f} ({100 * row['interval'][0]:.1f} – "
            f"{100 * row['interval'][1]:.1f})"
            for row in told
        ]
        times = (f"{told[0][name]:.2f}" for name in ("median_ms", "p99_ms"))
        table.add_row(solver, *cells, *times)
    return table


def first_answers(tests: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return what the paired tests say of the best DLS and of the QP, a line each."""
    lines = []
    for how, pair in (("From one start", _SINGLE), ("With restarts", _AGAIN)):
        told = [
            f"{test['only_b']} to {test['only_a']} on {test['targets']} (p = {test['p_holm']:.1g})"
            for test in tests
            if (test["a"], test["b"]) == pair
        ]
        if told:
            lines.append(f"{how}, targets that only the QP or only DLS solved: {', '.join(told)}.")
    return [
        *lines,
        "--all compares more solvers on more sets; p by McNemar's test, Holm-corrected.",
    ]


def reasons_table(found: Sequence[Mapping[str, Any]]) -> FiguresTable:
    """Return the table of how often each solver named the right class of reason."""
    kinds = list(dict.fromkeys(row["kind"] for row in found))
    solvers = list(dict.fromkeys(row["solver"] for row in found))
    names = [kind.replace("_", " ") for kind in kinds]
    title = "right class of reason, % of targets"
    table = FiguresTable(("solver", "worst p99 ms", *names), texts=("solver",), title=title)
    for solver in solvers:
        own = {row["kind"]: row for row in found if row["solver"] == solver}
        cells = [
            f"{100 * own[kind]['right'] / own[kind]['n']:.1f}" if kind in own else ""
            for kind in kinds
        ]
        table.add_row(solver, f"{max(row['p99_ms'] for row in own.values()):.2f}", *cells)
    return table


def paired_table(tests: Sequence[Mapping[str, Any]]) -> FiguresTable:
    """Return the table of paired tests."""
    title = "targets that only one of two solved (exact McNemar test, Holm-corrected)"
    texts = ("targets", "a", "b")
    table = FiguresTable((*texts, "only a", "only b", "p"), texts=texts, title=title)
    last = ""
    for test in tests:
        table.add_row(
            *("" if test["targets"] == last else test["targets"], test["a"], test["b"]),
            *(str(test["only_a"]), str(test["only_b"]), f"{test['p_holm']:.2g}"),
        )
        last = test["targets"]
    return table


def _bad(count: int) -> Text:
    return Text(str(count), "red" if count else "")
