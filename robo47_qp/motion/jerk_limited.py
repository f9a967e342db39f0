"""Time-optimal motion from rest to rest under velocity, acceleration and jerk bounds.

Everything is computed here, by Ruckig's state-to-state planner (Berscheid and Kröger,
"Jerk-limited real-time trajectory generation with arbitrary target states", RSS 2021);
its waypoint planner calls a remote service and is not used.
"""

from typing import NamedTuple

import numpy as np
import ruckig

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import InvalidValueError


class Samples(NamedTuple):
    """Positions, velocities and accelerations at 0, dt, 2 dt, ...; each (N + 1, n)."""

    x: Matrix
    v: Matrix
    a: Matrix


def rest_to_rest(
    start: Vector, goal: Vector, v_max: Vector, a_max: Vector, j_max: Vector, dt: float
) -> Samples:
    """Move all coordinates together so that they start and arrive at the same time.

    Args:
        start: Where to start, at rest (n,).
        goal: Where to come to rest (n,).
        v_max: Bounds on the velocity (n,), positive.
        a_max: Bounds on the acceleration (n,), positive.
        j_max: Bounds on the jerk (n,), positive.
        dt: Time between samples [s].

    Returns:
        The samples; the duration is the shortest that is a multiple of dt, the last sample
        is the goal, at rest. The coordinates move in proportion: a straight line.

    Raises:
        InvalidValueError: Ruckig refuses the input, NaN or a bound that is not positive.
    """
    n = len(start)
    request = ruckig.InputParameter(n)
    request.synchronization = ruckig.Synchronization.Phase
    request.duration_discretization = ruckig.DurationDiscretization.Discrete
    request.current_position, request.target_position = start.tolist(), goal.tolist()
    request.max_velocity, request.max_acceleration = v_max.tolist(), a_max.tolist()
    request.max_jerk = j_max.tolist()
    plan = ruckig.Trajectory(n)
    try:
        ruckig.Ruckig(n, dt).calculate(request, plan)
    except ruckig.RuckigError as error:
        expected = "a rest-to-rest motion between finite positions with positive bounds"
        raise InvalidValueError("motion", str(error).splitlines()[0], expected) from error
    steps = round(plan.duration / dt)
    rows = np.array([plan.at_time(k * dt) for k in range(steps)])
    still = np.zeros(n)
    rows = np.concatenate([rows.reshape(steps, 3, n), [[goal, still, still]]])
    return Samples(rows[:, 0], rows[:, 1], rows[:, 2])
