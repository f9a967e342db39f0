"""The machine-readable report of a run."""

import dataclasses
import platform
from collections.abc import Mapping, Sequence
from enum import Enum
from importlib.metadata import version
from typing import Any

import numpy as np

from robo47_qp import __version__
from robo47_qp.audit import Finding
from robo47_qp.run import Run

_PACKAGES = ("mujoco", "mink", "qpsolvers", "daqp", "osqp", "ruckig", "numpy", "rerun-sdk")


def report(run: Run, metrics: Mapping[str, float], findings: Sequence[Finding]) -> dict[str, Any]:
    """Everything worth keeping of a run but its signals, as plain JSON types."""
    failure, scenario = run.failure, run.scenario
    return {
        "success": failure is None,
        "failure": None if failure is None else failure.cause.value,
        "evidence": None if failure is None else failure.evidence,
        "seed": scenario.seed,
        "task": scenario.task.name,
        "robot": scenario.robot.name,
        "settings": {
            name: _plain(getattr(scenario, name)) for name in ("task", "planner", "controller")
        },
        "versions": versions(),
        "metrics": dict(metrics),
        "audit": [dataclasses.asdict(finding) for finding in findings],
        "waypoints": [
            {
                "name": leg.waypoint.name,
                "motion": leg.waypoint.motion.value,
                "duration_s": leg.trajectory.duration,
                "lower_bound_s": leg.lower_bound,
                "iterations": leg.ik.iterations,
                "restarts": leg.ik.restarts,
                "seconds": leg.ik.seconds,
                "position_error_m": leg.ik.position_error,
                "orientation_error_rad": leg.ik.orientation_error,
                "limit_margin_rad": leg.ik.limit_margin,
            }
            for leg in run.legs
        ],
    }


def summary_markdown(summary: Mapping[str, Any]) -> str:
    """The report for people, as Markdown."""
    outcome = "Success" if summary["success"] else f"Failed: {summary['failure']}"
    lines = [f"# {outcome}", ""]
    if summary["evidence"]:
        lines += [summary["evidence"], ""]
    lines += ["| figure | value |", "|---|--:|"]
    lines += [f"| {name} | {value:.4g} |" for name, value in summary["metrics"].items()]
    lines += ["", "| promise | limit | extreme | unit | kept |", "|---|--:|--:|---|---|"]
    lines += [
        f"| {f['signal']} | {f['limit']:.4g} | {f['extreme']:.4g} | {f['unit']} | "
        f"{'yes' if f['ok'] else 'NO'} |"
        for f in summary["audit"]
    ]
    return "\n".join(lines)


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that a result depends on."""
    return {
        "robo47_qp": __version__,
        "python": platform.python_version(),
        **{package: version(package) for package in _PACKAGES},
    }


def _plain(value: object) -> Any:
    """A setting as JSON: dataclasses by field with the name of their class."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: _plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
        return {"class": type(value).__name__, **fields}
    match value:
        case np.ndarray():
            return value.tolist()
        case Enum():
            return value.value
        case tuple() | list():
            return [_plain(item) for item in value]
        case _:
            return value
