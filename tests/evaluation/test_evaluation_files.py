"""Files that are there before an evaluation: what it replaces, keeps, and leaves to others."""

from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from robo47_qp.errors import InvalidValueError, RecordingError
from robo47_qp.evaluation.evaluate import evaluate
from robo47_qp.files import claimed
from robo47_qp.model.robots.panda import PANDA
from tests.evaluation.odd_episodes import (
    QUIET,
    InProcess,
    Odd,
    in_process,  # noqa: F401  # a fixture
    options,
)


@pytest.mark.parametrize("chosen", [{}, {"resume": True}])
def test_a_second_evaluation_with_the_same_files_is_refused(
    chosen: dict[str, Any], tmp_path: Path
) -> None:
    for ending in (".json", ".md", ".png", ".rrd", ".jsonl"):
        (tmp_path / f"eval{ending}").write_text("of the first")
    with (
        claimed(tmp_path / "eval.rrd"),
        pytest.raises(RecordingError, match=r"eval\.rrd is being written by another process"),
    ):
        evaluate(Odd(), PANDA, options(tmp_path, **chosen), QUIET)
    left = sorted(tmp_path.iterdir())
    assert [path.name for path in left] == [
        f"eval{e}" for e in (".json", ".jsonl", ".md", ".png", ".rrd")
    ]
    assert {path.read_text() for path in left} == {"of the first"}


def test_ctrl_c_keeps_what_is_done_and_tells_how_to_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(InProcess, "interrupted_after", 1)
    screen = StringIO()
    for ending in (".md", ".png", ".rrd"):
        (tmp_path / f"eval{ending}").write_text("of an earlier evaluation")
    (tmp_path / "eval.json").write_text('{"provenance": "of an earlier evaluation"}')
    assert evaluate(Odd(), PANDA, options(tmp_path), Console(file=screen)) == 130
    assert "continue with --resume" in screen.getvalue()
    assert len((tmp_path / "eval.jsonl").read_text().splitlines()) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["eval.jsonl"]


@pytest.mark.parametrize("ending", [".json", ".md", ".png", ".rrd"])
def test_files_of_something_else_are_not_replaced(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"eval{ending}"
    path.write_text("a user's own")
    with pytest.raises(InvalidValueError, match=rf"--log must be .*eval\{ending}, which is none"):
        evaluate(Odd(), PANDA, options(tmp_path), QUIET)
    assert [path.read_text() for path in tmp_path.iterdir()] == ["a user's own"]


@pytest.mark.parametrize("resume", [False, True])
def test_a_report_to_compare_with_is_not_replaced(resume: bool, tmp_path: Path) -> None:
    """Else it would be lost, and the new one be compared with itself."""
    path = tmp_path / "eval.json"
    path.write_text('{"provenance": {}}')
    (tmp_path / "link").symlink_to(tmp_path)
    for against in (path, tmp_path / "link" / "eval.json"):
        chosen = options(tmp_path, against=against, resume=resume)
        with pytest.raises(InvalidValueError, match="--against must be a report that is not writt"):
            evaluate(Odd(), PANDA, chosen, QUIET)
    assert path.read_text() == '{"provenance": {}}'


def test_ctrl_c_before_any_episode_promises_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(InProcess, "interrupted_after", 0)
    screen = StringIO()
    assert evaluate(Odd(), PANDA, options(tmp_path), Console(file=screen)) == 130
    assert screen.getvalue().splitlines()[-1] == "interrupted; no episode was finished"
