"""How far an arm is from itself and from its obstacles."""

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
    """Pairs of geoms that are close to one another, the closest first."""

    pair: NDArray[np.intp]
    """Which of the checked pairs (k,)."""
    distance: Vector
    """Signed distances (k,) [m]."""
    segment: Matrix
    """Nearest points on the first and the second geom of each pair (k, 6) [m]."""


class Clearance:
    """Distances of the pairs of geoms of one arm, built once.

    Bounds from below decide which pairs are measured; what is returned is exact as far as
    `GeomDistance` is. It is not safe to share between threads: all methods use one scratch
    state.
    """

    def __init__(self, arm: Arm, asked: float) -> None:
        """Choose the pairs of the arm.

        Args:
            arm: The arm with its obstacles.
            asked: Clearance that is wanted [m]; see `GeomPairs` for what it decides.
        """
        self.arm, self.asked = arm, asked
        self.pairs = GeomPairs.of(arm, asked)
        m = arm.model
        self.data = mujoco.MjData(m)
        self._measure = GeomDistance(m, self.data)
        self._broad = BroadPhase(m, self.pairs.kept)
        weld = m.body_weldid[m.geom_bodyid[np.array(self.pairs.kept)]]
        tool = m.body_weldid[m.site(arm.robot.tcp).bodyid]
        self._tool_and_still = (weld == tool).any(axis=1) & (weld == 0).any(axis=1)

    def nearest(self, q: Vector) -> tuple[float, tuple[str, str]]:
        """Smallest distance of any pair at q [m], negative where it overlaps, and its names."""
        distance, which = self._least(self._bounds_at(q))
        return distance, self.pairs.names[which]

    def nearest_of_tool(self, q: Vector) -> tuple[float, tuple[str, str]]:
        """The same of what is fixed to the tool, from what stands still.

        The pose of the tool settles it, whatever the joints; infinite where there is no pair.
        """
        bound = self._bounds_at(q)
        bound[~self._tool_and_still] = inf
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
        """True where all pairs are at least `margin` apart at q [m]."""
        bound = self._bounds_at(q)
        close = np.flatnonzero(bound < margin)
        for i in close[np.argsort(bound[close])].tolist():
            a, b = self.pairs.kept[i]
            if self._measure.between(a, b, margin) < margin:
                return False
        return True

    def pairs_within(self, q: Vector, within: float) -> ClosePairs:
        """Pairs closer than `within` at q [m]."""
        bound = self._bounds_at(q)
        found, distances, segments = [], [], []
        measure, kept = self._measure, self.pairs.kept
        for i in np.flatnonzero(bound < within).tolist():
            a, b = kept[i]
            distance = measure.between(a, b, within)
            if distance < within:
                found.append(i)
                distances.append(distance)
                segments.append(measure.segment.copy())
        distance_of = np.array(distances)
        order = np.argsort(distance_of, kind="stable")
        segment_of = np.array(segments).reshape(-1, 6)
        pair_of = np.array(found, dtype=np.intp)
        return ClosePairs(pair_of[order], distance_of[order], segment_of[order])

    def distance_of(self, pair: int, q: Vector) -> float:
        """Signed distance of one of the checked pairs at q [m]."""
        self.data.qpos[:] = q
        mujoco.mj_kinematics(self.arm.model, self.data)
        a, b = self.pairs.kept[pair]
        return self._measure.between(a, b, inf)

    def _bounds_at(self, q: Vector) -> Vector:
        self.data.qpos[:] = q
        mujoco.mj_kinematics(self.arm.model, self.data)
        return self._broad.bounds(self.data)


class ClosestPair(NamedTuple):
    """The closest pair of a configuration."""

    distance: float
    """Signed distance [m]."""
    pair: tuple[str, str]
    """Bodies of the robot, names of obstacles."""
    inevitable: bool
    """True where the pose of the tool settles that this is too close, whatever the joints."""


def closest_pair(arm: Arm, q: Vector, asked: float, leeway: float) -> ClosestPair:
    """The closest pair at q; one of the tool with what stands still, where that is too close.

    Args:
        arm: The arm with its obstacles.
        q: Configuration (n,) [rad].
        asked: Clearance that is asked for [m].
        leeway: How far any point of the tool may be from where the target puts it [m].
    """
    clearance = arm.derived(Clearance, asked)
    distance, pair = clearance.nearest(q)
    if distance < asked:
        of_tool, tool_pair = clearance.nearest_of_tool(q)
        if of_tool < asked - leeway:
            return ClosestPair(of_tool, tool_pair, True)
    return ClosestPair(distance, pair, False)


def too_close_text(found: ClosestPair, asked: float) -> str:
    """A clearance that is not kept, in words."""
    a, b = found.pair
    apart = f"are {1e3 * found.distance:.1f} mm apart"
    overlap = f"overlap by {-1e3 * found.distance:.1f} mm"
    always = ", whatever the joints" if found.inevitable else ""
    return (
        f"{a} and {b} {overlap if found.distance < 0.0 else apart}{always}; "
        f"{1e3 * asked:.3g} mm are asked"
    )
