"""Terminal output of a comparison: live tables of results, reasons and paired tests."""

from collections.abc import Mapping, Sequence
from time import monotonic
from types import TracebackType
from typing import Any

from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from robo47_qp.evaluation.benchmarks.ik.answers import Answers
from robo47_qp.evaluation.benchmarks.ik.summary import rows

_REFRESH = 1.0
"""Time between two updates of the table [s]."""
_COLUMNS = (
    *("success %", "95 % interval", "tight %", "free %", "point %", "missed", "outside"),
    *("median ms", "p95 ms", "p99 ms"),
)


class LiveTable:
    """Table of the current target set, with a progress bar over all targets."""

    def __init__(self, console: Console, total: int) -> None:
        """Create a progress bar over `total` targets."""
        self._progress = Progress(
            TextColumn("{task.description:<14}"),
            BarColumn(bar_width=40),
            MofNCompleteColumn(),
            TextColumn("targets"),
            TimeElapsedColumn(),
        )
        self._bar = self._progress.add_task("start", total=total)
        self._live = Live(self._progress, console=console, transient=True, auto_refresh=False)
        self._before, self._next = 0, 0.0

    def __enter__(self) -> "LiveTable":
        """Show the table."""
        self._live.start()
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
        if monotonic() >= self._next:
            # Between two blocks: a thread that draws would be timed with the solvers.
            table = Group(field_table(rows(field)), self._progress)
            self._live.update(table, refresh=True)
            self._next = monotonic() + _REFRESH

    def close_field(self, field: Sequence[Answers]) -> None:
        """Leave the finished table of a target set on the screen."""
        self._before += field[0].n
        if field[0].targets.reachable is not False:
            self._live.console.print(field_table(rows(field)), "")
        self._live.update(self._progress)


def field_table(figures: Sequence[Mapping[str, Any]]) -> Table:
    """Return the table of one target set."""
    first = figures[0]
    title = f"{first['targets']}: {first['n']} targets, {first['reached_by_any']} reached by any"
    table = Table(title=title, title_justify="left", header_style="", box=None, pad_edge=False)
    table.add_column("solver", no_wrap=True)
    for heading in _COLUMNS:
        table.add_column(heading, justify="right", no_wrap=True)
    for row in figures:
        low, high = row["interval"]
        table.add_row(
            row["solver"],
            f"{100 * row['success']:.2f}",
            f"{100 * low:.2f} – {100 * high:.2f}",
            f"{100 * row['tight']:.2f}",
            f"{100 * row['collision_free']:.2f}",
            f"{100 * row['position_only']:.2f}",
            _bad(row["missed"]),
            _bad(row["limit_violations"]),
            *(f"{row[name]:.3f}" for name in ("median_ms", "p95_ms", "p99_ms")),
        )
    return table


def reasons_table(found: Sequence[Mapping[str, Any]]) -> Table:
    """Return the table of how often each solver named the right class of reason."""
    kinds = list(dict.fromkeys(row["kind"] for row in found))
    solvers = list(dict.fromkeys(row["solver"] for row in found))
    table = Table(
        title="right class of reason, % of targets", title_justify="left", header_style="", box=None
    )
    table.add_column("solver")
    for kind in kinds:
        table.add_column(kind.replace("_", " "), justify="right")
    table.add_column("worst p99 ms", justify="right")
    for solver in solvers:
        own = {row["kind"]: row for row in found if row["solver"] == solver}
        cells = [
            f"{100 * own[kind]['right'] / own[kind]['n']:.1f}" if kind in own else ""
            for kind in kinds
        ]
        table.add_row(solver, *cells, f"{max(row['p99_ms'] for row in own.values()):.2f}")
    return table


def paired_table(tests: Sequence[Mapping[str, Any]]) -> Table:
    """Return the table of paired tests."""
    table = Table(
        title="targets that only one of two solved (exact McNemar test, Holm-corrected)",
        title_justify="left",
        header_style="",
        box=None,
        pad_edge=False,
    )
    for heading in ("targets", "a", "b"):
        table.add_column(heading)
    for heading in ("only a", "only b", "p"):
        table.add_column(heading, justify="right")
    last = ""
    for test in tests:
        table.add_row(
            *("" if test["targets"] == last else test["targets"], test["a"], test["b"]),
            *(str(test["only_a"]), str(test["only_b"]), f"{test['p_holm']:.2g}"),
        )
        last = test["targets"]
    return table


def _bad(count: int) -> str:
    return "0" if count == 0 else f"[red]{count}[/]"
