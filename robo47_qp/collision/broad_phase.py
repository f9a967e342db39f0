"""Fast lower bounds on the distances of many pairs of geoms."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from robo47_qp.arrays import Matrix, Vector

_ENDLESS, _DEEP = 1e6, 1e3
"""Half lengths of the box that stands for a plane, along it and into the solid [m]."""


class BroadPhase:
    """Computes lower bounds for a list of pairs, at the last `mj_kinematics` of a state.

    For two moving geoms: the distance of their bounding spheres. For a moving and a static one:
    the signed distance of the moving one's bounding sphere from the static one's bounding box,
    which is tight for tables and walls. Both also bound the (negative) distance of an overlap.
    """

    def __init__(self, m: mujoco.MjModel, pairs: tuple[tuple[int, int], ...]) -> None:
        """Sort the pairs by kind; no pair may have two static geoms."""
        ends = np.array(pairs, dtype=np.intp)
        still = m.body_weldid[m.geom_bodyid[ends]] == 0
        moving, static = np.flatnonzero(~still.any(axis=1)), np.flatnonzero(still.any(axis=1))
        self._a, self._b = (np.ascontiguousarray(column) for column in ends[moving].T)
        self._reach = m.geom_rbound[ends[moving]].sum(axis=1)
        first = still[static, 0]
        fixed = np.where(first, ends[static, 0], ends[static, 1])
        moved = np.where(first, ends[static, 1], ends[static, 0])
        boxes, row = np.unique(fixed, return_inverse=True)
        self._spheres, column = np.unique(moved, return_inverse=True)
        self._cell = row * len(self._spheres) + column
        self._radius = m.geom_rbound[self._spheres]
        self._R, self._offset, self._half = _boxes(m, boxes)
        self._order = np.argsort(np.concatenate([moving, static]))
        self._difference, self._other = np.empty((2, 3, len(moving)))
        self._sorted = np.empty(len(ends))

    def bounds(self, d: mujoco.MjData) -> Vector:
        """Return a lower bound on the distance of each pair (pairs,) [m]."""
        x = np.ascontiguousarray(d.geom_xpos.T)
        between, n_moving = self._difference, len(self._a)
        np.take(x, self._a, axis=1, out=between, mode="clip")
        np.take(x, self._b, axis=1, out=self._other, mode="clip")
        between -= self._other
        between *= between
        squares = between[0] + between[1] + between[2]
        np.subtract(np.sqrt(squares, out=squares), self._reach, out=self._sorted[:n_moving])
        outside = self._R @ x[:, self._spheres]
        outside -= self._offset
        np.abs(outside, out=outside)
        outside -= self._half
        deepest = np.maximum(np.maximum(outside[:, 0], outside[:, 1]), outside[:, 2])
        np.maximum(outside, 0.0, out=outside)
        outside *= outside
        gap = np.sqrt(outside[:, 0] + outside[:, 1] + outside[:, 2])
        gap += np.minimum(deepest, 0.0)
        gap -= self._radius
        np.take(gap, self._cell, out=self._sorted[n_moving:], mode="clip")
        return self._sorted[self._order]


def _boxes(m: mujoco.MjModel, geoms: NDArray[np.intp]) -> tuple[Matrix, Matrix, Matrix]:
    """Return bounding boxes: R_box_world (k, 3, 3); centres and half lengths (k, 3, 1) [m]."""
    d = mujoco.MjData(m)
    mujoco.mj_kinematics(m, d)
    R = d.geom_xmat[geoms].reshape(-1, 3, 3).transpose(0, 2, 1).copy()
    middle, half = m.geom_aabb[geoms, :3].copy(), m.geom_aabb[geoms, 3:].copy()
    planes = m.geom_type[geoms] == mujoco.mjtGeom.mjGEOM_PLANE
    middle[planes], half[planes] = [0.0, 0.0, -_DEEP], [_ENDLESS, _ENDLESS, _DEEP]
    offset = R @ d.geom_xpos[geoms][:, :, None] + middle[:, :, None]
    return R, offset, half[:, :, None]
