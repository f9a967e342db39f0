"""Progress of long work: a bar in a terminal, a line now and then in a file or a pipe."""

from collections.abc import Iterator, Sequence
from time import monotonic
from types import TracebackType
from typing import TypeVar

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

Item = TypeVar("Item")
FIRST, EVERY = 2.0, 10.0
"""When the first line is written, and how long after it each other one [s]."""


class Steps:
    """Tells how many steps of some work are done, in a `with` block."""

    def __init__(
        self, console: Console, total: int, title: str, *, timed: bool = False, bar: bool = True
    ) -> None:
        """Prepare for a number of steps.

        Args:
            console: Where to tell.
            total: Number of steps.
            title: What the steps are.
            timed: The work is timed: nothing is drawn while it runs, only between steps.
            bar: False where the terminal shows something else; lines are written all the same.
        """
        self._console, self._total, self._title = console, total, title
        self._bar: Progress | None = None
        if bar and console.is_terminal:
            self._bar = Progress(
                TextColumn(escape(title)),
                BarColumn(bar_width=30),
                MofNCompleteColumn(),
                TextColumn("{task.description}"),
                TimeRemainingColumn(),
                console=console,
                transient=True,
                auto_refresh=not timed,
            )
            self._task = self._bar.add_task("", total=total)
        self._next = 0.0

    def __enter__(self) -> "Steps":
        """Begin."""
        self._next = monotonic() + FIRST
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End, and remove the bar."""
        if self._bar is not None:
            self._bar.stop()

    def show(self, done: int, note: str = "") -> None:
        """Tell how many steps are done, and what else there is to say."""
        if self._bar is not None:
            self._bar.update(self._task, completed=done, description=escape(note), refresh=True)
        elif not self._console.is_terminal and monotonic() >= self._next:
            self._next = monotonic() + EVERY
            told = f"{self._title}: {done} of {self._total}{note and f', {note}'}"
            self._console.print(told, highlight=False, markup=False, soft_wrap=True)

    def over(self, items: Sequence[Item]) -> Iterator[Item]:
        """Yield the items of a sequence, each of them a step."""
        for done, item in enumerate(items):
            self.show(done)
            yield item
