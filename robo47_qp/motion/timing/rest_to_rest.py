"""Motion from rest to rest: time-optimal on a straight line of the joint space, by Ruckig.

Berscheid and Kröger, "Jerk-limited real-time trajectory generation with arbitrary target
states", RSS 2021. Everything is computed here: Ruckig's waypoint planner, which calls a remote
service, is not used.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import ruckig

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import InvalidValueError

_NOTHING = 1e-9
"""A way so short that it is one step, below what Ruckig resolves; and a share of a way so
small that it bounds nothing."""


class Samples(NamedTuple):
    """Positions, velocities and accelerations at 0, dt, 2 dt, ...; each (N + 1, n)."""

    x: Matrix
    v: Matrix
    a: Matrix


def s_curve(length: float, bounds: Vector, dt: float) -> Matrix:
    """Move one coordinate from 0 to a length.

    Args:
        length: Positive.
        bounds: On velocity, acceleration and jerk (3,), positive.
        dt: Time between samples [s].

    Returns:
        Position, velocity and acceleration at 0, dt, 2 dt, ... (N + 1, 3); the duration is the
        shortest that is a multiple of dt, the last sample is the goal, at rest.

    Raises:
        InvalidValueError: A number is not finite, a bound or dt is not positive, or Ruckig
            finds no motion.
    """
    v_max, a_max, j_max = bounds[:, None]
    check_motion(np.zeros(1), np.array([length]), v_max, a_max, j_max, dt)
    request = ruckig.InputParameter(1)
    request.duration_discretization = ruckig.DurationDiscretization.Discrete
    request.current_position, request.target_position = [0.0], [length]
    request.max_velocity = [float(v_max[0])]
    request.max_acceleration = [float(a_max[0])]
    request.max_jerk = [float(j_max[0])]
    plan = ruckig.Trajectory(1)
    try:
        ruckig.Ruckig(1, dt).calculate(request, plan)
    except ruckig.RuckigError as error:
        expected = "one that Ruckig can plan"
        raise InvalidValueError("motion", f"0 to {length} ({error})", expected) from error
    steps = round(plan.duration / dt)
    rows = np.array([plan.at_time(k * dt) for k in range(steps)]).reshape(steps, 3)
    return np.vstack([rows, [length, 0.0, 0.0]])


Run = Callable[[float, Vector, float], Matrix]
"""Moves one coordinate as `s_curve` does, within those of the bounds that it knows."""


def rest_to_rest(
    start: Vector,
    goal: Vector,
    v_max: Vector,
    a_max: Vector,
    j_max: Vector,
    dt: float,
    run: Run = s_curve,
) -> Samples:
    """Move on the straight line between two points, each coordinate within its bounds.

    Args:
        start: Where to start, at rest (n,).
        goal: Where to come to rest (n,).
        v_max: Bounds on the velocity (n,), positive.
        a_max: Bounds on the acceleration (n,), positive.
        j_max: Bounds on the jerk (n,), positive.
        dt: Time between samples [s].
        run: How one coordinate is moved.

    Returns:
        The samples; with `s_curve` the duration is the shortest on the line that is a
        multiple of dt, the last sample is the goal, at rest.

    Raises:
        InvalidValueError: A position is not finite, a bound or dt is not positive.
    """
    check_motion(start, goal, v_max, a_max, j_max, dt)
    way = goal - start
    length = float(np.abs(way).max())
    if length < _NOTHING:
        x = np.array([start, goal] if length > 0.0 else [goal])
        return Samples(x, np.zeros_like(x), np.zeros_like(x))
    way = way / length
    moving = np.abs(way) > _NOTHING
    share = np.abs(way[moving])
    bounds = np.array([float((b[moving] / share).min()) for b in (v_max, a_max, j_max)])
    s, ds, dds = run(length, bounds, dt).T[:, :, None]
    x = start + s * way
    x[-1] = goal
    return Samples(x, ds * way, dds * way)


def check_motion(
    start: Vector, goal: Vector, v_max: Vector, a_max: Vector, j_max: Vector, dt: float
) -> None:
    """Refuse numbers that make no motion.

    Raises:
        InvalidValueError: A position is not finite, a bound or dt is not positive.
    """
    for name, point in (("start position", start), ("goal position", goal)):
        if not np.isfinite(point).all():
            raise InvalidValueError(name, point.tolist(), "finite")
    bounds = {"velocity": v_max, "acceleration": a_max, "jerk": j_max}
    for name, bound in bounds.items():
        if not (bound > 0.0).all() or np.isnan(bound).any():
            raise InvalidValueError(f"{name} bound", bound.tolist(), "positive")
    if not (np.isfinite(dt) and dt > 0.0):
        raise InvalidValueError("dt", dt, "positive and finite [s]")
