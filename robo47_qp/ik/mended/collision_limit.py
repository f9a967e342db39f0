"""A mink limit that keeps pairs of geoms apart: in metres per step, at any length of a step."""

from collections.abc import Iterable, Sequence
from itertools import product
from typing import NamedTuple, TypeAlias

import mink
import mujoco
import numpy as np

from robo47_qp.arrays import Matrix, Range, Vector
from robo47_qp.collision.broad_phase import BroadPhase
from robo47_qp.collision.distance import GeomDistance
from robo47_qp.collision.motion_bounds import moved_by
from robo47_qp.errors import InvalidValueError, UnknownNameError
from robo47_qp.ik.box_qp import box_qp
from robo47_qp.ik.mended.joint_limit import JointLimit
from robo47_qp.ik.stream.joint_bounds import max_stoppable_speed

Geoms: TypeAlias = Sequence[int | str]
_Pair: TypeAlias = tuple[int, int]
_TOUCH, _H = 1e-7, 1e-6
"""Distance below which nearest points show no direction [m]; step of the differences there."""
_FAR = 1e3
"""Larger than any step or distance [rad, m]."""
_SOFT = 1e-8
"""Weight of the step beside that of the relaxation."""
_ROUNDING = 1e-9
"""A relaxation below this is none [m]."""
_LEAST = 1e-9
"""Rows below this are zero [m/rad], and no pair brakes by less than this [m/s²]."""


class DroppedPair(NamedTuple):
    """A pair of geoms that was asked for and is not kept apart."""

    geoms: tuple[int, int]
    reason: str


class CollisionLimit(mink.Limit):
    """Keeps pairs of geoms apart, as `mink.CollisionAvoidanceLimit` does, with these differences.

    With d the distance of a pair and A dq how far a step dq brings it closer, the rows are

        A dq <= gain (d - d_min)        where d >= d_min,
        A dq <= -recovery (d_min - d)   where d < d_min,

    all in metres, so they hold at any dt; mink 1.3 divides the first by dt and has 0 in the
    second, which never parts a pair. Pairs come sorted. A pair of the first moving link and a
    geom of the world is kept; a pair that is not, is told in `dropped`.

    With a `joint_limit`, pairs close no faster than its joints can brake: a pair with the row A
    can brake at braking_share Σ_j |A_j| a_max,j. And where no step of `JointLimit.box` meets all
    rows, they are relaxed by the same least distance, so that both limits together always leave
    a solution; `relaxed` tells by how much.
    """

    def __init__(  # noqa: PLR0913 as mink's
        self,
        model: mujoco.MjModel,
        geom_pairs: Iterable[tuple[Geoms, Geoms]],
        *,
        gain: float = 0.85,
        minimum_distance_from_collisions: float = 0.005,
        collision_detection_distance: float = 0.1,
        recovery: float = 0.5,
        joint_limit: JointLimit | None = None,
        braking_share: float = 0.5,
    ) -> None:
        """Choose the pairs.

        Args:
            model: Any model.
            geom_pairs: Pairs of groups of geoms, by name or number: each geom of the first is
                kept apart from each of the second.
            gain: Largest share of the distance left that a step may take, in (0, 1].
            minimum_distance_from_collisions: d_min [m].
            collision_detection_distance: Pairs farther apart get no row [m]; more than d_min
                by more than a pair can close in a step.
            recovery: Share of the lacking distance to regain in a step, in [0, 1].
            joint_limit: Limit of the same model that the rows have to fit.
            braking_share: Share of the joints' deceleration counted on, in (0, 1].

        Raises:
            UnknownNameError: The model has no geom of a name.
            InvalidValueError: A number is out of its range, or no pair is left to keep apart.
        """
        Range(above=0.0, at_most=1.0).check("gain", gain)
        Range(at_least=0.0, at_most=1.0).check("recovery", recovery)
        Range(above=0.0, at_most=1.0).check("braking_share", braking_share)
        d_min, detection = minimum_distance_from_collisions, collision_detection_distance
        if not (np.isfinite(d_min) and d_min < detection < np.inf):
            name, expected = "collision_detection_distance", f"above {d_min:g} m, and finite"
            raise InvalidValueError(name, detection, expected)
        self.geom_id_pairs, self.dropped = _pairs(model, geom_pairs)
        if not self.geom_id_pairs:
            reasons = sorted({one.reason for one in self.dropped}) or ["none was given"]
            raise InvalidValueError("geom_pairs", reasons, "pairs of which one can be kept apart")
        self._model, self._gain, self._d_min, self._far = model, gain, d_min, detection
        self._recovery, self._joint_limit, self._share = recovery, joint_limit, braking_share
        self.relaxed: float = 0.0
        """By how much the last rows were relaxed [m]."""
        self._broad, self._scratch = BroadPhase(model, self.geom_id_pairs), mujoco.MjData(model)

    def compute_qp_inequalities(
        self, configuration: mink.Configuration, dt: float
    ) -> mink.Constraint:
        """Return G and h with G dq <= h for the step dq: a row for each pair that is near."""
        self.relaxed = 0.0
        measure, rows, distances = GeomDistance(self._model, configuration.data), [], []
        for i in np.flatnonzero(self._broad.bounds(configuration.data) < self._far).tolist():
            pair = self.geom_id_pairs[i]
            distance = measure.between(*pair, self._far)
            if distance < self._far:
                row = self._closing(configuration, pair, distance, measure.segment)
                # Where no joint changes the distance, there is nothing to ask for.
                if np.abs(row).max() > _LEAST:
                    rows.append(row)
                    distances.append(distance)
        if not rows:
            return mink.Constraint()
        A, room = np.array(rows), np.array(distances) - self._d_min
        h = np.where(room < 0.0, self._recovery, self._gain) * room
        if self._joint_limit is not None:
            h = self._fitted(self._joint_limit, configuration, A, room, h, dt)
        return mink.Constraint(G=A, h=h)

    def _fitted(
        self,
        limit: JointLimit,
        configuration: mink.Configuration,
        A: Matrix,
        room: Vector,
        h: Vector,
        dt: float,
    ) -> Vector:
        """Return the bounds with room to brake, relaxed where no step in the box meets them."""
        brake = self._share * (np.abs(A[:, limit.dofs]) @ limit.a_max)
        speed = max_stoppable_speed(room, 0.0, np.maximum(brake, _LEAST), dt)
        h = np.minimum(h, dt * speed)
        low, high = (np.clip(end, -_FAR, _FAR) for end in limit.box(configuration, dt))
        rest = np.clip(0.0, low, high)
        return h if (A @ rest <= h + _ROUNDING).all() else self._relaxed_rows(A, h, low, high, rest)

    def _relaxed_rows(
        self, A: Matrix, h: Vector, low: Vector, high: Vector, rest: Vector
    ) -> Vector:
        """Return h + s with the smallest s for which a step in the box meets A dq <= h + s."""
        n = len(rest)
        weights = np.full(n + 1, _SOFT)
        weights[n] = 1.0
        ends = np.append(low, 0.0), np.append(high, _FAR)
        slack = np.column_stack([A, -np.ones(len(A))])
        f = np.append(-_SOFT * rest, 0.0)
        x = box_qp("daqp", n + 1).solve(np.diag(weights), f, *ends, slack, h)
        s = float(np.max(A @ rest - h) if x is None else max(0.0, x[n], np.max(A @ x[:n] - h)))
        self.relaxed = s if s > _ROUNDING else 0.0
        return h + s + _ROUNDING

    def _closing(
        self, configuration: mink.Configuration, pair: _Pair, distance: float, segment: Vector
    ) -> Vector:
        """Return -n . (J_b - J_a), n from the first geom to the second (nv,) [m/rad]."""
        if abs(distance) < _TOUCH:
            return self._by_differences(configuration.q, pair)
        m, ends = self._model, segment.reshape(2, 3)
        J = np.empty((2, 3, m.nv))
        for J_end, end, geom in zip(J, ends, pair, strict=True):
            mujoco.mj_jac(m, configuration.data, J_end, None, end, m.geom_bodyid[geom])
        closing: Vector = (ends[1] - ends[0]) @ (J[0] - J[1]) / distance
        return closing

    def _by_differences(self, q: Vector, pair: _Pair) -> Vector:
        """Return the same for geoms that touch, whose nearest points show no direction."""
        m, d = self._model, self._scratch
        measure, ends = GeomDistance(m, d), []
        for step in (*(_H * np.eye(m.nv)), *(-_H * np.eye(m.nv))):
            d.qpos[:] = q
            mujoco.mj_integratePos(m, d.qpos, step, 1.0)
            mujoco.mj_kinematics(m, d)
            ends.append(measure.between(*pair, np.inf))
        after, before = np.array(ends).reshape(2, m.nv)
        closing: Vector = (before - after) / (2 * _H)
        return closing


def _pairs(
    m: mujoco.MjModel, groups: Iterable[tuple[Geoms, Geoms]]
) -> tuple[tuple[_Pair, ...], tuple[DroppedPair, ...]]:
    """Return the pairs to keep apart, and those that are not, both sorted."""
    asked = {
        (min(pair), max(pair))
        for a, b in groups
        for pair in product(_numbers(m, a), _numbers(m, b))
        if pair[0] != pair[1]
    }
    moves = moved_by(m)
    reasons = {pair: _why_dropped(m, moves, pair) for pair in sorted(asked)}
    kept = tuple(pair for pair, reason in reasons.items() if reason is None)
    return kept, tuple(DroppedPair(pair, why) for pair, why in reasons.items() if why is not None)


def _numbers(m: mujoco.MjModel, geoms: Geoms) -> list[int]:
    numbers = []
    for geom in geoms:
        number = geom if isinstance(geom, int | np.integer) else _named(m, geom)
        Range(at_least=0, at_most=m.ngeom - 1, whole=True).check("number of a geom", number)
        numbers.append(int(number))
    return numbers


def _named(m: mujoco.MjModel, name: str) -> int:
    number = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_GEOM, name)
    if number < 0:
        known = [m.geom(i).name for i in range(m.ngeom)]
        raise UnknownNameError("geom", name, [one for one in known if one])
    return int(number)


def _why_dropped(m: mujoco.MjModel, moves: Matrix, pair: _Pair) -> str | None:
    """Return why a pair is not kept apart; None where it is.

    As in mink, except that the only static neighbour of the first moving link is the body that
    carries its joint, if that is not the world: MuJoCo looks at contacts with the world, too.
    """
    a, b = pair
    if not (m.geom_contype[a] & m.geom_conaffinity[b] or m.geom_contype[b] & m.geom_conaffinity[a]):
        return "contype and conaffinity of the model"
    bodies = m.geom_bodyid[[a, b]]
    if not np.diff(moves[bodies], axis=0).any():
        return "no joint moves one against the other"
    weld = m.body_weldid[bodies]
    above = m.body_parentid[weld]
    for one, other in ((0, 1), (1, 0)):
        of_world = weld[other] == 0 and (bodies[other] == 0 or bodies[other] != above[one])
        if m.body_weldid[above[one]] == weld[other] and not of_world:
            return "neighbours that a joint connects"
    return None
