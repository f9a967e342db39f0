"""Several policies on the same seeds, as JSON: each beside the others, and against the first."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from robo47_qp.evaluation.report.summary import compared
from robo47_qp.evaluation.statistics import CONFIDENCE, holm

CYCLE = "cycle_time_s"
"""The metric that is compared."""
_OWN = ("policy", "successes", "episodes", "rate", "interval", "causes", "errors", "broken_audits")
_SHARED = ("task", "robot", "perturbation", "code")


def paired(reports: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """The comparison of summaries, by the names of their files; the first is the baseline.

    Raises:
        InvalidValueError: Their episodes are no pairs.
    """
    baseline, *others = reports.values()
    comparisons = [_against(other, baseline) for other in others]
    corrected = holm([comparison["p"] for comparison in comparisons])
    for comparison, p in zip(comparisons, corrected, strict=True):
        comparison["p_holm"] = p
    return {
        "task": baseline["task"],
        "baseline": baseline["policy"],
        "episodes": baseline["episodes"],
        "confidence": CONFIDENCE,
        "policies": [_own(name, report) for name, report in reports.items()],
        "comparisons": comparisons,
        "settings": {name: baseline["settings"].get(name) for name in _SHARED},
        "versions": baseline["versions"],
    }


def _own(name: str, report: Mapping[str, Any]) -> dict[str, Any]:
    median = report["figures"].get(CYCLE, {}).get("median")
    return {"report": name, **{key: report[key] for key in _OWN}, f"median_{CYCLE}": median}


def _against(a: Mapping[str, Any], b: Mapping[str, Any]) -> dict[str, Any]:
    """A policy less the baseline b."""
    theirs = {entry["seed"]: entry for entry in b["entries"]}
    pairs = [(e, theirs[e["seed"]]) for e in a["entries"] if e["seed"] in theirs]
    return {
        **compared(a, b),
        "identical": sum(x["sha256"] is not None and x["sha256"] == y["sha256"] for x, y in pairs),
        CYCLE: _cycle_times(pairs),
        "differing": [_differing(x, y) for x, y in pairs if x["success"] != y["success"]],
    }


def _cycle_times(pairs: Sequence[tuple[Mapping[str, Any], Mapping[str, Any]]]) -> dict[str, Any]:
    """Over the episodes that both solved: the median of what a takes longer than b [s]."""
    solved = [
        (x["metrics"][CYCLE], y["metrics"][CYCLE])
        for x, y in pairs
        if x["success"] and y["success"] and CYCLE in x["metrics"] and CYCLE in y["metrics"]
    ]
    if not solved:
        return {"episodes": 0, "median_difference": None}
    a, b = np.array(solved).T
    return {"episodes": len(solved), "median_difference": float(np.median(a - b))}


def _differing(a: Mapping[str, Any], b: Mapping[str, Any]) -> dict[str, Any]:
    """An episode that only one solved, with what stopped the other."""
    failed = b if a["success"] else a
    error = failed["error"]
    return {
        "seed": a["seed"],
        "solved_by": "a" if a["success"] else "b",
        "cause": "error" if error is not None else failed["cause"],
        "evidence": error.splitlines()[-1] if error is not None else failed["evidence"],
        "step": failed["step"],
        "time": failed["time"],
    }
