"""Distances of an arm from itself and from its obstacles."""

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.collision.broad_phase import BroadPhase
from robo47_qp.collision.distance import GeomDistance
from robo47_qp.collision.pairs import GeomPairs
from robo47_qp.model.arm import Arm


class ClosePairs(NamedTuple):
    """Pairs of geoms that are close to each other, the closest first."""

    pair: NDArray[np.intp]
    """Indices into `GeomPairs.kept` (k,)."""
    distance: Vector
    """Signed distances (k,) [m]."""
    segment: Matrix
    """Nearest points on the first and the second geom of each pair (k, 6) [m]."""


class Clearance:
    """Computes the distances of the pairs of geoms of one arm.

    Lower bounds decide which pairs are measured; results are as exact as `GeomDistance`. Not
    safe to share between threads: all methods use one scratch state.
    """

    def __init__(self, arm: Arm, required: float) -> None:
        """Choose the pairs of the arm for a required clearance [m]; see `GeomPairs`."""
        self.arm, self.required = arm, required
        self.pairs = GeomPairs.of(arm, required)
        m = arm.model
        self.data = mujoco.MjData(m)
        self._measure = GeomDistance(m, self.data)
        self._broad = BroadPhase(m, self.pairs.kept)
        weld = m.body_weldid[m.geom_bodyid[np.array(self.pairs.kept)]]
        still = (weld == 0).any(axis=1)
        tools = m.body_weldid[m.site_bodyid[list(arm.tool_sites)]]
        self._tool_and_still = [(weld == tool).any(axis=1) & still for tool in tools]

    def nearest(self, q: Vector) -> tuple[float, tuple[str, str]]:
        """Return the smallest signed distance of any pair at q [m], and the names of the pair."""
        distance, which = self._least(self._bounds_at(q))
        return distance, self.pairs.names[which]

    def nearest_of_tools(self, q: Vector, tools: Sequence[int]) -> tuple[float, tuple[str, str]]:
        """Return the same for bodies fixed to some tools, at least one, against static ones.

        It depends on the poses of these tools only; infinite where there is no such pair.
        """
        bound = self._bounds_at(q)
        bound[~np.any([self._tool_and_still[tool] for tool in tools], axis=0)] = inf
        distance, which = self._least(bound)
        return distance, self.pairs.names[which]

    def _least(self, bound: Vector) -> tuple[float, int]:
        best, which = inf, 0
        for i in np.argsort(bound, kind="stable").tolist():
            if bound[i] >= best:
                break
            a, b = self.pairs.kept[i]
            distance = self._measure.between(a, b, best)
            if distance < best:
                best, which = distance, i
        return best, which

    def clear(self, q: Vector, margin: float) -> bool:
        """Return whether all pairs are at least `margin` apart at q [m]."""
        bound = self._bounds_at(q)
        close = np.flatnonzero(bound < margin)
        for i in close[np.argsort(bound[close])].tolist():
            a, b = self.pairs.kept[i]
            if self._measure.between(a, b, margin) < margin:
                return False
        return True

    def pairs_within(self, q: Vector, within: float) -> ClosePairs:
        """Return the pairs closer than `within` at q [m]."""
        found, distances, segments = [], [], []
        measure, kept = self._measure, self.pairs.kept
        for i in np.flatnonzero(self._bounds_at(q) < within).tolist():
            distance = measure.between(*kept[i], within)
            if distance < within:
                found.append(i)
                distances.append(distance)
                segments.append(measure.segment.copy())
        distance_of = np.array(distances)
        order = np.argsort(distance_of, kind="stable")
        pair_of, segment_of = np.array(found, dtype=np.intp), np.array(segments).reshape(-1, 6)
        return ClosePairs(pair_of[order], distance_of[order], segment_of[order])

    def distance_of(self, pair: int, q: Vector) -> float:
        """Return the signed distance of `pairs.kept[pair]` at q [m]."""
        self.data.qpos[:] = q
        mujoco.mj_kinematics(self.arm.model, self.data)
        return self._measure.between(*self.pairs.kept[pair], inf)

    def _bounds_at(self, q: Vector) -> Vector:
        self.data.qpos[:] = q
        mujoco.mj_kinematics(self.arm.model, self.data)
        return self._broad.bounds(self.data)


class ClosestPair(NamedTuple):
    """The closest pair of a configuration."""

    distance: float
    """Signed distance [m]."""
    pair: tuple[str, str]
    """Names of the two: bodies of the robot, obstacles."""
    inevitable: bool
    """True where the poses of the placed tools alone make this too close, whatever the joints."""


def closest_pair(
    arm: Arm, q: Vector, required: float, leeway: float, placed: Sequence[int]
) -> ClosestPair:
    """Return the closest pair at q; a placed tool and a static body come first where too close.

    Args:
        arm: The arm with its obstacles.
        q: Configuration (n,) [rad].
        required: Required clearance [m].
        leeway: How far any point of the tool may be from where the target puts it [m].
        placed: Tools of which the target asks for the whole pose.
    """
    clearance = arm.derived(Clearance, required)
    distance, pair = clearance.nearest(q)
    if distance < required and placed:
        of_tool, tool_pair = clearance.nearest_of_tools(q, placed)
        if of_tool < required - leeway:
            return ClosestPair(of_tool, tool_pair, True)
    return ClosestPair(distance, pair, False)


def too_close_text(found: ClosestPair, required: float) -> str:
    """Return a message about a pair that is closer than the required clearance [m]."""
    a, b = found.pair
    mm = 1e3 * found.distance
    distance = f"overlap by {-mm:.1f} mm" if mm < 0.0 else f"are {mm:.1f} mm apart"
    always = ", whatever the joints" if found.inevitable else ""
    return f"{a} and {b} {distance}{always}; {1e3 * required:.3g} mm are required"
