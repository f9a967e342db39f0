"""Lower bound on the duration of a motion between two states at rest."""

from math import cbrt, inf, sqrt

import numpy as np

from robo47_qp.arrays import Matrix
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import MotionProfile
from robo47_qp.motion.paths.segments import PathProfile
from robo47_qp.motion.tool_motion import tool_steps


def least_time(distance: float, v_max: float, a_max: float, j_max: float) -> float:
    """Return the shortest time from rest to rest in one dimension [s].

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


def lower_bound(
    arm: Arm, q: Matrix, joints: MotionProfile, tool: PathProfile | None, straight: bool
) -> float:
    """Return a time below which no motion along a joint path keeps the bounds [s].

    The largest of the times that each bound alone requires: for the slowest joint from start to
    end, for the whole path at the largest speed that the joints allow at each point, and for the
    length and angle of the tool path. The tool's jerk bound counts on straight paths only: on
    curves, the speed along the path may change faster.

    Args:
        arm: The arm.
        q: The path, finely sampled, from rest to rest (N, n).
        joints: Bounds of the joints.
        tool: Those of the tool; None where it has none.
        straight: True where the tool goes straight and turns about one axis.
    """
    if len(q) == 1:
        return 0.0
    ways = np.abs(q[-1] - q[0])
    bounds = zip(ways, joints.v_max, joints.a_max, joints.j_max, strict=True)
    times = [least_time(*(float(x) for x in row)) for row in bounds]
    steps = np.abs(np.diff(q, axis=0)) / joints.v_max
    times.append(float(steps.max(axis=1).sum()))
    if tool is not None:
        for one in range(len(arm.robot.tools)):
            length, angle = np.linalg.norm(tool_steps(arm, q, one), axis=2).sum(axis=0)
            for way, (v, a, j) in ((length, tool.linear), (angle, tool.angular)):
                times.append(least_time(float(way), v, a, j if straight else inf))
    return max(times)
