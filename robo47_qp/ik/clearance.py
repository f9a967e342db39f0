"""How far an arm is from itself and from its obstacles."""

from functools import lru_cache
from math import inf
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from robo47_qp.arm import Arm
from robo47_qp.arrays import Matrix, Vector
from robo47_qp.ik.geom_distance import GeomDistance
from robo47_qp.ik.geom_pairs import GeomPairs

_ENDLESS, _DEEP = 1e6, 1e3
"""Half lengths of the box that stands for a plane, along it and into the solid [m]."""


class Nearby(NamedTuple):
    """Pairs of geoms that are close to one another, the closest first."""

    pair: NDArray[np.intp]
    """Which of the checked pairs (k,)."""
    distance: Vector
    """Signed distances (k,) [m]."""
    segment: Matrix
    """Nearest points on the first and the second geom of each pair (k, 6) [m]."""


class Clearance:
    """Distances of the pairs of geoms of one arm, built once.

    A bound from below decides which pairs are measured: bounding spheres, and for geoms that
    stand still the distance of a bounding sphere from their bounding box. It is not safe to
    share between threads: all methods use one scratch state.
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
        mujoco.mj_kinematics(m, self.data)
        self._ends = np.array(self.pairs.kept, dtype=np.intp)
        still = m.body_weldid[m.geom_bodyid[self._ends]] == 0
        self._moving = np.flatnonzero(~still.any(axis=1))
        self._static = np.flatnonzero(still.any(axis=1))
        self._reach = m.geom_rbound[self._ends].sum(axis=1)[self._moving]
        self._a, self._b = self._ends[self._moving].T.copy()
        fixed, moved = _sorted_ends(self._ends[self._static], still[self._static])
        self._moved, self._radius = moved, m.geom_rbound[moved]
        self._R, self._centre, self._half = _boxes(m, self.data, fixed)
        self._bound = np.empty(len(self._ends))

    def nearest(self, q: Vector) -> tuple[float, tuple[str, str]]:
        """Smallest distance of any pair at q [m], negative where it overlaps, and its names."""
        bound = self._bounds_at(q)
        best, which = inf, 0
        for i in np.argsort(bound, kind="stable").tolist():
            if bound[i] >= best:
                break
            a, b = self.pairs.kept[i]
            distance = self._measure.between(a, b, best)
            if distance < best:
                best, which = distance, i
        return best, self.pairs.names[which]

    def clear(self, q: Vector, margin: float) -> bool:
        """True where all pairs are at least `margin` apart at q [m]."""
        bound = self._bounds_at(q)
        close = np.flatnonzero(bound < margin)
        for i in close[np.argsort(bound[close])].tolist():
            a, b = self.pairs.kept[i]
            if self._measure.between(a, b, margin) < margin:
                return False
        return True

    def nearby(self, q: Vector, within: float) -> Nearby:
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
        return Nearby(np.array(found, dtype=np.intp)[order], distance_of[order], segment_of[order])

    def distance_of(self, index: int, q: Vector) -> float:
        """Signed distance of one of the checked pairs at q [m]."""
        self.data.qpos[:] = q
        mujoco.mj_kinematics(self.arm.model, self.data)
        a, b = self.pairs.kept[index]
        return self._measure.between(a, b, inf)

    def _bounds_at(self, q: Vector) -> Vector:
        """No pair is closer than these distances (pairs,) [m]."""
        self.data.qpos[:] = q
        mujoco.mj_kinematics(self.arm.model, self.data)
        x, bound = self.data.geom_xpos, self._bound
        apart = x[self._a] - x[self._b]
        bound[self._moving] = np.sqrt((apart * apart).sum(axis=1)) - self._reach
        outside = np.matmul((x[self._moved] - self._centre)[:, None, :], self._R)[:, 0]
        outside = np.abs(outside) - self._half
        beyond = np.maximum(outside, 0.0)
        gap = np.sqrt((beyond * beyond).sum(axis=1)) + np.minimum(outside.max(axis=1), 0.0)
        bound[self._static] = gap - self._radius
        return bound


@lru_cache(maxsize=16)
def clearance_of(arm: Arm, asked: float) -> Clearance:
    """The clearance of an arm, built at the first call."""
    return Clearance(arm, asked)


def _sorted_ends(
    ends: NDArray[np.intp], still: NDArray[np.bool_]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Geoms that stand still, and those that move, of pairs of one each."""
    first = still[:, 0]
    return np.where(first, ends[:, 0], ends[:, 1]), np.where(first, ends[:, 1], ends[:, 0])


def _boxes(
    m: mujoco.MjModel, d: mujoco.MjData, geoms: NDArray[np.intp]
) -> tuple[Matrix, Matrix, Matrix]:
    """Rotation (k, 3, 3), centre (k, 3) and half lengths (k, 3) of bounding boxes [m]."""
    R = d.geom_xmat[geoms].reshape(-1, 3, 3)
    middle, half = m.geom_aabb[geoms, :3].copy(), m.geom_aabb[geoms, 3:].copy()
    planes = m.geom_type[geoms] == mujoco.mjtGeom.mjGEOM_PLANE
    middle[planes], half[planes] = [0.0, 0.0, -_DEEP], [_ENDLESS, _ENDLESS, _DEEP]
    centre = d.geom_xpos[geoms] + np.einsum("kij,kj->ki", R, middle)
    return R, centre, half
