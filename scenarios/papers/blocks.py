"""Parts of a page that are written by `make tables`, between two comments of Markdown.

A table stands between `<!-- table: NAME ... -->` and `<!-- end -->`, on lines of their own. A
single figure stands between `<!-- figure: RESULT KEY FORMAT -->` and `<!-- end -->` in a line.
"""

import re
from collections.abc import Callable, Mapping

from robo47_qp.errors import RecordingError
from scenarios.papers.kept import REPRODUCED, kept, reproduced

_TABLE = re.compile(r"(<!-- table: (.+?) -->\n).*?(<!-- end -->)", re.DOTALL)
_FIGURE = re.compile(r"(<!-- figure: (\S+) (\S+) (\S+) -->)[^\n]*?(<!-- end -->)")
_MARKS = re.compile(r"<!-- (?:table|figure|end)\b")


def rendered(text: str, tables: Mapping[str, Callable[..., str]]) -> str:
    """Return a page with its tables and figures written anew from the kept results.

    Args:
        text: The page.
        tables: What writes a table, by name; it gets the words that follow the name.

    Raises:
        RecordingError: A mark names no table or result, or marks do not pair up.
    """
    found = 2 * len(_TABLE.findall(text)) + 2 * len(_FIGURE.findall(text))
    if found != len(_MARKS.findall(text)):
        raise RecordingError("Each mark of a table or figure needs an <!-- end --> after it.")

    def table(match: re.Match[str]) -> str:
        name, *words = match[2].split()
        if name not in tables:
            raise RecordingError(f"There is no table {name!r}; there are: {', '.join(tables)}.")
        return f"{match[1]}{tables[name](*words)}\n{match[3]}"

    def figure(match: re.Match[str]) -> str:
        return f"{match[1]}{value(match[2], match[3]):{match[4]}}{match[5]}"

    return _FIGURE.sub(figure, _TABLE.sub(table, text))


def value(name: str, path: str) -> float:
    """Return one number of a kept result; the path has the keys, with a dot between them.

    Raises:
        RecordingError: The result has no such number.
    """
    found: object = reproduced() if name == REPRODUCED else kept(name)
    for key in path.split("."):
        found = found.get(key) if isinstance(found, dict) else None
    if isinstance(found, bool) or not isinstance(found, int | float):
        raise RecordingError(f"docs/results/{name}.json has no number {path!r}.")
    return float(found)


def markdown_table(heads: Mapping[str, str], rows: list[list[str]]) -> str:
    """Return a table of Markdown.

    Args:
        heads: Alignment of each column by its head: ":--" for text, "--:" for numbers.
        rows: The cells.
    """
    lines = [[*heads], [*heads.values()], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
