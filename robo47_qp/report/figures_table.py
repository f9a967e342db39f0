"""FiguresTable: a table for the terminal whose numbers are never cut."""

from collections.abc import Collection, Sequence
from typing import Any

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.table import Column, Table
from rich.text import Text

_BETWEEN = 2
"""Blanks between two columns."""


class FiguresTable(Table):
    """Columns of text and of numbers; what does not fit into the terminal is left out, and named.

    Columns go from the right to the left, the first one never. Text is broken between words, a
    number stays whole. Into a file all columns are written.
    """

    def __init__(
        self, headings: Sequence[str], *, texts: Collection[str] = (), title: str | None = None
    ) -> None:
        """Make a table without rows.

        Args:
            headings: One for each column, the most important ones first.
            texts: Those of columns that hold text.
            title: Line above the table.
        """
        super().__init__(
            title=title, title_justify="left", header_style="", box=None, pad_edge=False
        )
        for heading in headings:
            text = heading in texts
            self.add_column(
                heading, justify="left" if text else "right", no_wrap=not text, overflow="fold"
            )

    def add_row(self, *cells: RenderableType | None, **options: Any) -> None:
        """See `Table.add_row`; brackets in a string mean nothing, as in names."""
        told = (Text(cell) if isinstance(cell, str) else cell for cell in cells)
        super().add_row(*told, **options)

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Render the columns that fit."""
        every, room = self.columns, options.max_width
        kept = list(every)
        while len(kept) > 1 and _width(kept) > room:
            kept.pop()
        try:
            self.columns = kept
            yield from super().__rich_console__(console, options)
        finally:
            self.columns = every
        if len(kept) < len(every):
            rest = ", ".join(str(column.header) for column in every[len(kept) :])
            yield Text(f"(wider than this terminal: {rest})", style="dim")


def _width(columns: Sequence[Column]) -> int:
    """Return the least width of columns in characters."""
    return sum(_least(column) for column in columns) + _BETWEEN * (len(columns) - 1)


def _least(column: Column) -> int:
    cells = [_plain(cell) for cell in (column.header, *column.cells)]
    words = [cell.split() if not column.no_wrap else [cell] for cell in cells]
    return max((cell_len(word) for cell in words for word in cell), default=0)


def _plain(cell: object) -> str:
    return cell.plain if isinstance(cell, Text) else str(cell)
