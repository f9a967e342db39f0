"""NotJudged: what the audits of an evaluation tell without judging it."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, isnan
from typing import Any

import numpy as np

from robo47_qp.evaluation.episode import EpisodeResult


@dataclass(frozen=True, kw_only=True)
class NotJudged:
    """What the audit tells of one quantity without judging it, over all episodes."""

    signal: str
    unit: str
    episodes: int
    """Number of episodes in which it is not judged for some time."""
    median_share: float
    """Median of the share of the time, over these [-]."""
    max_share: float
    extreme: float
    """Of what is furthest beyond its limit, or closest to it: the value, and the limit."""
    limit: float
    seed: int
    """Seed of that episode."""
    why: str

    @classmethod
    def of(cls, results: Sequence[EpisodeResult]) -> "list[NotJudged]":
        """Return what was not judged in episodes, that of the largest share of the time first."""
        found: dict[str, list[tuple[int, Mapping[str, Any]]]] = {}
        for result in results:
            for one in result.exempt:
                # Without the joint, leg or pair of bodies that it was.
                signal = re.sub(r" \([^()]*\)|, exempt$", "", one["signal"])
                found.setdefault(signal, []).append((result.seed, one))
        told = [_over_episodes(signal, findings) for signal, findings in found.items()]
        return sorted(told, key=lambda one: (-one.max_share, one.signal))


def _over_episodes(signal: str, findings: Sequence[tuple[int, Mapping[str, Any]]]) -> NotJudged:
    shares: dict[int, float] = {}
    for seed, one in findings:
        shares[seed] = max(shares.get(seed, 0.0), float(one["share"]))
    seed, worst = max(findings, key=lambda it: _beyond(it[1]))
    return NotJudged(
        signal=signal,
        unit=worst["unit"],
        episodes=len(shares),
        median_share=float(np.median(list(shares.values()))),
        max_share=max(shares.values()),
        extreme=float(worst["extreme"]),
        limit=float(worst["limit"]),
        seed=seed,
        why="; ".join(dict.fromkeys(one["exempt"] for _, one in findings)),
    )


def _beyond(finding: Mapping[str, Any]) -> float:
    """Return by how much an extreme is beyond its limit; what is no number is furthest."""
    by = float(finding["extreme"]) - float(finding["limit"])
    return inf if isnan(by) else -by if finding["least"] else by
