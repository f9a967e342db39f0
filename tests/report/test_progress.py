"""Progress: a bar in a terminal, lines of text elsewhere, nothing for what is short."""

from io import StringIO

import pytest
from rich.console import Console

from robo47_qp.report import progress
from robo47_qp.report.progress import Steps


def written(monkeypatch: pytest.MonkeyPatch, seconds: float, *, terminal: bool) -> str:
    """What is told of five steps that take so long each."""
    clock = iter(seconds * k for k in range(100))
    monkeypatch.setattr(progress, "monotonic", lambda: next(clock))
    screen = StringIO()
    console = Console(file=screen, force_terminal=terminal, width=100)
    with Steps(console, 5, "things [odd]", timed=True) as steps:
        assert list(steps.over("abcde")) == [*"abcde"]
    return screen.getvalue()


def test_into_a_pipe_there_is_a_line_now_and_then_without_control_codes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lines = written(monkeypatch, 4.0, terminal=False).splitlines()
    assert lines[0] == "things [odd]: 0 of 5"
    assert 2 <= len(lines) < 5
    assert not any("\x1b" in line for line in lines)


def test_what_is_short_writes_nothing_into_a_pipe(monkeypatch: pytest.MonkeyPatch) -> None:
    assert written(monkeypatch, 0.1, terminal=False) == ""


def test_in_a_terminal_there_is_a_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    told = written(monkeypatch, 0.1, terminal=True)
    assert "things [odd]" in told
    assert "4/5" in told
