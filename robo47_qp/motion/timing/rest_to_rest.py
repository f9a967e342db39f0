"""Motion from rest to rest: time laws of one coordinate, and several together on a line."""

from dataclasses import dataclass
from math import cbrt, ceil, inf, sqrt
from typing import Protocol

import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.robot import MotionProfile
from robo47_qp.motion.timing.state_to_state import check_motion, s_curve
from robo47_qp.motion.trajectory import Trajectory

_NOTHING = 1e-9
"""Distance below the resolution of Ruckig, which is made one step; and share of the distance
below which a coordinate limits nothing."""
_ROUNDING = 1e-9


class TimeLaw(Protocol):
    """Moves a coordinate from 0 to a length, at rest at both ends."""

    @property
    def bounds_jerk(self) -> bool:
        """True where the jerk is bounded too."""
        ...

    def run(self, length: float, bounds: Vector, dt: float) -> Matrix:
        """Return position, velocity and acceleration every dt (N + 1, 3), in the least time.

        Args:
            length: Positive.
            bounds: On velocity, acceleration and jerk (3,), positive.
            dt: Time between samples [s].

        Raises:
            InvalidValueError: A number is not positive and finite.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class SCurve:
    """Time-optimal with bounded jerk: up to seven phases of constant jerk, by Ruckig."""

    bounds_jerk: bool = True

    def run(self, length: float, bounds: Vector, dt: float) -> Matrix:
        """See `TimeLaw.run`."""
        return s_curve(length, bounds, dt)


@dataclass(frozen=True, kw_only=True)
class Trapezoid:
    """Time-optimal with bounded acceleration: the jerk is an impulse at each of its corners.

    Biagiotti and Melchiorri, Trajectory Planning for Automatic Machines and Robots, 2008, 3.2.
    """

    bounds_jerk: bool = False

    def run(self, length: float, bounds: Vector, dt: float) -> Matrix:
        """See `TimeLaw.run`."""
        v, a = _checked(length, bounds, dt)[:2]
        peak = min(v, sqrt(length * a))
        total = length / peak + peak / a
        t = _instants(total, dt)
        pace = total / t[-1]
        rise, x = peak / a, t * pace
        # Mirrored about the middle: what is left to go at the end was gone at the start.
        near = np.minimum(x, total - x)
        gone = np.where(near < rise, 0.5 * a * near**2, peak * (near - 0.5 * rise))
        s = np.where(x <= 0.5 * total, gone, length - gone)
        ds = np.minimum(a * near, peak)
        dds = np.where(near < rise, np.where(x < 0.5 * total, a, -a), 0.0)
        return _ends(np.column_stack([s, ds * pace, dds * pace**2]), length)


@dataclass(frozen=True, kw_only=True)
class Cubic:
    """s = 3 x² - 2 x³ over x = t / T: acceleration jumps at both ends, where jerk has no bound."""

    bounds_jerk: bool = False

    def run(self, length: float, bounds: Vector, dt: float) -> Matrix:
        """See `TimeLaw.run`."""
        return _polynomial((0.0, 0.0, 3.0, -2.0), (1.5, 6.0, inf), length, bounds, dt)


@dataclass(frozen=True, kw_only=True)
class Quintic:
    """s = 10 x³ - 15 x⁴ + 6 x⁵ over x = t / T: the jerk is bounded and jumps at both ends.

    Its largest speed is 15/8, its largest acceleration 10/√3 and its largest jerk 60, per
    length and powers of T (Biagiotti and Melchiorri, 2008, section 2.1).
    """

    bounds_jerk: bool = True

    def run(self, length: float, bounds: Vector, dt: float) -> Matrix:
        """See `TimeLaw.run`."""
        peaks = (15.0 / 8.0, 10.0 / sqrt(3.0), 60.0)
        return _polynomial((0.0, 0.0, 0.0, 10.0, -15.0, 6.0), peaks, length, bounds, dt)


S_CURVE = SCurve()
"""The default law."""


def rest_to_rest(
    start: Vector,
    goal: Vector,
    v_max: Vector,
    a_max: Vector,
    j_max: Vector,
    dt: float,
    law: TimeLaw = S_CURVE,
) -> Trajectory:
    """Move on the straight line between two points, each coordinate within its bounds.

    Args:
        start: Where to start, at rest (n,).
        goal: Where to come to rest (n,).
        v_max: Bounds on the velocity (n,), positive.
        a_max: Bounds on the acceleration (n,), positive.
        j_max: Bounds on the jerk (n,), positive.
        dt: Time between samples [s].
        law: Time law of the motion.

    Returns:
        The motion; with `S_CURVE` the duration is the shortest on the line that is a
        multiple of dt, the last sample is the goal, at rest.

    Raises:
        InvalidValueError: A position is not finite, a bound or dt is not positive.
    """
    check_motion(start, goal, v_max, a_max, j_max, dt)
    way = goal - start
    length = float(np.abs(way).max())
    if length < _NOTHING:
        x = np.array([start, goal] if length > 0.0 else [goal])
        return Trajectory(dt=dt, q=x, v=np.zeros_like(x), a=np.zeros_like(x))
    way = way / length
    moving = np.abs(way) > _NOTHING
    share = np.abs(way[moving])
    bounds = np.array([float((b[moving] / share).min()) for b in (v_max, a_max, j_max)])
    s, ds, dds = law.run(length, bounds, dt).T[:, :, None]
    x = start + s * way
    x[-1] = goal
    return Trajectory(dt=dt, q=x, v=ds * way, a=dds * way)


def plan_ptp(
    q_start: Vector, q_goal: Vector, profile: MotionProfile, dt: float, law: TimeLaw = S_CURVE
) -> Trajectory:
    """Plan a straight line in joint space from rest to rest.

    Between two configurations inside the joint limits every sample is inside them. The tool
    does not follow a line.

    Args:
        q_start: (n,) [rad].
        q_goal: (n,) [rad].
        profile: Bounds of the joints.
        dt: Time between samples [s].
        law: Time law of the motion.

    Raises:
        InvalidValueError: A configuration is not finite, or of other joints than the profile.
    """
    profile.check_joints(len(q_start))
    profile.check_joints(len(q_goal))
    return rest_to_rest(q_start, q_goal, profile.v_max, profile.a_max, profile.j_max, dt, law)


def _polynomial(
    coefficients: tuple[float, ...],
    peaks: tuple[float, float, float],
    length: float,
    bounds: Vector,
    dt: float,
) -> Matrix:
    v, a, j = _checked(length, bounds, dt)
    slowest = [length * peaks[0] / v, sqrt(length * peaks[1] / a)]
    if peaks[2] < inf:
        slowest.append(cbrt(length * peaks[2] / j))
    t = _instants(max(slowest), dt)
    total = float(t[-1])
    s = np.polynomial.Polynomial(coefficients)
    columns = [
        s.deriv(k)(t / total) * length / total**k if k else s(t / total) * length for k in range(3)
    ]
    return _ends(np.column_stack(columns), length)


def _instants(total: float, dt: float) -> Vector:
    """0, dt, ... up to the first multiple of dt that is not less than the total."""
    instants: Vector = np.arange(max(1, ceil(total / dt - _ROUNDING)) + 1.0) * dt
    return instants


def _ends(rows: Matrix, length: float) -> Matrix:
    """Set the first and the last sample to rest."""
    rows[0], rows[-1] = (0.0, 0.0, 0.0), (length, 0.0, 0.0)
    return rows


def _checked(length: float, bounds: Vector, dt: float) -> tuple[float, float, float]:
    numbers = {"length": length, "dt": dt}
    numbers |= dict(
        zip(("velocity bound", "acceleration bound", "jerk bound"), bounds, strict=True)
    )
    for name, value in numbers.items():
        if not 0.0 < value < inf and not (name == "jerk bound" and value == inf):
            raise InvalidValueError(name, value, "positive and finite")
    v, a, j = (float(bound) for bound in bounds)
    return v, a, j
