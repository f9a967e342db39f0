"""Tables and figures of README and documentation are those of the kept results."""

import json
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from robo47_qp.errors import RecordingError
from scenarios import keep, tables
from scenarios.papers import kept as kept_module
from scenarios.papers.blocks import rendered
from scenarios.papers.kept import ORIGIN, kept, to_keep
from scenarios.papers.tables import TABLES

ORIGIN_OF_TOY = {
    "command": "robo47 evaluate --task reach",
    "commit": "0123456789abcdef",
    "changed": False,
    "date": "2026-01-02",
    "machine": {"cores": 2},
    "versions": {"mujoco": "4.0.0"},
}
ENTRY: dict[str, Any] = {
    "seed": 7,
    "success": True,
    "cause": None,
    "evidence": None,
    "step": None,
    "error": None,
    "broken_promises": [],
}
REPORT: dict[str, Any] = {
    "task": "reach",
    "episodes": 2,
    "successes": 1,
    "interval": [0.095, 0.905],
    "causes": {"ik": 1},
    "errors": 0,
    "broken_audits": 1,
    "figures": {"cycle_time_s": {"median": 12.34}},
    "entries": [
        ENTRY,
        {**ENTRY, "seed": 8, "success": False, "cause": "ik", "broken_promises": ["torque"]},
    ],
    "provenance": ORIGIN_OF_TOY,
}


@pytest.fixture
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for module in (kept_module, keep):
        monkeypatch.setattr(module, "RESULTS", tmp_path)
    return tmp_path


@pytest.mark.parametrize("page", tables.pages(), ids=lambda page: page.name)
def test_every_page_says_what_the_kept_results_say(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert rendered(text, TABLES) == text, "make tables"


@pytest.mark.parametrize("file", sorted(kept_module.RESULTS.glob("*.json")), ids=lambda f: f.stem)
def test_every_kept_result_tells_where_it_comes_from(file: Path) -> None:
    found = kept(file.stem)
    assert found["command"]
    assert len(found["commit"]) == 40
    assert not found["changed"]


def test_a_kept_evaluation_becomes_a_row(results: Path) -> None:
    (results / "toy.json").write_text(json.dumps(to_keep(REPORT)))
    page = "a\n<!-- table: evaluations toy -->\nold\n<!-- end -->\nb\n"
    lines = rendered(page, TABLES).splitlines()
    assert lines[4] == "| `reach` | 7 to 8 | 1 of 2 | 9.5 – 90.5 % | ik 1 | 1 | 12.3 s |"
    assert "`0123456789`, 2026-01-02" in lines[6]
    assert lines[-2:] == ["<!-- end -->", "b"]
    assert rendered("\n".join(lines), TABLES) == "\n".join(lines)


def test_a_single_figure_is_written_into_its_line(results: Path) -> None:
    (results / "toy.json").write_text(json.dumps(to_keep(REPORT)))
    text = "It took <!-- figure: toy figures.cycle_time_s.median .1f -->9<!-- end --> s."
    assert rendered(text, {}) == text.replace("-->9<", "-->12.3<")


@pytest.mark.parametrize(
    "text",
    [
        "<!-- table: evaluations toy -->\nno end\n",
        "<!-- table: nothing toy -->\n<!-- end -->\n",
        "<!-- table: evaluations missing -->\n<!-- end -->\n",
        "x <!-- figure: toy figures.nothing .1f -->1<!-- end -->",
        "x <!-- figure: toy task .1f -->1<!-- end -->",
    ],
)
def test_a_mark_that_leads_nowhere_is_refused(results: Path, text: str) -> None:
    (results / "toy.json").write_text(json.dumps(to_keep(REPORT)))
    with pytest.raises(RecordingError):
        rendered(text, TABLES)


def test_of_the_episodes_the_failures_and_broken_promises_are_kept() -> None:
    found = to_keep(REPORT)
    assert "entries" not in found
    assert found["seeds"] == [7, 8]
    assert [one["seed"] for one in found["failures"]] == [8]
    assert found["broken"] == {"8": ["torque"]}
    assert {key: found[key] for key in ORIGIN} == ORIGIN_OF_TOY


@pytest.mark.parametrize("wrong", [{"changed": True}, {"commit": None}])
def test_a_report_that_no_commit_made_is_not_kept(wrong: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="commit"):
        to_keep({**REPORT, "provenance": {**ORIGIN_OF_TOY, **wrong}})


def test_a_report_without_origin_is_not_kept() -> None:
    with pytest.raises(RecordingError, match="command"):
        to_keep({"figures": {}})


def test_keeping_writes_the_file(results: Path, tmp_path: Path) -> None:
    report = tmp_path / "eval.report"
    report.write_text(json.dumps(REPORT))
    options = keep.KeepOptions(report=report, name="toy")
    assert keep.run(options, Console(quiet=True)) == 0
    assert kept("toy")["successes"] == 1
