"""The report of a run, as JSON and as Markdown."""

import dataclasses
import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from math import isfinite
from typing import Any

from robo47_qp import __version__
from robo47_qp._core.library import backend
from robo47_qp.files import plain
from robo47_qp.report.audit.finding import Finding
from robo47_qp.run.scenario import Run

_PACKAGES = ("mujoco", "mink", "qpsolvers", "daqp", "osqp", "ruckig", "numpy", "scipy", "rerun-sdk")


def report(run: Run, metrics: Mapping[str, float], findings: Sequence[Finding]) -> dict[str, Any]:
    """Return outcome, settings, metrics, audit and motions of a run as JSON types."""
    failure, scenario = run.failure, run.scenario
    return {
        "success": failure is None,
        "failure": None if failure is None else failure.cause.value,
        "evidence": None if failure is None else failure.evidence,
        "seed": scenario.seed,
        "task": scenario.task.name,
        "robot": scenario.robot.name,
        "settings": {
            name: plain(getattr(scenario, name))
            for name in ("task", "planner", "controller", "observer")
        },
        "versions": versions(),
        "metrics": dict(metrics),
        "audit": [dataclasses.asdict(finding) for finding in findings],
        "waypoints": [
            {
                "name": leg.waypoint.name,
                "motion": leg.waypoint.motion.name.lower(),
                "duration_s": leg.trajectory.duration,
                "lower_bound_s": leg.lower_bound,
                "iterations": leg.ik.iterations,
                "restarts": leg.ik.restarts,
                "seconds": leg.ik.seconds,
                "position_error_m": leg.ik.position_error,
                "orientation_error_rad": leg.ik.orientation_error,
                # Of the joint closest to its limit, whichever it is.
                f"limit_margin_{scenario.robot.unit('rad', 'm').replace(' ', '_')}": (
                    leg.ik.limit_margin if isfinite(leg.ik.limit_margin) else None
                ),
            }
            for leg in run.legs
        ],
    }


def summary_markdown(summary: Mapping[str, Any]) -> str:
    """Return a report as Markdown."""
    outcome = "Success" if summary["success"] else f"Failed: {summary['failure']}"
    lines = [f"# {outcome}", ""]
    if summary["evidence"]:
        lines += [summary["evidence"], ""]
    lines += ["| figure | value |", "|---|--:|"]
    lines += [f"| {name} | {value:.4g} |" for name, value in summary["metrics"].items()]
    lines += ["", "| signal | limit | extreme | unit | at s | kept |"]
    lines += ["|---|--:|--:|---|--:|---|"]
    lines += [
        f"| {f['signal']} | {f['limit']:.4g} | {f['extreme']:.4g} | {f['unit']} | "
        f"{f['time']:.3f} | {_kept(f)} |"
        for f in summary["audit"]
    ]
    return "\n".join(lines)


def _kept(finding: Mapping[str, Any]) -> str:
    if finding["exempt"]:
        share = 100 * finding["share"]
        return f"not judged, {share:.1f} % of the time: {finding['exempt']}"
    return "yes" if finding["ok"] else "NO"


def versions() -> dict[str, str]:
    """Return what a result depends on: the versions of Python and of packages, and the backend."""
    return {
        "robo47_qp": __version__,
        "backend": backend(),
        "python": platform.python_version(),
        **{package: version(package) for package in _PACKAGES},
    }
