"""Rows of a QP that keep pairs of geoms apart."""

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from robo47_qp.arrays import Matrix, Range, Vector
from robo47_qp.collision.clearance import Clearance
from robo47_qp.collision.motion_bounds import moved_by
from robo47_qp.errors import InvalidValueError

_TOUCH = 1e-7
"""Distance below which the nearest points define no direction [m]."""
_H = 1e-6
"""Step of the central differences used there [rad or m]."""


class DistanceRows(NamedTuple):
    """Rows of A dq <= upper, which keep pairs apart in a step dq of the joints [rad or m]."""

    A: Matrix
    """Decrease of the distance of each pair per joint (k, n) [m/rad]."""
    upper: Vector
    """Largest decrease allowed (k,) [m]; negative where the distance has to grow."""
    distance: Vector
    """Signed distance of each pair (k,) [m], the smallest first."""
    pair: NDArray[np.intp]
    """Indices of the pairs in `GeomPairs.kept` (k,)."""


class Avoidance:
    """Linearises the distances of the pairs of geoms that are close at a configuration.

    With d the signed distance of a pair, n the unit vector from its first to its second geom
    and J_a, J_b the Jacobians of the nearest points on them, dd = n . (J_b - J_a) dq, and

        -n . (J_b - J_a) dq <= d - d_min              where d >= d_min,
        -n . (J_b - J_a) dq <= recovery (d - d_min)   where d < d_min:

    so no step takes a pair below d_min, and one that is too close regains a share of what it
    lacks (Faverjon and Tournassoud, "A local based approach for path planning of manipulators
    with a high number of degrees of freedom", 1987). With dq = v dt the rows bound a velocity.
    """

    def __init__(
        self,
        clearance: Clearance,
        *,
        d_min: float,
        detection: float,
        recovery: float = 0.5,
        max_rows: int = 32,
    ) -> None:
        """Keep the pairs of a clearance apart.

        Args:
            clearance: The pairs and their distances.
            d_min: Distance to keep [m].
            detection: Pairs closer than this get a row [m]; above d_min by more than a pair
                can close in the longest step.
            recovery: Share of the lacking distance to regain in a step, in [0, 1].
            max_rows: Largest number of rows; the nearest pairs get them.

        Raises:
            InvalidValueError: A number is out of its range.
        """
        if not 0.0 <= d_min < detection < np.inf:
            raise InvalidValueError(
                "d_min and detection", (d_min, detection), "0 <= d_min < detection, finite [m]"
            )
        Range(at_least=0.0, at_most=1.0).check("recovery", recovery)
        Range(at_least=1, whole=True).check("max_rows", max_rows)
        self._clearance, self._d_min, self._detection = clearance, d_min, detection
        self._recovery, self._max_rows = recovery, max_rows
        m = clearance.arm.model
        moves = moved_by(m)
        ends = m.geom_bodyid[np.array(clearance.pairs.kept)]
        self._sign = moves[ends[:, 1]] - moves[ends[:, 0]]
        self._slides = m.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE

    def rows(self, q: Vector) -> DistanceRows:
        """Return rows for the pairs within the detection distance at q, at most `max_rows`."""
        near = self._clearance.pairs_within(q, self._detection)
        pair, d = near.pair[: self._max_rows], near.distance[: self._max_rows]
        lacking = d - self._d_min
        upper = np.where(lacking < 0.0, self._recovery * lacking, lacking)
        A = self._closing(q, pair, d, near.segment[: self._max_rows])
        return DistanceRows(A, upper, d, pair)

    def kept(self, q: Vector) -> bool:
        """Return whether every pair has the clearance required."""
        return self._clearance.clear(q, self._clearance.required)

    def _closing(self, q: Vector, pair: NDArray[np.intp], d: Vector, segment: Matrix) -> Matrix:
        """Return -n . (J_b - J_a) of each pair (k, n).

        A joint that moves one geom only, about an axis u through o, moves its nearest point p
        along n by n . (u x (p - o)) = u . (p x n) - n . (u x o). Both nearest points lie on one
        line along n, so either will do.
        """
        data = self._clearance.data
        p, across = segment[:, :3], segment[:, 3:] - segment[:, :3]
        vague = np.abs(d) < _TOUCH
        n = across / np.where(vague, 1.0, d)[:, None]
        u, o = data.xaxis, data.xanchor
        along = np.where(self._slides, n @ u.T, _cross(p, n) @ u.T - n @ _cross(u, o).T)
        A: Matrix = -self._sign[pair] * along
        for k in np.flatnonzero(vague).tolist():
            A[k] = self._by_differences(q, int(pair[k]))
        return A

    def _by_differences(self, q: Vector, pair: int) -> Vector:
        """Return the same row for a pair whose geoms touch, where no segment gives a direction."""
        of, steps = self._clearance.distance_of, _H * np.eye(len(q))
        change = [of(pair, q + step) - of(pair, q - step) for step in steps]
        closing: Vector = np.array(change) / (-2 * _H)
        return closing


def _cross(a: Matrix, b: Matrix) -> Matrix:
    """Return cross products of rows (k, 3); `np.cross` takes several times as long."""
    out = np.empty_like(a)
    out[:, 0] = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    out[:, 1] = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    out[:, 2] = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return out
