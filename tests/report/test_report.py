"""The report: plain JSON with everything that a result depends on."""

import json
import platform
from dataclasses import replace
from importlib.metadata import version
from typing import Any

import numpy as np
import pytest
from mink import SE3

import robo47_qp
from robo47_qp._core.library import backend
from robo47_qp.files import plain
from robo47_qp.ik.solver import Tolerance
from robo47_qp.report.audit.audit import audit
from robo47_qp.report.metrics import metrics
from robo47_qp.report.run_report import report, summary_markdown, versions
from robo47_qp.run.failure import Cause, Failure
from robo47_qp.run.scenario import Run
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from tests.runs import carry_out, picked_and_placed


def summary_of(run: Run) -> dict[str, Any]:
    return report(run, metrics(run), audit(run))


@pytest.fixture(scope="module")
def summary() -> dict[str, Any]:
    return summary_of(picked_and_placed(seed=2))


def test_it_has_what_a_reader_looks_for(summary: dict[str, Any]) -> None:
    assert summary["success"] is True
    assert summary["failure"] is None
    assert summary["evidence"] is None
    assert summary["seed"] == 2
    assert summary["task"] == "pick_place"
    assert summary["robot"] == "panda"
    assert {
        "place_error_m",
        "max_joint_error_rad",
        "max_tool_error_m",
        "cycle_time_s",
        "real_time_factor",
        "step_us",
    } <= set(summary["metrics"])
    assert len(summary["audit"]) == len(audit(picked_and_placed(seed=2)))
    for finding in summary["audit"]:
        names = {"signal", "limit", "extreme", "ok", "time", "unit", "exempt", "share", "least"}
        assert names == set(finding)
        of_a_distance = any(name in finding["signal"] for name in ("clearance", "distance"))
        assert finding["least"] == of_a_distance
        assert finding["ok"] is True
        slack = 1e-6 * abs(finding["limit"])
        least = (" q lower (", "clearance", "distance")
        if any(name in finding["signal"] for name in least):
            assert finding["extreme"] >= finding["limit"] - slack
        else:
            assert finding["extreme"] <= finding["limit"] + slack


def test_it_survives_json(summary: dict[str, Any]) -> None:
    text = json.dumps(summary, allow_nan=False)
    assert json.loads(text) == summary


def test_settings_are_all_there_by_name(summary: dict[str, Any]) -> None:
    settings = summary["settings"]
    assert settings["task"]["class"] == "PickPlace"
    assert settings["task"]["pick"] == list(PickPlace().pick)
    assert settings["task"]["grip_force"] == 30.0
    assert settings["planner"]["class"] == "Planner"
    assert settings["planner"]["pace"] == 1.0
    assert settings["planner"]["profile"]["v_max"] == [2.0] * 7
    assert settings["planner"]["ik"]["class"] == "MultiStart"
    assert settings["planner"]["ik"]["solver"]["class"] == "MinkIk"
    assert settings["planner"]["ik"]["solver"]["backend"] == "daqp"
    assert settings["controller"] == {
        "class": "ComputedTorque",
        "frequency": 30.0,
        "damping_ratio": 1.0,
        "stiffness_share": 0.25,
    }
    assert settings["observer"]["class"] == "DisturbanceObserver"
    assert settings["observer"]["bandwidth"] == 140.0


def test_every_leg_is_told(summary: dict[str, Any]) -> None:
    run = picked_and_placed(seed=2)
    assert [waypoint["name"] for waypoint in summary["waypoints"]] == [
        leg.waypoint.name for leg in run.legs
    ]
    motions = [waypoint["motion"] for waypoint in summary["waypoints"]]
    assert motions == ["ptp", "lin", "lin", "ptp", "lin", "lin", "ptp"]
    for waypoint, leg in zip(summary["waypoints"], run.legs, strict=True):
        assert waypoint["duration_s"] == pytest.approx(leg.trajectory.duration)
        assert waypoint["position_error_m"] <= 1e-6
        assert waypoint["orientation_error_rad"] <= 1e-6
        assert waypoint["limit_margin_rad"] > 0.0


def test_versions_are_those_installed(summary: dict[str, Any]) -> None:
    found = summary["versions"]
    assert found == versions()
    assert found["backend"] == backend()
    assert found["python"] == platform.python_version()
    assert found["robo47_qp"] == robo47_qp.__version__
    for package in ("mujoco", "mink", "qpsolvers", "daqp", "ruckig", "numpy", "rerun-sdk"):
        assert found[package] == version(package)


def test_it_is_the_same_again_but_for_the_clock() -> None:
    def timeless(summary: dict[str, Any]) -> dict[str, Any]:
        for name in ("real_time_factor", "step_us"):
            del summary["metrics"][name]
        for waypoint in summary["waypoints"]:
            del waypoint["seconds"]
        return summary

    first = timeless(summary_of(picked_and_placed()))
    second = timeless(summary_of(carry_out(PickPlace())))
    assert json.dumps(first) == json.dumps(second)


def test_a_failure_is_told_with_its_evidence() -> None:
    failure = Failure(cause=Cause.DROP, evidence="the fingers are empty")
    summary = summary_of(replace(picked_and_placed(), failure=failure))
    assert summary["success"] is False
    assert summary["failure"] == "drop"
    assert summary["evidence"] == "the fingers are empty"
    assert summary["seed"] is None
    text = summary_markdown(summary)
    assert text.startswith("# Failed: drop\n")
    assert "the fingers are empty" in text


def test_the_markdown_tells_figures_and_promises(summary: dict[str, Any]) -> None:
    text = summary_markdown(summary)
    assert text.startswith("# Success\n")
    for name, value in summary["metrics"].items():
        assert f"| {name} | {value:.4g} |" in text
    for finding in summary["audit"]:
        assert f"| {finding['signal']} | {finding['limit']:.4g} |" in text
        assert f"| {finding['unit']} | {finding['time']:.3f} | yes |" in text
    assert "| NO |" not in text
    broken = {**summary, "audit": [{**summary["audit"][0], "ok": False}]}
    assert summary_markdown(broken).count("| NO |") == 1


def test_settings_become_plain_json() -> None:
    found = plain(Tolerance(position=1e-3, orientation=float("inf")))
    assert found == {
        "class": "Tolerance",
        "position": 1e-3,
        "orientation": "inf",
        "demand": {"class": "ToolDemand"},
    }
    assert plain([np.array([1.0, np.nan]), None, True, Cause.DROP]) == [
        *([1.0, "nan"], None, True, Cause.DROP.value)
    ]
    pose = SE3.from_translation(np.array([0.1, 0.2, 0.3]))
    assert plain([pose]) == [{"class": "SE3", "wxyz_xyz": [1.0, 0.0, 0.0, 0.0, 0.1, 0.2, 0.3]}]
    assert plain(object()) == {"class": "object"}
