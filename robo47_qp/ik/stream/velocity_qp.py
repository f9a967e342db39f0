"""The joint velocity closest to a wanted one, among those that limits and clearances allow."""

from math import isfinite

import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.ik.box_qp import BoxQp, box_qp
from robo47_qp.ik.stream.clearance_bounds import VelocityRows
from robo47_qp.ik.stream.joint_bounds import VelocityBox
from robo47_qp.ik.stream.settings import Event
from robo47_qp.ik.stream.user_parts import UserRows

_FULL_SHARE = 0.05
"""Room from which on a pair gives way in full [m]."""
_LEAST_SHARE = 0.1
"""Part by which a pair without any room gives way."""
_HARD = 1e4
"""Weight of giving way beside the tool's velocity."""
_YIELDING = 1e2
"""How much rather a user's limits give way than clearances."""
_STAY = 1e-6
"""Weight of velocities that no objective asks for, beside those of objectives."""


class VelocityQp:
    """min over v of ½ (v - v_ref)ᵀ H (v - v_ref) in a box, subject to rows A v <= upper.

    The box is hard and never empty. Where no velocity in it meets all rows, they are relaxed to
    A v <= upper + s clip(room / 5 cm, 0.1, 1), with a small s >= 0: pairs with much room give
    way before those with little. Where that finds no answer either, v is the one in the box that
    is closest to rest.
    """

    def __init__(self, backend: str, n: int) -> None:
        """Choose the QP solver, for n joints.

        Raises:
            UnknownNameError: No QP solver is called so.
        """
        self._strict, self._soft = box_qp(backend, n), box_qp(backend, n + 1)
        self._both = box_qp(backend, n + 2)
        self._free: dict[int, BoxQp] = {}
        self._backend, self._n = backend, n
        none = np.zeros(0)
        self._no_rows = VelocityRows(np.zeros((0, n)), none, none, np.zeros(0, dtype=np.intp))
        self._H_both = _HARD * np.eye(n + 2)
        self._H, self._f = np.zeros((n + 1, n + 1)), np.zeros(n + 1)
        self._H[n, n] = _HARD
        self._low, self._high = np.zeros(n + 1), np.full(n + 1, 1e2)

    def nearest(
        self, H: Matrix, v_ref: Vector, box: VelocityBox, rows: VelocityRows | None
    ) -> tuple[Vector, Event | None]:
        """The velocity for the next tick, and what had to give way for it."""
        held = np.minimum(np.maximum(v_ref, box.low), box.high)
        inside = not np.count_nonzero(held != v_ref)
        if rows is None or not len(rows.upper):
            if inside:
                return v_ref, None
            v = self._strict.solve(H, -H.dot(v_ref), box.low, box.high)
            told: Event | None = None
        else:
            if inside and not np.count_nonzero(rows.A.dot(v_ref) > rows.upper):
                return v_ref, None
            f = -H.dot(v_ref)
            v, told = self._strict.solve(H, f, box.low, box.high, rows.A, rows.upper), None
            if not _is_answer(v):
                v, told = self._relaxed(H, f, box, rows), Event.CLEARANCE_RELAXED
        if v is None or not _is_answer(v):
            v, told = np.zeros(self._n), Event.NO_ANSWER
        # QP solvers meet bounds but for rounding; commands meet them exactly.
        return np.minimum(np.maximum(v, box.low), box.high), told

    def nearest_within(
        self, H: Matrix, f: Vector, box: VelocityBox, rows: VelocityRows | None, user: UserRows
    ) -> tuple[Vector, tuple[Event, ...]]:
        """Return the velocity of least ½ vᵀ H v + fᵀ v within a user's limits, too.

        Where no velocity in the box meets all rows, the user's give way by a slack of their own;
        where clearances cannot be met either, both do.
        """
        n = self._n
        near = self._no_rows if rows is None else rows
        A, upper = np.vstack([near.A, user.A]), np.concatenate([near.upper, user.upper])
        v = self._strict.solve(H, f, box.low, box.high, A, upper)
        told: tuple[Event, ...] = ()
        slack = np.concatenate([np.zeros(len(near.upper)), np.ones(len(user.upper))])
        if not _is_answer(v):
            self._H[:n, :n], self._f[:n] = H, f
            self._low[:n], self._high[:n] = box.low, box.high
            x = self._soft.solve(
                self._H, self._f, self._low, self._high, np.column_stack([A, -slack]), upper
            )
            v = None if x is None else x[:n]
            told = (Event.LIMIT_RELAXED,)
        if not _is_answer(v):
            share = np.clip(near.room / _FULL_SHARE, _LEAST_SHARE, 1.0)
            slacks = np.column_stack([slack, np.concatenate([share, np.zeros(len(user.upper))])])
            self._H_both[:n, :n] = H
            self._H_both[n, n] = _HARD / _YIELDING
            x = self._both.solve(
                self._H_both,
                np.concatenate([f, np.zeros(2)]),
                np.concatenate([box.low, np.zeros(2)]),
                np.concatenate([box.high, np.full(2, 1e2)]),
                np.hstack([A, -slacks]),
                upper,
            )
            v = None if x is None else x[:n]
            told = (Event.CLEARANCE_RELAXED, Event.LIMIT_RELAXED)
        if v is None or not _is_answer(v):
            v, told = np.zeros(n), (Event.NO_ANSWER,)
        return np.minimum(np.maximum(v, box.low), box.high), told

    def improved(
        self,
        v: Vector,
        cost: tuple[Matrix, Vector],
        N: Matrix,
        box: VelocityBox,
        rows: tuple[Matrix, Vector],
    ) -> Vector:
        """Return v + N z of least cost in the box; no row is exceeded further than by v.

        Args:
            v: A velocity in the box (n,) [rad/s].
            cost: H and c of ½ v'ᵀ H v' + cᵀ v'.
            N: Basis of the velocities that are free (n, m).
            box: Bounds of velocities.
            rows: A and upper of A v' <= upper.
        """
        m = N.shape[1]
        (H, c), (A, upper) = cost, rows
        if m not in self._free:
            self._free[m] = box_qp(self._backend, m)
        reduced = N.T @ H @ N
        reduced += _STAY * (1.0 + np.trace(reduced)) * np.eye(m)
        sides = np.vstack([N, -N, A @ N])
        room = np.concatenate([box.high - v, v - box.low, np.maximum(upper - A @ v, 0.0)])
        far = np.full(m, 1e2)
        z = self._free[m].solve(reduced, N.T @ (H @ v + c), -far, far, sides, room)
        if z is None or not _is_answer(z):
            return v
        return np.minimum(np.maximum(v + N @ z, box.low), box.high)

    def _relaxed(self, H: Matrix, f: Vector, box: VelocityBox, rows: VelocityRows) -> Vector | None:
        n = self._n
        self._H[:n, :n], self._f[:n] = H, f
        self._low[:n], self._high[:n] = box.low, box.high
        share = np.clip(rows.room / _FULL_SHARE, _LEAST_SHARE, 1.0)
        A = np.column_stack([rows.A, -share])
        x = self._soft.solve(self._H, self._f, self._low, self._high, A, rows.upper)
        return None if x is None else x[:n]


def _is_answer(v: Vector | None) -> bool:
    return v is not None and isfinite(v.dot(v))
