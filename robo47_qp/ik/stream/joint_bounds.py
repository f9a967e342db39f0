"""Bounds on the next joint velocity that keep every later joint limit within reach of the brakes.

Time goes in ticks of dt with constant acceleration: v' = v + a dt, q' = q + dt (v + v') / 2.
Between ticks the motion is a parabola, so limits hold at every instant, not at ticks only.
"""

from dataclasses import dataclass
from math import floor, sqrt

import numpy as np
from numpy.typing import ArrayLike

from robo47_qp._core.library import backend, functions, pointer
from robo47_qp.arrays import Matrix, Vector, frozen_vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.robot import MotionProfile

UNLIMITED = 1e6
"""Stands for the end of a range that a joint does not have [rad or m]."""
_ROUNDING = 1e-9
"""Less than this outside a limit is no reason to recover [rad, rad/s]."""


def stopping_distance(v: ArrayLike, a_max: ArrayLike, dt: float) -> Vector:
    """Shortest way to rest at a tick, braking at a_max [rad].

    Full braking until less than one tick's worth a_max dt is left, then the rest in one tick.
    With |v| = (m + r) a_max dt, m whole and 0 <= r < 1, it is
    a_max dt² (m² + r (2 m + 1)) / 2: v² / (2 a_max) joined by straight lines at whole m.
    """
    step = np.multiply(a_max, dt)
    u = np.abs(v) / step
    m = np.floor(u)
    distance: Vector = step * dt * (m * m + (u - m) * (2.0 * m + 1.0)) / 2.0
    return distance


def max_stoppable_speed(distance: ArrayLike, v: ArrayLike, a_max: ArrayLike, dt: float) -> Vector:
    """Largest velocity at the next tick after which there is still room to stop [rad/s].

    It solves dt (v + v') / 2 + stopping_distance(v') = distance for v' >= 0. In units of
    a_max dt and with δ = distance / (a_max dt²) - v / (2 a_max dt) that is
    m (m + 1) / 2 + r (m + 1) = δ with v' = (m + r) a_max dt, so m + r = m / 2 + δ / (m + 1).
    Where δ < 0 there is no room even for v' = 0: the answer is 0.

    Args:
        distance: Room ahead, in the direction in which v counts positive [rad].
        v: Velocity now [rad/s].
        a_max: Largest acceleration [rad/s²].
        dt: Length of a tick [s].
    """
    step = np.multiply(a_max, dt)
    delta = (np.divide(distance, dt) - np.multiply(v, 0.5)) / step
    delta = np.maximum(delta, 0.0)
    m = np.floor(np.sqrt(2.0 * delta + 0.25) - 0.5)
    speed: Vector = step * (0.5 * m + delta / (m + 1.0))
    return speed


def _fastest(distance: float, v: float, step: float, dt: float) -> float:
    """`fastest` of one joint, with the step a_max dt."""
    delta = (distance / dt - 0.5 * v) / step
    if delta <= 0.0:
        return 0.0
    m = floor(sqrt(2.0 * delta + 0.25) - 0.5)
    return step * (0.5 * m + delta / (m + 1.0))


def braked(v: Vector, a_max: Vector, dt: float) -> Vector:
    """Velocity at the next tick when every joint brakes as hard as it may [rad/s]."""
    step = a_max * dt
    return v - np.clip(v, -step, step)


@dataclass(frozen=True, kw_only=True)
class VelocityBox:
    """Joint velocities that the next tick may have."""

    low: Vector
    """(n,) [rad/s]"""
    high: Vector
    """(n,), nowhere below `low` [rad/s]."""
    recovering: bool
    """True where position or velocity could not be kept inside and are brought back."""


class JointBounds:
    """The box of next velocities of one arm.

    A state is *viable* where each joint is inside its range, no faster than v_max, and its
    stopping distance is no longer than the room ahead. From a viable state the box is never
    empty, for full braking is in it, and every velocity in it leads to a viable state.

    Any other state (only `reset` can make one) is brought back. The bounds give way in this
    order: position, velocity, and acceleration never. A joint outside its range returns to it
    as fast as it can stop there.
    """

    def __init__(
        self, q_min: Vector, q_max: Vector, profile: MotionProfile, dt: float, margin: float
    ) -> None:
        """Set the limits.

        Args:
            q_min: Lower ends of the joint ranges (n,) [rad]; may be infinite.
            q_max: Upper ends [rad]; may be infinite.
            profile: Its v_max and a_max are kept; j_max is not looked at.
            dt: Length of a tick [s].
            margin: Part of every limit that is left unused, against rounding [-]; of the
                range for positions.

        Raises:
            InvalidValueError: A range is empty, or the profile is for another number of joints.
        """
        n = np.size(q_min)
        ends = np.maximum(q_min, -UNLIMITED), np.minimum(q_max, UNLIMITED)
        low, high = frozen_vector("q_min", ends[0], n), frozen_vector("q_max", ends[1], n)
        if (low >= high).any():
            raise InvalidValueError("q_min", low.tolist(), f"below q_max {high.tolist()}")
        inset = margin * (high - low)
        self.dt = dt
        self.q_min: Vector = low + inset
        """Lower ends that are kept [rad]."""
        self.q_max: Vector = high - inset
        """Upper ends that are kept [rad]."""
        self.v_max: Vector = (1.0 - margin) * frozen_vector("v_max", profile.v_max, n)
        """Speeds that are kept [rad/s]."""
        self.a_max: Vector = (1.0 - margin) * frozen_vector("a_max", profile.a_max, n)
        """Accelerations that are kept [rad/s²]."""
        self._step, self._v_min = self.a_max * dt, -self.v_max
        # Further from its limit than this, a joint may go at v_max whatever its speed is now.
        ample = stopping_distance(self.v_max, self.a_max, dt) + (self.v_max + self._step) * dt
        limits = (self.q_min, self.q_max, self.v_max, self._step, ample)
        self._limits = np.stack(limits, axis=1)
        self._rows: list[list[float]] = self._limits.tolist()
        self._compiled = backend() == "compiled"
        if self._compiled:
            self._memory = np.zeros((4, n))
            self._pointers = pointer(self._limits), *map(pointer, self._memory)

    def is_viable(self, q: Vector, v: Vector) -> bool:
        """True where the arm can still be stopped inside all limits."""
        ahead = stopping_distance(v, self.a_max, self.dt)
        room = np.where(v > 0.0, self.q_max - q, q - self.q_min)
        inside = (q >= self.q_min) & (q <= self.q_max) & (np.abs(v) <= self.v_max)
        return bool((inside & (ahead <= room)).all())

    def box(self, q: Vector, v: Vector) -> VelocityBox:
        """Bounds on the velocity at the next tick, from the state now.

        Raises:
            InvalidValueError: The state has another number of joints.
        """
        n = len(self._rows)
        if len(q) != n or len(v) != n:
            raise InvalidValueError("joints", f"{len(q)} of q, {len(v)} of v", str(n))
        ends = self._compiled_box(q, v) if self._compiled else self._viable_box(q, v)
        if ends is not None:
            return VelocityBox(low=np.array(ends[0]), high=np.array(ends[1]), recovering=False)
        room, ahead = np.stack([self.q_max - q, q - self.q_min]), np.stack([v, -v])
        out = room < -_ROUNDING
        outside = bool(out.any())
        if outside:
            kept = max_stoppable_speed(
                np.abs(room), np.where(out, -ahead, ahead), self.a_max, self.dt
            )
            # To go back at this speed is the least that is asked for.
            kept[out] *= -1.0
        else:
            kept = max_stoppable_speed(room, ahead, self.a_max, self.dt)
        np.minimum(kept, self.v_max, out=kept)
        np.maximum(kept, self._v_min, out=kept)
        low, high = v - self._step, v + self._step
        most, least = kept[0], -kept[1]
        fits = (most >= low - _ROUNDING).all() and (least <= high + _ROUNDING).all()
        most = np.minimum(np.maximum(most, low), high)
        least = np.minimum(np.minimum(np.maximum(least, low), high), most)
        return VelocityBox(low=least, high=most, recovering=outside or not fits)

    def _compiled_box(self, q: Vector, v: Vector) -> Matrix | None:
        """Return what `_viable_box` does, by the compiled core."""
        limits, *rest = self._pointers
        call = functions().r47_velocity_box
        self._memory[:2] = q, v
        return None if call(len(q), limits, self.dt, _ROUNDING, *rest) else self._memory[2:]

    def _viable_box(self, q: Vector, v: Vector) -> tuple[list[float], list[float]] | None:
        """Both ends of the box; None where a joint has to be brought back.

        Joint by joint: for so few numbers floats are several times faster than arrays.
        """
        lows, highs, dt = [], [], self.dt
        for (q_min, q_max, v_max, step, ample), q_j, v_j in zip(
            self._rows, q.tolist(), v.tolist(), strict=True
        ):
            low, high, most, least = v_j - step, v_j + step, v_max, -v_max
            above, below = q_max - q_j, q_j - q_min
            if above < ample:
                most = min(most, _fastest(above, v_j, step, dt))
            if below < ample:
                least = max(least, -_fastest(below, -v_j, step, dt))
            if min(above, below, most - low, high - least) < -_ROUNDING:
                return None
            most = min(max(most, low), high)
            lows.append(min(max(least, low), high, most))
            highs.append(most)
        return lows, highs

    def moved(self, q: Vector, v: Vector, v_next: Vector) -> Vector:
        """Position at the next tick [rad]."""
        return q + (0.5 * self.dt) * (v + v_next)
