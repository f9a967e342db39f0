"""Lower bound: the time that no motion between two states at rest can beat."""

from math import cbrt, sqrt

import numpy as np

from robo47_qp.arrays import Matrix
from robo47_qp.robot import MotionProfile


def least_time(distance: float, v_max: float, a_max: float, j_max: float) -> float:
    """Time-optimal from rest to rest in one dimension [s].

    The cases of the profile with up to seven phases of constant jerk (Biagiotti and Melchiorri,
    Trajectory Planning for Automatic Machines and Robots, 2008, section 3.4).

    Args:
        distance: At least 0 [rad or m].
        v_max: Bound on the speed.
        a_max: Bound on the acceleration.
        j_max: Bound on the jerk; may be infinite.
    """
    if distance == 0.0:
        return 0.0
    a = min(a_max, sqrt(v_max * j_max))
    onset = a / j_max
    rise = v_max / a + onset
    if distance >= v_max * rise:
        return distance / v_max + rise
    if distance >= 2.0 * a_max * (a_max / j_max) ** 2:
        onset = a_max / j_max
        return onset + sqrt(onset**2 + 4.0 * distance / a_max)
    return 4.0 * cbrt(distance / (2.0 * j_max))


def lower_bound(q: Matrix, joints: MotionProfile) -> float:
    """Time below which no motion along a joint path keeps the bounds of the joints [s].

    The larger of two bounds: the slowest joint alone, from start to end of the path, and the
    whole path at the largest speed that the joints allow at each place. It is reached by a
    PTP motion; what bends on the way takes longer.

    Args:
        q: The path, finely sampled, from rest to rest (N, n).
        joints: Bounds of the joints.
    """
    ways = np.abs(q[-1] - q[0])
    bounds = zip(ways, joints.v_max, joints.a_max, joints.j_max, strict=True)
    alone = max(least_time(*(float(x) for x in row)) for row in bounds)
    steps = np.abs(np.diff(q, axis=0)) / joints.v_max
    return max(alone, float(steps.max(axis=1).sum()) if len(steps) else 0.0)
