"""Tables in narrow terminals."""

import io
import re

import pytest
from rich.console import Console

from robo47_qp.report.figures_table import FiguresTable

NUMBERS = ("39.123456", "-12.3456", "95.2 – 99.9", "1000 of 1000")
HEADINGS = ("signal", "limit", "extreme", "interval", "kept")


def printed(width: int) -> list[str]:
    table = FiguresTable(HEADINGS, texts=("signal",), title="Audit")
    table.add_row("a rather long name of a [bold]signal[/]", *NUMBERS)
    console = Console(file=io.StringIO(), width=width)
    console.print(table)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue().splitlines()


@pytest.mark.parametrize("width", range(20, 110, 3))
def test_numbers_stay_whole_and_what_is_left_out_is_named(width: int) -> None:
    lines = printed(width)
    text = " ".join(" ".join(lines).split())
    assert all(len(line.rstrip()) <= width for line in lines)
    assert "…" not in text
    shown = [number in text for number in NUMBERS]
    assert shown == sorted(shown, reverse=True)  # the last ones go first
    left_out = [name for name, here in zip(HEADINGS[1:], shown, strict=True) if not here]
    named = re.search(r"\(wider than this terminal: (.*)\)", text)
    assert (named[1].split(", ") if named else []) == left_out


def test_a_wide_terminal_has_all_columns_and_a_narrow_one_does_not_lose_the_name() -> None:
    assert not any("wider" in line for line in printed(80))
    assert "signal" in printed(16)[1]


def test_a_table_is_whole_again_where_there_is_room() -> None:
    table = FiguresTable(HEADINGS, texts=("signal",))
    table.add_row("q", *NUMBERS)
    for width, count in ((20, 2), (100, 5)):
        console = Console(file=io.StringIO(), width=width)
        console.print(table)
        assert len(table.columns) == len(HEADINGS)
        assert isinstance(console.file, io.StringIO)
        first = console.file.getvalue().splitlines()[0]
        assert len(first.split()) == count
