"""Tables of kept results: rows of cells, and below them where they come from."""

from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any

from scenarios.papers.blocks import markdown_table
from scenarios.papers.kept import is_kept, kept, origin_line

Result = Mapping[str, Any]
Cell = Callable[[Result], str]
NOTHING = "No result of this kind is kept yet."


def table(
    name: str,
    rows: Callable[[Result], Iterable[Result]],
    columns: Mapping[str, Cell],
    *,
    words: Collection[str],
) -> str:
    """A table of one kept result: `words` to the left, numbers to the right, the origin below."""
    if not is_kept(name):
        return NOTHING
    found = kept(name)
    heads = {head: "---" if head in words else "--:" for head in columns}
    cells = [[cell(row) for cell in columns.values()] for row in rows(found)]
    return with_origin(heads, cells, {name: found})


def with_origin(
    heads: Mapping[str, str],
    rows: list[list[str]],
    results: Mapping[str, Result],
    files: str | None = None,
) -> str:
    """A table of several kept results, with their origin, or that of the files, below."""
    return f"{markdown_table(heads, rows)}\n\n{origin_line(results, files)}"


def interval(result: Result) -> str:
    """The interval of a success rate."""
    low, high = (100 * bound for bound in result["interval"])
    return f"{low:.1f}–{high:.1f} %"
