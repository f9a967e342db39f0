"""Tables and figures of README and documentation are those of the kept results."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from robo47_qp.errors import InvalidValueError, RecordingError
from robo47_qp.evaluation.perturbation import PRESETS
from robo47_qp.evaluation.policies import policy_settings
from robo47_qp.files import plain
from robo47_qp.stack import ClassicalStack
from scenarios import keep, tables
from scenarios.papers import kept as kept_module
from scenarios.papers.blocks import rendered
from scenarios.papers.kept import ORIGIN, RESULTS, kept, to_keep
from scenarios.papers.names import ALONE
from scenarios.papers.rows import NOTHING
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
    "settings": {
        "task": {"name": "reach"},
        "robot": "panda",
        "perturbation": plain(PRESETS["none"]),
        "policy": policy_settings(ClassicalStack(), None),
    },
    "episodes": 2,
    "judged": 2,
    "first_attempts": 1,
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


def test_kept_evaluations_become_rows(results: Path) -> None:
    (results / "success_severe_reach.json").write_text(json.dumps(to_keep(REPORT)))
    page = "a\n<!-- table: success -->\nold\n<!-- end -->\nb\n"
    lines = rendered(page, TABLES).splitlines()
    row = "| `reach` | severe | 1 of 2 | 9.5–90.5 % | 1 | ik 1 | 1 | 12.3 s | 7 | `0123456` |"
    assert lines[4] == row
    assert lines[6] == "Commit `0123456789`, 2026-01-02; `docs/results/success_*.json`."
    assert lines[-2:] == ["<!-- end -->", "b"]
    assert rendered("\n".join(lines), TABLES) == "\n".join(lines)


def test_what_the_arm_did_becomes_rows(results: Path) -> None:
    assert TABLES["tracking"]("perturbation", "success") == NOTHING
    figures = {
        "max_joint_error_rad": {"median": 1.25e-3, "max": 0.02},
        "max_tool_error_m": {"median": 2e-5, "max": 1e-3},
        "peak_contact_force_N": {"median": 0.0, "max": 12.5},
        "max_friction_use": {"median": 0.25, "max": 1.0000000000000002},
    }
    exempt = [
        {"signal": "jerk", "median_share": 0.1, "max_share": 0.9},
        {"signal": "path", "median_share": 0.205, "max_share": 0.4},
    ]
    told = {**to_keep(REPORT), "figures": figures, "not_judged": exempt}
    (results / "success_severe_reach.json").write_text(json.dumps(told))
    nothing = {**told, "figures": {}, "not_judged": []}
    (results / "alone_noise_reach.json").write_text(json.dumps(nothing))
    rows = [TABLES["tracking"](*of).splitlines()[2] for of in (("a", "success"), ("a", "alone"))]
    errors = "1.25, 20.00 | 0.02, 1.00 | 0.00, 12.50 | 0.75, 0.00"
    assert rows[0] == f"| `reach` | severe | {errors} | path: 20, 40 % |"
    assert rows[1] == f"| `reach` | {ALONE['noise'].words} | – | – | – | – | nothing |"


def test_what_broke_audits_becomes_rows(results: Path) -> None:
    """A limit counts once for an episode, however many joints broke it."""
    told = to_keep(REPORT)
    (results / "success_none_reach.json").write_text(json.dumps({**told, "broken": {}}))
    assert TABLES["broken"]() == NOTHING
    limits = ["measured a (joint5)", "measured a (joint6)", "torque rate (joint5)"]
    content = {**told, "broken": {"7": limits, "8": ["torque rate (joint1)"], "9": ["contact"]}}
    (results / "success_severe_reach.json").write_text(json.dumps(content))
    rows = TABLES["broken"]().splitlines()
    assert rows[2:4] == ["| `reach` | severe | 3 | torque rate 2, contact 1, measured a 1 |", ""]


def test_costs_of_a_period_and_of_a_decision_become_rows(results: Path) -> None:
    assert TABLES["costs"]() == NOTHING
    told = {"all_us": {"whole loop": 41.26}, "decision_us": 80.0, "decision_own_process_us": 1200.5}
    report = {**told, "provenance": ORIGIN_OF_TOY}
    (results / "step_cost.json").write_text(json.dumps(to_keep(report)))
    rows = TABLES["costs"]().splitlines()
    assert rows[2] == "| whole loop | 41.3 |"
    assert rows[4].endswith("| 1200.5 |")


def test_what_errors_of_ours_ended_is_told_beside_the_rate(results: Path) -> None:
    """Such episodes are not judged: a row without them would be of the others alone."""
    report = to_keep({**REPORT, "episodes": 5, "errors": 3})
    (results / "success_severe_reach.json").write_text(json.dumps(report))
    for table in ("success", "success_short"):
        assert "| 1 of 2, 3 ended by errors of ours " in TABLES[table]()


def test_an_episode_without_an_audit_has_kept_none(results: Path) -> None:
    """What broke off before anything moved; results of before do not tell how many did."""
    for told, audits in (({"audits_kept": 1}, 1), ({"audits_kept": 0}, 0), ({}, 2)):
        report = to_keep({**REPORT, "broken_audits": 0, **told})
        (results / "success_severe_reach.json").write_text(json.dumps(report))
        assert f"| ik 1 | {audits} |" in TABLES["success"]()
        short = f"9.5–90.5 %), audit kept in {audits} |" if audits < 2 else "9.5–90.5 %) |"
        assert short in TABLES["success_short"]()


def test_rows_and_columns_without_a_kept_file_are_left_out(results: Path) -> None:
    assert TABLES["success_short"]() == TABLES["success"]() == TABLES["robots"]() == NOTHING
    told = to_keep(REPORT)
    for name in ("success_moderate_reach", "success_none_reach", "success_none_stack"):
        (results / f"{name}.json").write_text(json.dumps(told))
    short = TABLES["success_short"]().splitlines()
    whole = "1 of 2 (9.5–90.5 %)"
    rate = f"{whole}, audit kept in 1"
    assert short[0] == "| task | `none` | `moderate` |"
    assert short[2:4] == [f"| `reach` | {rate} | {rate} |", f"| `stack` | {rate} | – |"]
    later = {**told, "broken_audits": 0, "commit": "fedcba9876543210", "date": "2026-01-05"}
    (results / "robots_ur5e_obstacle_reach.json").write_text(json.dumps(later))
    (results / "robots_panda_reach.json").write_text(json.dumps(told))
    robots = TABLES["robots"]().splitlines()
    assert robots[0] == "| robot | `reach` | `obstacle_reach` |"
    assert robots[2:4] == [f"| `panda` | {rate} | – |", f"| `ur5e` | – | {whole} |"]
    commits = "Commits `0123456789`, `fedcba9876`, 2026-01-02 to 2026-01-05"
    assert robots[5] == f"{commits}; `docs/results/robots_*.json`."


@pytest.mark.parametrize("kind", ALONE)
def test_worlds_that_are_wrong_in_one_way_become_rows(
    kind: str, results: Path, tmp_path: Path
) -> None:
    assert TABLES["alone"]() == NOTHING
    wrong = {**REPORT["settings"], "perturbation": plain(ALONE[kind].wrong)}
    report = tmp_path / "eval.report"
    report.write_text(json.dumps({**REPORT, "settings": wrong}))
    for name in ("alone_noise_stack", "success_none_reach"):
        with pytest.raises(InvalidValueError, match="--name must be"):
            keep.run(keep.KeepOptions(report=report, name=name), Console(quiet=True))
    keep.run(keep.KeepOptions(report=report, name=f"alone_{kind}_reach"), Console(quiet=True))
    row = f"| `reach` | {ALONE[kind].words} | 1 of 2 | 9.5–90.5 % | 1 | ik 1 | 1 | 12.3 s | 7 |"
    assert TABLES["alone"]().splitlines()[2] == f"{row} `0123456` |"


def test_policies_are_told_against_the_first(results: Path) -> None:
    one = {key: REPORT[key] for key in ("successes", "judged", "interval", "causes")}
    report = {
        "baseline": "classical:qp",
        "policies": [{**one, "policy": "classical:qp"}, {**one, "policy": "classical:dls"}],
        "comparisons": [{"difference": -0.5, "interval": [-0.8, 0.1], "p": 0.1, "p_holm": 0.2}],
        "provenance": ORIGIN_OF_TOY,
    }
    (results / "toy.json").write_text(json.dumps(to_keep(report)))
    rows = TABLES["policies"]("toy").splitlines()
    assert rows[2] == "| `classical:qp` | 1 of 2 | 9.5–90.5 % | ik 1 |  |"
    assert rows[3].endswith("| -50.0 points (-80.0 to +10.0), p = 0.2 |")
    assert TABLES["policies"]("another") == NOTHING


CURVES: dict[str, Any] = {
    **ORIGIN_OF_TOY,
    "task": "reach",
    "episodes": 4,
    "seed": 7,
    "units": {"pose_bias": "m", "link_mass": "-"},
    "curves": [
        {
            "stack": stack,
            "kind": kind,
            "half_is_lost_at": None,
            "points": [
                {
                    "value": value,
                    "successes": successes,
                    "episodes": 4,
                    "causes": {},
                    "audits_kept": 0,
                    "interval": [0.0, 1.0],
                }
                for value, successes in ((None, 4), (0.1, last))
            ],
        }
        for stack, last in (("stack", 3), ("dls", 0))
        for kind in ("pose_bias", "link_mass")
    ],
}


def test_curves_become_rows_and_a_picture(
    results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert TABLES["robustness"]("toy") == NOTHING
    (results / "toy.json").write_text(json.dumps(to_keep(CURVES)))
    lines = TABLES["robustness"]("toy").splitlines()
    assert lines[0] == "| alone | `stack` | `dls` |"
    assert lines[2:4] == [
        "| `--pose-bias` [m] | > 0.1 | 0.05 |",
        "| `--link-mass` | > 0.1 | 0.05 |",
    ]
    monkeypatch.setattr(tables, "ROOT", tmp_path)
    monkeypatch.setattr(tables, "ROBUSTNESS", "toy")
    (tmp_path / "README.md").write_text("no table")
    picture = tmp_path / "docs" / "toy.png"
    picture.parent.mkdir()
    assert tables.run(tables.TablesOptions(check=True), Console(quiet=True)) == 0
    assert not picture.exists()
    assert tables.run(tables.TablesOptions(), Console(quiet=True)) == 0
    assert picture.read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("success_severe_reach", "success_none_reach"),
        ("success_none_stack", "success_none_reach"),
        ("robots_ur5e_reach", "robots_panda_reach"),
    ],
)
def test_an_evaluation_is_kept_under_its_own_name(
    name: str, words: str, results: Path, tmp_path: Path
) -> None:
    report = tmp_path / "eval.report"
    report.write_text(json.dumps(REPORT))
    with pytest.raises(InvalidValueError, match=f"--name must be .*{words}.*; found {name}"):
        keep.run(keep.KeepOptions(report=report, name=name), Console(quiet=True))
    keep.run(keep.KeepOptions(report=report, name=words), Console(quiet=True))
    assert kept(words)["task"] == "reach"


def test_only_the_default_stack_is_kept_as_a_success(tmp_path: Path, results: Path) -> None:
    report = tmp_path / "eval.report"
    other = {**REPORT["settings"], "policy": policy_settings(ClassicalStack(ik="dls"), None)}
    report.write_text(json.dumps({**REPORT, "settings": other}))
    options = keep.KeepOptions(report=report, name="success_none_reach")
    with pytest.raises(InvalidValueError, match="--name must be none of those"):
        keep.run(options, Console(quiet=True))


@pytest.mark.parametrize("page", tables.pages(), ids=lambda page: page.name)
def test_no_figure_of_a_table_is_kept_by_hand(page: Path) -> None:
    text = re.sub(r"<!-- (table|figure): .*?<!-- end -->", "", page.read_text("utf-8"), flags=re.S)
    rows = re.findall(r"^\|.*$", text, flags=re.MULTILINE)
    measured = re.compile(r"\b\d+ of \d+\b|\d\.\d+ (?:%|ms|µs|mrad|s)\b|\d – \d")
    assert [row for row in rows if measured.search(row)] == []


def test_a_single_figure_is_written_into_its_line(results: Path) -> None:
    (results / "toy.json").write_text(json.dumps(to_keep(REPORT)))
    text = "It took <!-- figure: toy figures.cycle_time_s.median .1f -->9<!-- end --> s."
    assert rendered(text, {}) == text.replace("-->9<", "-->12.3<")


@pytest.mark.parametrize(
    "text",
    [
        "<!-- table: success -->\nno end\n",
        "<!-- table: nothing toy -->\n<!-- end -->\n",
        "x <!-- figure: toy figures.nothing .1f -->1<!-- end -->",
        "x <!-- figure: toy task .1f -->1<!-- end -->",
    ],
)
def test_a_mark_that_leads_nowhere_is_refused(results: Path, text: str) -> None:
    (results / "toy.json").write_text(json.dumps(to_keep(REPORT)))
    with pytest.raises(RecordingError):
        rendered(text, TABLES)


def test_a_condition_that_was_not_measured_is_refused(results: Path) -> None:
    figures = ("max_joint_error", "max_joint_error_again", "max_tool_error", "last_tool_error")
    units = ("rad", "rad", "m", "m")
    one = {f"{name}_{unit}": 1e-3 for name, unit in zip(figures, units, strict=True)}
    trials = {"moderate 1": {"PD": {**one, "stable": True}, "wild": {**one, "stable": False}}}
    found = {"trials": trials, **ORIGIN_OF_TOY}
    (results / "compare_controllers.json").write_text(json.dumps(found))
    table = TABLES["controllers"]("moderate_1")
    assert "| moderate 1 | `PD` | 1 mrad | 1 mrad | 1 mm | 1 mm |" in table
    assert "wild" not in table
    with pytest.raises(RecordingError, match=r"no condition severe_1; there are: moderate_1"):
        TABLES["controllers"]("moderate_1", "severe_1")


def test_of_the_episodes_the_failures_and_broken_promises_are_kept() -> None:
    found = to_keep(REPORT)
    assert "entries" not in found
    assert found["seeds"] == [7, 8]
    assert [one["seed"] for one in found["failures"]] == [8]
    assert found["broken"] == {"8": ["torque"]}
    assert {key: found[key] for key in ORIGIN} == ORIGIN_OF_TOY


def test_no_kept_file_tells_folders_of_a_machine() -> None:
    command = "robo47 evaluate --log /home/me/logs/a.rrd --policy /my/b.py:C --against=/c/d.json"
    found = to_keep({**REPORT, "provenance": {**ORIGIN_OF_TOY, "command": command}})
    assert "/" not in found["command"]
    assert "--log a.rrd" in found["command"]
    assert "--against=d.json" in found["command"]
    relative = "robo47 evaluate --log logs/a.rrd"
    found = to_keep({**REPORT, "provenance": {**ORIGIN_OF_TOY, "command": relative}})
    assert found["command"] == relative
    for path in RESULTS.glob("*.json"):
        assert not re.search(r"(^|[\s='])/", json.loads(path.read_text())["command"]), path.name


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
