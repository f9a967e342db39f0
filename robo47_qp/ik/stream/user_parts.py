"""A user's objectives, limits and constraints in a stream, for the joint velocity."""

from collections.abc import Sequence
from typing import NamedTuple

import mink
import numpy as np
from mink.tasks import BaseTask

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.ik.objectives import Composition, Objective, composed
from robo47_qp.ik.stream.guard import Guard
from robo47_qp.ik.stream.joint_bounds import max_stoppable_speed
from robo47_qp.ik.stream.settings import Event, StreamSettings
from robo47_qp.ik.stream.target_velocity import DampedInverse, Way, approach_rate
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import MotionProfile

_UNMET = 1e-2
"""Part of an objective's pull that may be left before it counts as having given way."""
_NO_PULL = 1e-5
"""A pull that is too small to count."""
_REGULAR = 1e-6
"""Added to the diagonal where an objective leaves joints undetermined."""
_NULL = 1e-6
"""Singular values of constraints below this part of the largest count as none."""
_PARTING, _REGAIN = 0.3, 10.0
"""What lies beyond a limit comes back at this part of the speed at which it could still stop, and
regains this part of what it lacks per second."""


class UserRows(NamedTuple):
    """A v' <= upper, for the joint velocity v' at the next tick."""

    A: Matrix
    """(k, n)"""
    upper: Vector
    """(k,) [unit of the row per second]"""


class UserEqualities(NamedTuple):
    """J v' = rate, for the joint velocity v' at the next tick."""

    J: Matrix
    """(k, n)"""
    rate: Vector
    """What the joints can reach by then (k,) [unit of the error per second]."""
    wanted: Vector
    """What it is on the way to (k,)."""


class UserCost(NamedTuple):
    """½ xᵀ H x + cᵀ x of one objective, for a joint displacement x that meets it."""

    H: Matrix
    c: Vector
    W: Matrix
    """Rows whose null space leaves the objective as it is (k, n)."""

    def unmet(self, v: Vector, pace: float) -> bool:
        """Return whether a velocity leaves more than a hundredth of its pull at a pace."""
        pull = pace * self.c
        left = self.H.dot(v) + pull
        return bool(left.dot(left) > _UNMET**2 * pull.dot(pull) + _NO_PULL**2)


class UserParts:
    """The objectives, limits and constraints of a user for one arm, evaluated at every tick.

    Each comes through `mink.build_ik` by itself. One that raises, or is not finite, is left out of
    that tick, and counted.

    Tasks of one priority together ask for a joint displacement; it is approached at the pace of
    the stream's gain, and slower where its joints could not stop in time (`approach_rate`). Costs
    are those of mink: per metre or radian of the error.

    The bound h(dt) of a limit is taken apart into h(0), a way, and its slope, a speed. The row may
    move at the slope and besides as fast as it can still stop within the way, with β Σ_j |G_j|
    a_max,j, as `ClearanceBounds` has it: a limit on a way is kept though it knows nothing of
    brakes, and a limit on a speed is kept as it is.

    The errors e of all constraints fall at one pace K, J v' = -K e: that of the stream's gain, and
    slower where the joints could not stop, or start, in time. An error that is zero stays zero.
    """

    def __init__(self, settings: StreamSettings, arm: Arm, profile: MotionProfile) -> None:
        """Build and check all parts.

        Raises:
            UnknownNameError, InvalidValueError: See `composed`.
        """
        objectives = tuple(
            one if isinstance(one, Objective) else Objective(one) for one in settings.objectives
        )
        self.composed = composed(
            arm,
            Composition(objectives, settings.limits, settings.constraints, settings.frozen),
        )
        self._configuration = mink.Configuration(arm.model, q=arm.home)
        self._n, self._dt, self._gain = arm.n, settings.dt, settings.gain
        self._v_use, self._a_use = (
            settings.reserve * profile.v_max,
            settings.reserve * profile.a_max,
        )
        self._brake = settings.braking_share * profile.a_max

    def move(self, q: Vector) -> None:
        """Evaluate at q from now on."""
        self._configuration.update(q)

    def levels(self, events: set[Event]) -> list[list[UserCost]]:
        """Return the costs by priority: those beside the tool first; adds to the events."""
        return [
            [cost for part in level if (cost := self._cost(part.task, events)) is not None]
            for level in self.composed.levels
        ]

    def _cost(self, task: BaseTask, events: set[Event]) -> UserCost | None:
        found: UserCost | None = None
        with Guard():
            problem = mink.build_ik(self._configuration, [task], self._dt, 0.0, limits=[])
            H, c = np.asarray(problem.P, np.float64), np.asarray(problem.q, np.float64)
            W = H
            if isinstance(task, mink.Task):
                J = np.asarray(task.compute_jacobian(self._configuration), np.float64)
                W = J[np.broadcast_to(task.cost, len(J)) > 0.0]
            shapes = H.shape == (self._n, self._n) and c.shape == (self._n,)
            if shapes and all(np.isfinite(one).all() for one in (H, c, W)):
                found = UserCost(H, c, W)
        if found is None:
            events.add(Event.OBJECTIVE_LEFT_OUT)
            return None
        return found

    def pace(self, H: Matrix, pull: Vector) -> float:
        """Return the pace of the way that minimises ½ xᵀ H x - pullᵀ x; see `approach_rate`."""
        way = np.linalg.solve(H + _REGULAR * (1.0 + np.trace(H)) * np.eye(self._n), pull)
        return approach_rate(way, self._v_use, self._a_use, self._gain)

    def rows(self, v: Vector, events: set[Event]) -> UserRows | None:
        """Return the rows of all limits; None where there are none.

        Args:
            v: Velocity now (n,) [rad/s].
            events: Gets what had to be left out.
        """
        found = []
        for limit in self.composed.limits:
            rows = self._rows_of(limit, v)
            if rows is None:
                events.add(Event.LIMIT_LEFT_OUT)
            elif len(rows.upper):
                found.append(rows)
        if not found:
            return None
        return UserRows(np.vstack([r.A for r in found]), np.hstack([r.upper for r in found]))

    def equalities(self, v: Vector, events: set[Event]) -> UserEqualities | None:
        """Return what the constraints ask for; None where there are none.

        Args:
            v: Velocity now (n,) [rad/s].
            events: Gets what had to be left out.
        """
        tasks = [part.task for part in self.composed.constraints]
        found = [self._equality(one, events) for one in tasks if isinstance(one, mink.Task)]
        kept = [one for one in found if one is not None]
        if not kept:
            return None
        J = np.vstack([J for J, _ in kept])
        fall = np.concatenate([fall for _, fall in kept])
        way = np.linalg.lstsq(J, fall, rcond=_NULL)[0]
        rate = approach_rate(way, self._v_use, self._a_use, self._gain) * fall
        now = J.dot(v)
        change = np.abs(np.linalg.lstsq(J, rate - now, rcond=_NULL)[0])
        share = np.min(self._a_use * self._dt / np.maximum(change, 1e-12), initial=1.0)
        return UserEqualities(J, now + share * (rate - now), rate)

    def within(self, equal: UserEqualities, v_ref: Vector, way: Way, threshold: float) -> Vector:
        """Return the velocity that meets constraints and moves the tools as v_ref does.

        It is v_c + φ d + N z: J v_c = rate, N a basis of what leaves J at rest, d = N (S N)⁺ S d_0
        the way of the joints at a pace φ at which they can stop, and z for the rest of v_ref.

        Args:
            equal: What the constraints ask for.
            v_ref: What the tools ask for (n,) [rad/s].
            way: What v_ref is made of; its rows are S.
            threshold: See `DampedInverse`.
        """
        v_c = np.asarray(np.linalg.lstsq(equal.J, equal.rate, rcond=_NULL)[0], np.float64)
        N = null_space([equal.J], self._n)
        if not N.shape[1]:
            return v_c
        inverse, rest = DampedInverse(way.rows @ N, threshold), v_ref - way.paced - v_c
        whole = N @ inverse.velocities(way.rows @ way.whole)
        pace = approach_rate(whole, self._v_use, self._a_use, self._gain)
        z = inverse.velocities(way.rows @ rest) + inverse.null(N.T @ rest)
        v: Vector = v_c + pace * whole + N @ z
        return v

    def _equality(self, task: mink.Task, events: set[Event]) -> tuple[Matrix, Vector] | None:
        found: tuple[Matrix, Vector] | None = None
        with Guard():
            problem = mink.build_ik(
                self._configuration, [], self._dt, limits=[], constraints=[task]
            )
            J, fall = np.asarray(problem.A, np.float64), np.asarray(problem.b, np.float64)
            finite = np.isfinite(J).all() and np.isfinite(fall).all()
            if J.shape == (len(fall), self._n) and finite:
                found = J, fall
        if found is None:
            events.add(Event.CONSTRAINT_LEFT_OUT)
        return found

    def _rows_of(self, limit: mink.Limit, v: Vector) -> UserRows | None:
        rows: UserRows | None = None
        with Guard():
            near, far = (
                mink.build_ik(self._configuration, [], k * self._dt, limits=[limit]) for k in (1, 2)
            )
            if near.G is None or near.h is None:
                return UserRows(np.zeros((0, self._n)), np.zeros(0))
            G, h = np.asarray(near.G, np.float64), np.asarray(near.h, np.float64)
            later = h if far.h is None or np.shape(far.h) != h.shape else np.asarray(far.h)
            if G.shape == (len(h), self._n) and np.isfinite(G).all() and not np.isnan(h).any():
                bounded = np.isfinite(h) & np.isfinite(later)
                rows = self._braked(G[bounded], h[bounded], later[bounded], v)
        return rows

    def _braked(self, G: Matrix, h: Vector, later: Vector, v: Vector) -> UserRows:
        slope = (later - h) / self._dt
        way, closing = h - slope * self._dt, G.dot(v)
        brake = np.maximum(np.abs(G).dot(self._brake), 1e-9)
        lacking = way < 0.0
        speed = max_stoppable_speed(np.abs(way), np.where(lacking, 0.0, closing), brake, self._dt)
        speed[lacking] = -np.minimum(_PARTING * speed[lacking], -_REGAIN * way[lacking])
        # Where there is a bound on the speed, the way is that of rounding.
        return UserRows(G, slope + np.where(np.abs(way) < 1e-12, 0.0, speed))


def null_space(rows: Sequence[Matrix], n: int) -> Matrix:
    """Return a basis (n, m) of the velocities that leave all rows (k, n) at rest."""
    stacked = np.vstack([np.zeros((1, n)), *rows])
    _, sigma, Vt = np.linalg.svd(stacked)
    rank = int((sigma > 1e-6 * max(1e-12, float(sigma[0]))).sum())
    basis: Matrix = Vt[rank:].T
    return basis
