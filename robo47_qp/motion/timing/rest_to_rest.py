"""Motion from rest to rest on a straight line, several coordinates together."""

import numpy as np

from robo47_qp.arrays import Vector
from robo47_qp.model.robot import MotionProfile
from robo47_qp.motion.timing.state_to_state import check_motion
from robo47_qp.motion.timing.time_law import S_CURVE, TimeLaw
from robo47_qp.motion.trajectory import Trajectory

_NOTHING = 1e-9
"""Distance below the resolution of Ruckig, which is made one step; and share of the distance
below which a coordinate limits nothing."""


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
        InvalidValueError: A configuration is not finite.
    """
    return rest_to_rest(q_start, q_goal, profile.v_max, profile.a_max, profile.j_max, dt, law)
