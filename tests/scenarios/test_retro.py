"""The check of the kept figures: real runs, and reports that were meddled with."""

import copy
import json
import platform
from collections.abc import Callable
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from robo47_qp.cli import FAILED, OK
from robo47_qp.errors import RecordingError
from robo47_qp.files import read_json, write_json
from robo47_qp.report.audit.audit import audit
from robo47_qp.report.metrics import metrics
from robo47_qp.report.run_report import report
from scenarios.cartpole_lqr import CartPoleOptions
from scenarios.cartpole_lqr import run as run_cartpole
from scenarios.retro import OF_THE_CLOCK, REPORTS, ROOT, RetroOptions, figures, machine, run
from scenarios.settling import SettlingOptions
from scenarios.settling import run as run_settling
from tests.runs import picked_and_placed

KEPT = ROOT / "docs" / "reproduced.json"
Reports = dict[str, dict[str, Any]]


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `make reproduce` leaves, by the same code."""
    folder, quiet = tmp_path_factory.mktemp("logs"), Console(file=StringIO())
    done = picked_and_placed()
    write_json(folder / "run.json", report(done, metrics(done), audit(done)))
    assert run_settling(SettlingOptions(report=folder / "settling.json"), quiet) == OK
    assert run_cartpole(CartPoleOptions(report=folder / "cartpole_lqr.json"), quiet) == OK
    return folder


@pytest.fixture(scope="module")
def reports(logs: Path) -> Reports:
    return {scenario: read_json(logs / name, "") for scenario, name in REPORTS.items()}


def checked(folder: Path, reports: Reports, *, kept: Path) -> tuple[int, str, str]:
    """Exit code, what is printed, and the page."""
    for scenario, name in REPORTS.items():
        write_json(folder / name, reports[scenario])
    text, out = StringIO(), folder / "RETRO.md"
    options = RetroOptions(logs=folder, kept=kept, out=out, commit="commit abc")
    code = run(options, Console(file=text, width=200))
    return code, text.getvalue(), out.read_text(encoding="utf-8")


@pytest.fixture
def kept(tmp_path: Path, logs: Path) -> Path:
    """The figures of the runs of this test, kept."""
    path = tmp_path / "kept" / "reproduced.json"
    assert run(RetroOptions(logs=logs, kept=path, keep=True), Console(file=StringIO())) == OK
    return path


def test_the_repository_keeps_what_its_code_gives(tmp_path: Path, logs: Path) -> None:
    """Where this fails after an intended change: make keep."""
    options = RetroOptions(logs=logs, kept=KEPT, out=tmp_path / "RETRO.md")
    text = StringIO()
    assert run(options, Console(file=text, width=200)) == OK, text.getvalue()
    assert "Yes: " in (tmp_path / "RETRO.md").read_text(encoding="utf-8")


def test_what_was_just_kept_is_identical(tmp_path: Path, reports: Reports, kept: Path) -> None:
    code, text, page = checked(tmp_path, reports, kept=kept)
    assert code == OK
    assert "figures are identical to the bit" in text
    assert "Run: commit abc." in page
    assert "nothing but the same bits will do" in page
    assert page.count("| identical |") == len(figures(reports)) - len(OF_THE_CLOCK)
    assert page.count("| not judged |") == len(OF_THE_CLOCK)


def test_every_metric_and_promise_is_among_the_figures(reports: Reports) -> None:
    found = figures(reports)
    for scenario, content in reports.items():
        for name, value in content["metrics"].items():
            assert found[f"{scenario}/{name}"] == value
    assert found["settling/mean_settling_time_s"] > 0.1
    assert found["cartpole_lqr/mean_settling_time_s"] > 1.0
    assert found["pickplace/succeeded"] == 1.0
    assert found["pickplace/promises broken"] == 0.0
    main = reports["pickplace"]
    assert found["pickplace/torque rate [N·m/s]"] == next(
        finding["extreme"] for finding in main["audit"] if "torque rate" in finding["signal"]
    )
    assert found["pickplace/4 carry [s]"] == main["waypoints"][3]["duration_s"]
    assert len(found) == 3 + 3 + len(main["metrics"]) + 2 + len(main["audit"]) + 7


def scale(scenario: str, metric: str, factor: float) -> Callable[[Reports], None]:
    def act(reports: Reports) -> None:
        reports[scenario]["metrics"][metric] *= factor

    return act


def fail(reports: Reports) -> None:
    reports["pickplace"]["success"] = False


def break_promise(reports: Reports) -> None:
    reports["pickplace"]["audit"][3]["ok"] = False


def overshoot(reports: Reports) -> None:
    reports["pickplace"]["audit"][3]["extreme"] *= 1.011


def forget(reports: Reports) -> None:
    del reports["pickplace"]["metrics"]["place_error_m"]


def invent(reports: Reports) -> None:
    reports["settling"]["metrics"]["overshoot"] = 0.1


def retry(reports: Reports) -> None:
    reports["pickplace"]["waypoints"].append(dict(reports["pickplace"]["waypoints"][0]))


def lose_the_clock(reports: Reports) -> None:
    del reports["pickplace"]["metrics"]["step_us"]


@pytest.mark.parametrize(
    ("meddle", "told"),
    [
        (scale("settling", "mean_settling_time_s", 1.011), "settling/mean_settling_time_s"),
        (scale("cartpole_lqr", "mean_settling_time_s", 0.989), "cartpole_lqr/mean_settling_time_s"),
        (scale("pickplace", "rms_tool_error_m", 1.011), "pickplace/rms_tool_error_m"),
        (fail, "pickplace/succeeded | 1 | 0 | -1e+02 % | BEYOND THE BAR"),
        (break_promise, "pickplace/promises broken | 0 | 1 | none | BEYOND THE BAR"),
        (overshoot, "pickplace/reference a"),
        (forget, "pickplace/place_error_m"),
        (invent, "settling/overshoot | none | 0.1 | none | NOT KEPT"),
        (retry, "pickplace/8 approach"),
        (lose_the_clock, "pickplace/step_us"),
    ],
)
@pytest.mark.parametrize("elsewhere", [False, True])
def test_what_was_not_reproduced_is_told_and_fails(
    tmp_path: Path,
    reports: Reports,
    kept: Path,
    meddle: Callable[[Reports], None],
    told: str,
    elsewhere: bool,
) -> None:
    changed = copy.deepcopy(reports)
    meddle(changed)
    if elsewhere:
        changed["pickplace"]["versions"]["numpy"] = "9.9"
    code, text, page = checked(tmp_path, changed, kept=kept)
    assert code == FAILED
    assert text.count("not reproduced  ") == 1
    assert told in text
    assert told in page
    assert "No: 1 of " in page


def test_a_small_change_passes_elsewhere_and_not_here(
    tmp_path: Path, reports: Reports, kept: Path
) -> None:
    changed = copy.deepcopy(reports)
    scale("pickplace", "place_error_m", 1.009)(changed)
    code, text, _ = checked(tmp_path, changed, kept=kept)
    assert code == FAILED
    assert "NOT IDENTICAL" in text
    changed["pickplace"]["versions"]["mujoco"] = "4.0.1"
    code, text, page = checked(tmp_path, changed, kept=kept)
    assert code == OK
    assert "the others within the bar" in text
    assert "another: mujoco" in page


def test_neither_the_clock_nor_the_project_s_own_version_is_judged(
    tmp_path: Path, reports: Reports, kept: Path
) -> None:
    changed = copy.deepcopy(reports)
    for name in OF_THE_CLOCK:
        scenario, _, metric = name.partition("/")
        scale(scenario, metric, 3.0)(changed)
    changed["pickplace"]["versions"]["robo47_qp"] = "9.0"
    code, _, page = checked(tmp_path, changed, kept=kept)
    assert code == OK
    assert "+2e+02 % | not judged" in page
    assert "nothing but the same bits" in page


@pytest.mark.parametrize(
    ("meddle", "told"),
    [
        (fail, "not to be kept"),
        (break_promise, "not to be kept"),
        ({"task": "reach"}, "The last run is not the main job"),
        ({"seed": 7}, "The last run is not the main job"),
        ({"audit": []}, "The last run is not the main job"),
    ],
)
def test_what_failed_or_is_not_the_main_job_is_not_kept(
    tmp_path: Path, reports: Reports, meddle: Callable[[Reports], None] | dict[str, Any], told: str
) -> None:
    changed = copy.deepcopy(reports)
    if isinstance(meddle, dict):
        changed["pickplace"].update(meddle)
    else:
        meddle(changed)
    for scenario, name in REPORTS.items():
        write_json(tmp_path / name, changed[scenario])
    options = RetroOptions(logs=tmp_path, kept=tmp_path / "kept.json", keep=True)
    with pytest.raises(RecordingError, match=told):
        run(options, Console(file=StringIO()))
    assert not (tmp_path / "kept.json").exists()


def test_nan_and_other_things_that_are_no_numbers_are_told(reports: Reports) -> None:
    for value, found in (("fast", "'fast'"), (None, "None"), (True, "True")):
        changed = copy.deepcopy(reports)
        changed["settling"]["metrics"]["mean_settling_time_s"] = value
        with pytest.raises(RecordingError, match=f"must be a number; found {found}"):
            figures(changed)


def test_nan_in_a_report_is_flagged(tmp_path: Path, reports: Reports, kept: Path) -> None:
    text = json.dumps(reports["settling"]).replace(
        repr(reports["settling"]["metrics"]["mean_settling_time_s"]), "NaN"
    )
    for scenario, name in REPORTS.items():
        write_json(tmp_path / name, reports[scenario])
    (tmp_path / "settling.json").write_text(text)
    printed = StringIO()
    options = RetroOptions(logs=tmp_path, kept=kept, out=tmp_path / "RETRO.md")
    assert run(options, Console(file=printed, width=200)) == FAILED
    assert "NOT A NUMBER" in printed.getvalue()


def test_figures_told_twice_are_refused(reports: Reports) -> None:
    changed = copy.deepcopy(reports)
    changed["pickplace"]["audit"].append(dict(changed["pickplace"]["audit"][0]))
    with pytest.raises(RecordingError, match="tell figures twice: pickplace/reference q lower"):
        figures(changed)


def test_reports_that_lack_something_are_told_with_the_remedy(
    tmp_path: Path, reports: Reports, kept: Path
) -> None:
    changed = copy.deepcopy(reports)
    del changed["pickplace"]["audit"]
    with pytest.raises(RecordingError, match=r"report of pickplace .*'audit'.*make reproduce"):
        figures(changed)
    options = RetroOptions(logs=tmp_path / "empty", kept=kept, out=tmp_path / "RETRO.md")
    with pytest.raises(RecordingError, match=r"cannot be read: .*make reproduce"):
        run(options, Console(file=StringIO()))
    write_json(tmp_path / "bare.json", {"figures": {}})
    with pytest.raises(RecordingError, match="lacks its machine or its figures: make keep"):
        checked(tmp_path, reports, kept=tmp_path / "bare.json")


def test_the_machine_is_the_same_twice_and_names_no_place() -> None:
    assert machine() == machine()
    assert {"processor", "instructions", "system"} == set(machine())
    assert all(machine().values())
    assert platform.node() not in " ".join(machine().values())
