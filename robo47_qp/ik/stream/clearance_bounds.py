"""Speed limits that keep pairs of geoms apart, with the room to brake."""

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.collision.clearance import Clearance
from robo47_qp.collision.distance import FAR, GeomDistance
from robo47_qp.collision.motion_bounds import ClosingJacobian, approach_speed_bounds
from robo47_qp.ik.stream.joint_bounds import max_stoppable_speed

AHEAD = 0.1
"""Beyond what is needed, distances are told apart up to this much further [m]."""
TOUCH = 1e-7
"""Points closer than this give no direction [m]."""
NEAR = 0.03
"""Pairs with less room than this are looked at again at every tick [m]."""

LEAST = 1e-9
"""No pair brakes by less than this [m/s²]."""
PARTING, REGAIN = 0.3, 10.0
"""A pair that is too close parts at this part of the speed at which it could still stop, and
regains this part of what it lacks per second."""
UNSURE = 0.2
"""Part of a pair's largest closing rate by which its last row may be wrong until it is renewed."""
TRUSTED = 2.0 * UNSURE
"""Joint travel, summed over the joints, after which a row has to be renewed [rad]."""


class VelocityRows(NamedTuple):
    """A v' <= upper keeps pairs apart, for the joint velocity v' at the next tick."""

    A: Matrix
    """How fast each pair closes per joint (k, n) [m/rad]."""
    upper: Vector
    """How fast each pair may close (k,) [m/s]; negative where it has to part."""
    room: Vector
    """Distance of each pair beyond the one to be kept (k,) [m]."""
    pair: NDArray[np.intp]
    """Which of the checked pairs each row is (k,)."""


class ClearanceBounds:
    """Memory of how far apart the pairs of one arm are, and the speeds that this allows.

    A pair with the room d left, that closes at a rate A v and can brake at β Σ_j |A_j| a_max,j,
    may close at the speed after which it can still stop (`max_stoppable_speed`).

    Measuring all pairs at every tick would take milliseconds. With the bounds L of
    `approach_speed_bounds`, a pair comes no closer than L |q' - q| between two configurations,
    and no joint's braking distance v² / (2 β a_max) brings it closer than L times that. A pair
    further apart needs no row and no measurement. For a pair once measured close by, its row A
    says more: it is taken to be right to within a fifth of L, until the joints have moved 0.4 rad
    together. A point that they carry leaves its tangent by no more than L |δ| |δ|₁ / 2, so a
    distance along a fixed normal does not fall faster than that; what this leaves out is that
    normals jump at edges of boxes. Pairs with little room are measured at every tick, the most
    urgent first, up to a number that bounds the time of a tick; the others keep their last row
    and the bound on their distance.
    """

    def __init__(
        self,
        clearance: Clearance,
        data: mujoco.MjData,
        a_max: Vector,
        dt: float,
        *,
        d_min: float,
        braking_share: float,
        max_pairs: int,
    ) -> None:
        """Look at the pairs of a clearance.

        Args:
            clearance: Which pairs are kept apart.
            data: State of the arm's model, brought up to date by the caller: `mj_kinematics`
                and `mj_comPos` at q before each `reset` and `rows`.
            a_max: Largest joint accelerations (n,) [rad/s²].
            dt: Length of a tick [s].
            d_min: Distance to be kept [m].
            braking_share: β, part of the deceleration of all joints together that is counted on.
            max_pairs: Most pairs to be measured in a tick, and most rows.
        """
        self._clearance = clearance
        m = clearance.arm.model
        self._model, self._data = m, data
        self._measure = GeomDistance(m, data)
        self._ends = clearance.pairs.kept
        self._L = approach_speed_bounds(m, self._ends)
        self._closing = ClosingJacobian(m, data, self._ends)
        self._a, self._dt, self._d_min = braking_share * a_max, dt, d_min
        self._step, self._twice_a = self._a * dt, 2.0 * self._a
        self._max_pairs = max_pairs
        self._A = np.zeros_like(self._L)
        self._signed = np.zeros((2, clearance.arm.n))
        self._per_joint = np.zeros((3, clearance.arm.n))
        self._known, self._sums = np.zeros((2, len(self._ends))), np.zeros((3, len(self._ends)))
        self._segment = np.zeros((len(self._ends), 6))
        self._segments = list(self._segment)
        self.measured: float = np.inf
        """Smallest distance that was measured at the last `rows` or `reset` [m]."""
        self._looked = np.zeros(len(self._ends), dtype=np.bool_)
        self._travel, self._one = 0.0, np.ones(clearance.arm.n)
        self._unseen = np.ones(len(self._ends), dtype=np.bool_)
        self._unsure, self._zero = self._L.T.copy(), np.zeros(len(self._ends))
        self._brake, self._stop = np.ones(len(self._ends)), np.full(len(self._ends), LEAST)
        self._least_brake = UNSURE * (self._L @ self._a)
        self._bound = np.zeros(len(self._ends))
        self._q = np.zeros(clearance.arm.n)
        none = np.zeros(0)
        self._nothing = VelocityRows(self._A[:0], none, none, np.zeros(0, dtype=np.intp))

    def reset(self, q: Vector) -> None:
        """Measure every pair at q."""
        self._q[:], self._travel = q, 0.0
        self._bound[:] = -np.inf
        self._update(np.arange(len(self._ends)), np.full(len(self._ends), FAR))

    def rows(self, q: Vector, v: Vector) -> VelocityRows:
        """Rows for the next tick.

        Args:
            q: Position now (n,) [rad].
            v: Velocity now (n,) [rad/s].
        """
        ways = self._ways(q, v)
        ways += self._d_min
        urgent = (self._bound < ways).nonzero()[0]
        if len(urgent) > self._max_pairs:
            used = (self._bound[urgent] - self._d_min) / (ways[urgent] - self._d_min)
            urgent = urgent[np.argsort(used, kind="stable")]
        self.measured = np.inf
        if not len(urgent):
            return self._nothing
        within = ways.take(urgent)
        self._update(urgent[: self._max_pairs], within[: self._max_pairs] + AHEAD)
        active = urgent.compress(self._bound.take(urgent) < within)
        return self._rows_of(active, v)

    def _ways(self, q: Vector, v: Vector) -> Vector:
        """Let the bounds sink; room below which each pair needs another look (pairs,) [m]."""
        signed, per_joint, dt = self._signed, self._per_joint, self._dt
        np.subtract(q, self._q, out=signed[0])
        self._q[:], signed[1] = q, v
        np.abs(signed, out=per_joint[:2])
        speed, way = per_joint[1], per_joint[2]
        speed += self._step
        np.divide(speed, self._twice_a, out=way)
        way += dt
        way *= speed
        # Where a pair's row is known, these bounds are on its error.
        np.dot(per_joint, self._unsure, out=self._sums)
        np.dot(signed, self._A.T, out=self._known)
        np.maximum(self._known, self._zero, out=self._known)
        self._sums[:2] += self._known
        moved, closing, unknown = self._sums
        self._bound -= moved
        self._travel += float(self._one.dot(per_joint[0]))
        if self._travel > TRUSTED / 2.0:
            self._age()
        ways: Vector = closing / self._brake
        ways *= 0.5
        ways += dt
        ways *= closing
        np.copyto(ways, unknown, where=self._unseen)
        return np.maximum(ways, NEAR, out=ways)

    def _age(self) -> None:
        """Trust no row any more that has not been renewed since the last call."""
        self._unseen |= ~self._looked
        np.copyto(self._unsure, self._L.T, where=self._unseen)
        self._looked[:], self._travel = False, 0.0

    def _rows_of(self, pair: NDArray[np.intp], v: Vector) -> VelocityRows:
        A, room = self._A.take(pair, axis=0), self._bound.take(pair) - self._d_min
        closing, brake = A.dot(v), self._stop.take(pair)
        if np.count_nonzero(room < 0.0):
            lacking = room < 0.0
            upper = max_stoppable_speed(
                np.abs(room), np.where(lacking, 0.0, closing), brake, self._dt
            )
            upper[lacking] = -np.minimum(PARTING * upper[lacking], -REGAIN * room[lacking])
        else:
            upper = max_stoppable_speed(room, closing, brake, self._dt)
        if len(pair) > self._max_pairs:
            kept = np.argsort(upper - closing, kind="stable")[: self._max_pairs]
            return VelocityRows(A[kept], upper[kept], room[kept], pair[kept])
        return VelocityRows(A, upper, room, pair)

    def _update(self, picked: NDArray[np.intp], cut_off: Vector) -> None:
        between, ends = self._measure.between, self._ends
        m, d, geom_distance = self._model, self._data, mujoco.mj_geomDistance
        bounds, found = self._bound.take(picked).tolist(), []
        pairs = zip(picked.tolist(), cut_off.tolist(), bounds, self._segments, strict=False)
        for i, far, bound, ends_of_way in pairs:
            a, b = ends[i]
            if bound <= 0.0:
                found.append(between(a, b, far))
                ends_of_way[:] = self._measure.segment
            else:
                # What cannot overlap needs none of the second looks that `between` takes.
                found.append(geom_distance(m, d, a, b, far, ends_of_way))
        self.measured = min(found)
        distance = np.array(found)
        self._bound[picked] = np.minimum(distance, cut_off)
        self._looked[picked] = True
        segment = self._segment[: len(picked)]
        seen = distance < cut_off
        if np.count_nonzero(self._unseen.take(picked) == seen):
            self._unseen[picked] = ~seen
            self._unsure[:, picked] = np.where(seen, UNSURE, 1.0) * self._L[picked].T
        if self.measured < TOUCH or np.count_nonzero(seen) < len(picked):
            self._A[picked[~seen]], self._stop[picked[~seen]] = 0.0, LEAST
            # Nearest points that touch show no direction: such a pair keeps its last row.
            seen &= np.abs(distance) > TOUCH
            picked, distance, segment = picked[seen], distance[seen], segment[seen]
        A = self._closing.rows(picked, distance, segment)
        self._A[picked] = A
        stop = np.abs(A).dot(self._a)
        self._stop[picked] = np.maximum(stop, LEAST)
        self._brake[picked] = np.maximum(stop, self._least_brake.take(picked))
