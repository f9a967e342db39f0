"""Branch: one way through a PTP waypoint and the straight lines that follow it."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from robo47_qp.errors import PlanError
from robo47_qp.ik.solver import IkResult
from robo47_qp.waypoint import Motion, Waypoint

_TOLD = 3
"""Branches whose failure is told when all fail."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Branch:
    """One way through a PTP waypoint and the straight lines that follow it."""

    results: tuple[IkResult, ...]
    """How each waypoint is reached, in their order."""
    room: float
    """Least distance to a joint limit at the waypoints, as a share of half the joint's range."""


def groups(waypoints: Sequence[Waypoint]) -> list[Sequence[Waypoint]]:
    """Each PTP waypoint with the LIN and CIRC waypoints after it."""
    cuts = [i for i, waypoint in enumerate(waypoints) if i and waypoint.motion is Motion.PTP]
    return [waypoints[a:b] for a, b in pairwise([0, *cuts, len(waypoints)])] if waypoints else []


def traced(layers: list[list[Branch]], back: list[list[int]], last: int) -> list[IkResult]:
    """The results of one branch of each layer, from which before was best, back from the last."""
    results: list[IkResult] = []
    for layer, before in zip(reversed(layers), reversed(back), strict=True):
        results[:0] = layer[last].results
        last = before[last]
    return results


def ruled_out(group: Sequence[Waypoint], failed: Sequence[PlanError]) -> PlanError:
    """The waypoint that none got past: the furthest that any branch failed at."""
    order = [waypoint.name for waypoint in group]
    furthest = max(failed, key=lambda error: order.index(error.waypoint))
    if len(failed) == 1:
        return furthest
    reasons = list(dict.fromkeys(f"{error.waypoint}: {error.reason}" for error in failed))
    more = f"; and {len(reasons) - _TOLD} more" if len(reasons) > _TOLD else ""
    return PlanError(
        furthest.waypoint,
        f"none of {len(failed)} configurations of {order[0]!r} leads there: "
        + "; ".join(reasons[:_TOLD])
        + more,
        furthest.rejection,
    )
