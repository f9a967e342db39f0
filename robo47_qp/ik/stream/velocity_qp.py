"""The joint velocity closest to a wanted one, among those that limits and clearances allow."""

from math import isfinite
from typing import NamedTuple

import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.ik.box_qp import BoxQp, box_qp
from robo47_qp.ik.stream.clearance_bounds import VelocityRows
from robo47_qp.ik.stream.joint_bounds import VelocityBox
from robo47_qp.ik.stream.settings import Event
from robo47_qp.ik.stream.user_parts import UserEqualities, UserRows

_FULL_SHARE = 0.05
"""Room from which on a pair gives way in full [m]."""
_LEAST_SHARE = 0.1
"""Part by which a pair without any room gives way."""
_HARD = 1e4
"""Weight of giving way beside the tool's velocity."""
_YIELDING = 1e2
"""How much rather a user's limits give way than constraints, and these than clearances."""
_MOST = 1e2
"""Largest slack [unit of a row per second]."""
_STAY = 1e-6
"""Weight of velocities that no objective asks for, beside those of objectives."""


class Kept(NamedTuple):
    """What the velocity is subject to, besides the box."""

    rows: VelocityRows | None
    user: UserRows | None
    equal: UserEqualities | None

    @property
    def order(self) -> tuple[Event, ...]:
        """In which order it gives way."""
        parts = (
            (Event.LIMIT_RELAXED, self.user),
            (Event.CONSTRAINT_RELAXED, self.equal),
            (Event.CLEARANCE_RELAXED, self.rows),
        )
        return tuple(event for event, part in parts if part is not None and len(part[1]))


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
        self._free: dict[int, BoxQp] = {}
        self._backend, self._n = backend, n
        self._H, self._f = np.zeros((n + 1, n + 1)), np.zeros(n + 1)
        self._H[n, n] = _HARD
        self._low, self._high = np.zeros(n + 1), np.full(n + 1, _MOST)

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
        self, H: Matrix, f: Vector, box: VelocityBox, kept: Kept
    ) -> tuple[Vector, tuple[Event, ...]]:
        """Return the velocity of least ½ vᵀ H v + fᵀ v within a user's limits and constraints, too.

        Where no velocity in the box meets all rows, the user's limits give way by a slack of their
        own; where constraints cannot be met either, they become objectives that are dear; then
        clearances give way, those with much room first.
        """
        order = kept.order
        for soft in range(len(order) + 1):
            v = self._relaxing(H, f, box, kept, order[:soft])
            if v is not None and _is_answer(v):
                return np.minimum(np.maximum(v, box.low), box.high), order[:soft]
        v = np.minimum(np.maximum(np.zeros(self._n), box.low), box.high)
        return v, (Event.NO_ANSWER,)

    def _relaxing(
        self, H: Matrix, f: Vector, box: VelocityBox, kept: Kept, soft: tuple[Event, ...]
    ) -> Vector | None:
        """Return the velocity where some of what is kept gives way, the first the easiest."""
        n, parts = self._n, list[tuple[Matrix, Vector, Vector | None, float]]()
        weights = {
            event: _HARD * _YIELDING ** (i - min(len(soft) - 1, 1)) for i, event in enumerate(soft)
        }
        if kept.user is not None:
            (A, upper), weight = kept.user, weights.get(Event.LIMIT_RELAXED, 0.0)
            parts.append((A, upper, np.ones(len(upper)) if weight else None, weight))
        if kept.equal is not None:
            (J, rate, wanted), weight = kept.equal, weights.get(Event.CONSTRAINT_RELAXED, 0.0)
            H, f = H + weight * J.T @ J, f - weight * wanted @ J
            if not weight:
                parts.append((np.vstack([J, -J]), np.concatenate([rate, -rate]), None, 0.0))
        if kept.rows is not None and len(kept.rows.upper):
            weight = weights.get(Event.CLEARANCE_RELAXED, 0.0)
            share = np.clip(kept.rows.room / _FULL_SHARE, _LEAST_SHARE, 1.0)
            parts.append((kept.rows.A, kept.rows.upper, share if weight else None, weight))
        dear = [weight for _, _, share, weight in parts if share is not None]
        slacks = np.zeros((sum(len(upper) for _, upper, _, _ in parts), len(dear)))
        row = column = 0
        for _, upper, part, _ in parts:
            if part is not None:
                slacks[row : row + len(upper), column] = -part
                column += 1
            row += len(upper)
        m = n + len(dear)
        if m not in self._free:
            self._free[m] = box_qp(self._backend, m)
        whole = np.zeros((m, m))
        whole[:n, :n] = H
        whole[range(n, m), range(n, m)] = dear
        none, most = np.zeros(len(dear)), np.full(len(dear), _MOST)
        x = self._free[m].solve(
            whole,
            np.concatenate([f, none]),
            np.concatenate([box.low, none]),
            np.concatenate([box.high, most]),
            np.hstack([np.vstack([np.zeros((0, n)), *(A for A, _, _, _ in parts)]), slacks]),
            np.concatenate([none[:0], *(upper for _, upper, _, _ in parts)]),
        )
        return None if x is None else x[:n]

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
