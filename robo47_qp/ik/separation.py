"""Speed limits that keep pairs of geoms apart, with the room to brake."""

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.ik.braking import fastest
from robo47_qp.ik.clearance import Clearance
from robo47_qp.ik.geom_distance import GeomDistance
from robo47_qp.ik.levers import levers, moved_by

_AHEAD = 0.1
"""Beyond what is needed, distances are told apart up to this much further [m]."""
_TOUCH = 1e-7
"""Points closer than this give no direction [m]."""
_FAR = 1e3
"""Larger than any distance in a cell [m]."""
_NEAR = 0.03
"""Pairs with less room than this are looked at again at every tick [m]."""

_LEAST = 1e-9
"""No pair brakes by less than this [m/s²]."""
_PARTING, _REGAIN = 0.3, 10.0
"""A pair that is too close parts at this part of the speed at which it could still stop, and
regains this part of what it lacks per second."""
_UNSURE = 0.2
"""Part of a pair's largest closing rate by which its last row may be wrong until it is renewed."""


class SpeedRows(NamedTuple):
    """A v' <= upper keeps pairs apart, for the joint velocity v' at the next tick."""

    A: Matrix
    """How fast each pair closes per joint (k, n) [m/rad]."""
    upper: Vector
    """How fast each pair may close (k,) [m/s]; negative where it has to part."""
    room: Vector
    """Distance of each pair beyond the one to be kept (k,) [m]."""
    pair: NDArray[np.intp]
    """Which of the checked pairs each row is (k,)."""


class Separation:
    """Memory of how far apart the pairs of one arm are, and the speeds that this allows.

    A pair with the room d left, that closes at a rate A v and can brake at
    β Σ_j |A_j| a_max,j, may close at the speed after which it still can stop (`fastest`).

    Measuring all pairs at every tick would take milliseconds. By `levers` L, a pair comes
    no closer than L |q' - q| between two configurations, and no joint's braking way
    v² / (2 β a_max) brings it closer than L times that. A pair beyond that needs no row and no
    look. For a pair once seen close by, its row A says more: it is taken to be right to
    within a fifth of L until the pair is looked at again. Pairs with little room are looked at in
    every tick, the most urgent first, up to a number that bounds the time of a tick; those
    left over keep their last row and what is known of their distance.
    """

    def __init__(
        self,
        clearance: Clearance,
        data: mujoco.MjData,
        a_max: Vector,
        dt: float,
        *,
        d_min: float,
        share: float,
        budget: int,
    ) -> None:
        """Look at the pairs of a clearance.

        Args:
            clearance: Which pairs are kept apart.
            data: State of the arm's model, brought up to date by the caller: `mj_kinematics`
                and `mj_comPos` at q before each `reset` and `rows`.
            a_max: Largest joint accelerations (n,) [rad/s²].
            dt: Length of a tick [s].
            d_min: Distance to be kept [m].
            share: β, part of the deceleration of all joints together that is counted on.
            budget: Most pairs to be measured in a tick, and most rows.

        Raises:
            InvalidValueError: A number is out of its range.
        """
        if not 0.0 < share <= 1.0:
            raise InvalidValueError("share", share, "above 0 and at most 1")
        if budget < 1:
            raise InvalidValueError("budget", budget, "at least 1")
        self._clearance = clearance
        m = clearance.arm.model
        self._model, self._data = m, data
        self._measure = GeomDistance(m, data)
        self._ends = clearance.pairs.kept
        self._L = levers(m, self._ends)
        bodies = m.geom_bodyid[np.array(self._ends)]
        moves = moved_by(m)
        self._sign = moves[bodies[:, 0]] - moves[bodies[:, 1]]
        self._centre: Vector = data.subtree_com[m.body_rootid[m.jnt_bodyid[0]]]
        self._twists: Matrix = data.cdof
        self._p = np.ones((len(self._ends), 4))
        self._products = np.zeros((len(self._ends), 3, 4))
        self._a, self._dt, self._d_min = share * a_max, dt, d_min
        self._budget = budget
        self._A = np.zeros_like(self._L)
        self._two_joint = np.zeros((2, clearance.arm.n))
        self._per_joint = np.zeros((3, clearance.arm.n))
        self._segment = np.zeros((len(self._ends), 6))
        self._segments = list(self._segment)
        self.measured: float = np.inf
        """Smallest distance that was measured at the last `rows` or `reset` [m]."""
        self._seen = np.zeros(len(self._ends), dtype=np.bool_)
        self._brake, self._stop = np.ones(len(self._ends)), np.full(len(self._ends), _LEAST)
        self._least_brake = _UNSURE * (self._L @ self._a)
        self._bound = np.zeros(len(self._ends))
        self._q = np.zeros(clearance.arm.n)
        none = np.zeros(0)
        self._nothing = SpeedRows(self._A[:0], none, none, np.zeros(0, dtype=np.intp))

    def reset(self, q: Vector) -> None:
        """Measure every pair at q."""
        self._q = q.copy()
        self._bound[:] = -np.inf
        self._update(np.arange(len(self._ends)), np.full(len(self._ends), _FAR))

    def rows(self, q: Vector, v: Vector) -> SpeedRows:
        """Rows for the next tick.

        Args:
            q: Position now (n,) [rad].
            v: Velocity now (n,) [rad/s].
        """
        ways = self._ways(q, v)
        ways += self._d_min
        urgent = (self._bound < ways).nonzero()[0]
        if len(urgent) > self._budget:
            used = (self._bound[urgent] - self._d_min) / (ways[urgent] - self._d_min)
            urgent = urgent[np.argsort(used, kind="stable")]
        self.measured = np.inf
        if not len(urgent):
            return self._nothing
        within = ways.take(urgent)
        self._update(urgent[: self._budget], within[: self._budget] + _AHEAD)
        active = urgent.compress(self._bound.take(urgent) < within)
        return self._rows_of(active, v)

    def _ways(self, q: Vector, v: Vector) -> Vector:
        """Let the bounds sink; room below which each pair needs another look (pairs,) [m]."""
        per_joint, step = self._per_joint, q - self._q
        np.abs(step, out=per_joint[0])
        self._q = q.copy()
        speed = np.abs(v)
        speed += self._a * self._dt
        per_joint[1] = speed * (self._dt + speed / (2.0 * self._a))
        per_joint[2] = _UNSURE * speed
        moved, unknown, closing = per_joint @ self._L.T
        self._two_joint[0], self._two_joint[1] = step, v
        moved_as_known, closing_as_known = np.maximum(self._two_joint @ self._A.T, 0.0)
        moved_as_known += _UNSURE * moved
        self._bound -= np.where(self._seen, moved_as_known, moved)
        closing += closing_as_known
        known = closing / self._brake
        known += 2.0 * self._dt
        known *= closing
        known *= 0.5
        ways: Vector = np.where(self._seen, known, unknown)
        return np.maximum(ways, _NEAR, out=ways)

    def _rows_of(self, pair: NDArray[np.intp], v: Vector) -> SpeedRows:
        A, room = self._A.take(pair, axis=0), self._bound.take(pair) - self._d_min
        closing, brake = A.dot(v), self._stop.take(pair)
        if np.count_nonzero(room < 0.0):
            lacking = room < 0.0
            upper = fastest(np.abs(room), np.where(lacking, 0.0, closing), brake, self._dt)
            upper[lacking] = -np.minimum(_PARTING * upper[lacking], -_REGAIN * room[lacking])
        else:
            upper = fastest(room, closing, brake, self._dt)
        if len(pair) > self._budget:
            kept = np.argsort(upper - closing, kind="stable")[: self._budget]
            return SpeedRows(A[kept], upper[kept], room[kept], pair[kept])
        return SpeedRows(A, upper, room, pair)

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
        segment = self._segment[: len(picked)]
        seen = distance < cut_off
        self._seen[picked] = seen
        if self.measured < _TOUCH or np.count_nonzero(seen) < len(picked):
            self._A[picked[~seen]], self._stop[picked[~seen]] = 0.0, _LEAST
            # Nearest points that touch show no direction: such a pair keeps its last row.
            seen &= np.abs(distance) > _TOUCH
            picked, distance, segment = picked[seen], distance[seen], segment[seen]
        A = self._closing(picked, distance, segment)
        self._A[picked] = A
        stop = np.abs(A).dot(self._a)
        self._stop[picked] = np.maximum(stop, _LEAST)
        self._brake[picked] = np.maximum(stop, self._least_brake.take(picked))

    def _closing(self, pair: NDArray[np.intp], distance: Vector, segment: Matrix) -> Matrix:
        """How fast pairs close per joint (k, n): n . (J_a - J_b), n from the first to the second.

        MuJoCo's `cdof` holds the twist (w, v) of each joint about the centre of mass c: it moves
        a point p along n by n . (v + w x (p - c)) = Σ_ik n_i S_ik (p - c, 1)_k with
        S = ([w]×, v). The two nearest points lie on one line along n, so either will do for both
        Jacobians.
        """
        k = len(pair)
        p, products = self._p[:k], self._products[:k]
        n = segment[:, 3:] - segment[:, :3]
        n /= distance[:, None]
        np.subtract(segment[:, :3], self._centre, out=p[:, :3])
        np.multiply(n[:, :, None], p[:, None, :], out=products)
        A: Matrix = products.reshape(k, 12) @ (_SKEW @ self._twists.T)
        A *= self._sign.take(pair, axis=0)
        return A


def _skew() -> Matrix:
    """Maps (w, v) to ([w]×, v), row by row (12, 6)."""
    out = np.zeros((3, 4, 6))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[i, k, j], out[i, j, k], out[i, 3, 3 + i] = 1.0, -1.0, 1.0
    return out.reshape(12, 6)


_SKEW = _skew()
