"""PairedComparison: two policies on the same seeds, and the episodes that differ."""

from dataclasses import asdict, dataclass
from typing import Any, Literal


@dataclass(frozen=True, kw_only=True)
class CycleTimes:
    """Difference of cycle times over the episodes that both policies solved."""

    episodes: int
    median_difference: float | None
    """Median of a less b [s]; None without such an episode."""


@dataclass(frozen=True, kw_only=True)
class UnequalEpisode:
    """An episode that only one of two policies solved, and what stopped the other."""

    seed: int
    solved_by: Literal["a", "b"]
    cause: str | None
    """Value of `Cause`, or "error"."""
    evidence: str
    step: str | None
    time: float | None
    """Simulated time of the failure [s]."""


@dataclass(frozen=True, kw_only=True)
class PairedComparison:
    """Policy a against policy b, episode by episode."""

    a: str
    b: str
    episodes: int
    """Seeds that both have, without those of internal errors."""
    successes_a: int
    successes_b: int
    only_a: int
    only_b: int
    p: float
    """Of McNemar's exact test, two-sided."""
    difference: float
    """Success rate of a less that of b."""
    interval: tuple[float, float]
    """Of the difference, 95 %."""
    identical: int
    """Episodes whose recorded signals are the same bit by bit."""
    cycle_time_s: CycleTimes
    differing: tuple[UnequalEpisode, ...]
    settings: tuple[str, ...] = ()
    """Those in which the evaluations differ beside the policy: code, versions, robot_sha256."""
    p_holm: float | None = None
    """p corrected for several comparisons; None for a single one."""

    def as_json(self) -> dict[str, Any]:
        """Return the comparison as JSON."""
        return {k: v for k, v in asdict(self).items() if (k, v) != ("p_holm", None)}
