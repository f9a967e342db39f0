"""The figures of an evaluation, as JSON."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.episode import EpisodeResult
from robo47_qp.evaluation.statistics import (
    CONFIDENCE,
    mcnemar,
    paired_difference,
    wilson,
)
from robo47_qp.report.run_report import versions

PAIRED = ("task", "robot", "perturbation")
"""Settings that two evaluations must share, or their episodes are no pairs."""


def summary(settings: Mapping[str, Any], results: Sequence[EpisodeResult]) -> dict[str, Any]:
    """All figures of finished episodes; nothing but "timing" differs from run to run.

    An error of our own counts as no success, and has no cause: see "errors".
    """
    n, successes = len(results), sum(result.success for result in results)
    causes = Counter(result.cause for result in results if result.cause is not None)
    return {
        "task": settings["task"]["name"],
        "policy": _policy(settings["policy"]),
        "episodes": n,
        "successes": successes,
        "rate": successes / n,
        "interval": list(wilson(successes, n)),
        "confidence": CONFIDENCE,
        "causes": dict(sorted(causes.items(), key=lambda item: (-item[1], item[0]))),
        "errors": sum(result.error is not None for result in results),
        "broken_audits": sum(result.audit_ok is False for result in results),
        "figures": _figures(results),
        "settings": dict(settings),
        "versions": versions(),
        "entries": [result.entry() for result in results],
    }


def throughput(results: Sequence[EpisodeResult], seconds: float, workers: int) -> dict[str, float]:
    """Episodes per minute of those that were run now, in so many seconds.

    Returns:
        Empty where none was; the time includes the start of the workers.
    """
    if not results or seconds <= 0.0:
        return {}
    rate = 60.0 * len(results) / seconds
    busy = sum(result.timing.get("wall_s", 0.0) for result in results)
    return {
        "episodes": len(results),
        "workers": workers,
        "wall_s": seconds,
        "episodes_per_minute": rate,
        "episodes_per_minute_per_worker": rate / workers,
        "busy": busy / (seconds * workers),
    }


def compared(a: Mapping[str, Any], b: Mapping[str, Any]) -> dict[str, Any]:
    """Two summaries on the seeds that both have, episode by episode.

    Raises:
        InvalidValueError: Their episodes are no pairs.
    """
    for name in PAIRED:
        if a["settings"].get(name) != b["settings"].get(name):
            raise InvalidValueError(
                "--against", f"one with another {name}", "a result of the same task and world"
            )
    ours, theirs = ({e["seed"]: e["success"] for e in s["entries"]} for s in (a, b))
    seeds = [seed for seed in ours if seed in theirs]
    if not seeds:
        raise InvalidValueError("--against", "one without any of these seeds", "of the same seeds")
    won_a = np.array([ours[seed] for seed in seeds], dtype=np.bool_)
    won_b = np.array([theirs[seed] for seed in seeds], dtype=np.bool_)
    only_a, only_b, p = mcnemar(won_a, won_b)
    return {
        "a": a["policy"],
        "b": b["policy"],
        "episodes": len(seeds),
        "successes_a": int(won_a.sum()),
        "successes_b": int(won_b.sum()),
        "only_a": only_a,
        "only_b": only_b,
        "p": p,
        "difference": float(won_a.mean() - won_b.mean()),
        "interval": list(paired_difference(only_a, only_b, len(seeds))),
    }


def _policy(named: Mapping[str, Any]) -> str:
    """The name, with the IK that the plain classical stack was given, where it is not the usual."""
    name, ik = named["name"], named.get("ik", "qp")
    return f"{name}:{ik}" if name == "classical" and ik != "qp" else str(name)


def _figures(results: Sequence[EpisodeResult]) -> dict[str, dict[str, float]]:
    """Median, 95th percentile and largest of each figure, over the successes."""
    columns: dict[str, list[float]] = {}
    for result in results:
        if result.success:
            for name, value in (*result.measures.items(), *result.metrics.items()):
                if isinstance(value, int | float):
                    columns.setdefault(name, []).append(float(value))
    return {
        name: {
            "n": len(values),
            "median": float(np.median(values)),
            "p95": float(np.percentile(values, 95.0)),
            "max": max(values),
        }
        for name, values in columns.items()
    }
