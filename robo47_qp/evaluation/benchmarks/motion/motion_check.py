"""Motion check: limits and path of a planned motion, from its samples and their differences."""

from collections.abc import Sequence

import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.evaluation.benchmarks.motion.commanded_path import CommandedPath
from robo47_qp.evaluation.benchmarks.motion.reference_kinematics import ReferenceKinematics
from robo47_qp.model.robot import MotionProfile
from robo47_qp.model.tool_poses import one_pose
from robo47_qp.motion.planner import Leg
from robo47_qp.motion.waypoint import Place, Waypoint

_SLACK = 1e-6
"""Relative slack for rounding in differences."""
_CLOSE = 1e-5
"""Distance within which a waypoint counts as reached [m and rad]."""
_EVERY = 5
"""Every so many samples the tool position is checked."""


def violations(look: ReferenceKinematics, legs: Sequence[Leg], profile: MotionProfile) -> list[str]:
    """Return the limits that a motion violates, by its samples and differences of its positions.

    Args:
        look: Kinematics of the robot.
        legs: A motion from rest to rest.
        profile: Limits of speed, acceleration and jerk.
    """
    parts = [leg.trajectory for leg in legs]
    q = np.vstack([parts[0].q[:1], *(part.q[1:] for part in parts)])
    v = np.vstack([parts[0].v[:1], *(part.v[1:] for part in parts)])
    a = np.vstack([parts[0].a[:1], *(part.a[1:] for part in parts)])
    dt, found = parts[0].dt, []
    if (q < look.q_min).any() or (q > look.q_max).any():
        found.append("a joint leaves its limits")
    still = np.repeat(q[:1], 3, axis=0), np.repeat(q[-1:], 3, axis=0)
    whole = np.vstack([still[0], q, still[1]])
    bounds = (profile.v_max, profile.a_max, profile.j_max)
    stated = (v, a, np.diff(a, axis=0) / dt)
    for order, (name, bound, values) in enumerate(
        zip(("speed", "acceleration", "jerk"), bounds, stated, strict=True), start=1
    ):
        seen = np.abs(np.diff(whole, order, axis=0)) / dt**order
        rounding = 1e-15 * 2**order / dt**order
        if (seen > bound * (1.0 + _SLACK) + rounding).any():
            found.append(f"{name} by differences is {(seen / bound).max():.6f} of its bound")
        if (np.abs(values) > bound * (1.0 + _SLACK)).any():
            found.append(f"{name} is {(np.abs(values) / bound).max():.6f} of its bound")
    # Velocities and accelerations must integrate to the positions: trapezoidal rule, order dt².
    if np.abs(np.diff(q, axis=0) / dt - 0.5 * (v[1:] + v[:-1])).max() > profile.j_max.max() * dt**2:
        found.append("velocities are not those of the positions")
    if np.abs(np.diff(v, axis=0) / dt - 0.5 * (a[1:] + a[:-1])).max() > profile.j_max.max() * dt:
        found.append("accelerations are not those of the velocities")
    if np.abs([v[0], v[-1], a[0], a[-1]]).max() > 1e-9:
        found.append("it does not start and end at rest")
    return found


def path_deviations(
    look: ReferenceKinematics, legs: Sequence[Leg], q_start: Vector, waypoints: Sequence[Waypoint]
) -> tuple[list[str], float]:
    """Return the waypoints that the tool misses, and its largest distance from the path [m].

    Args:
        look: Kinematics of the robot.
        legs: The motion.
        q_start: Commanded start (n,) [rad].
        waypoints: Commanded waypoints.
    """
    path = CommandedPath(look.pose(q_start), waypoints, look.pose(look.home))
    q = np.vstack([legs[0].trajectory.q[:1], *(leg.trajectory.q[1:] for leg in legs)])
    found = []
    if not np.array_equal(q[0], q_start):
        found.append("it does not start where it should")
    target = waypoints[-1].target
    if not isinstance(target, Place):
        away = np.abs(look.away(q[-1], one_pose(target).wxyz_xyz)).max()
        if away > _CLOSE:
            found.append(f"the goal is missed by {away:.6f}")
    ends = np.array([look.position(leg.trajectory.q[-1]) for leg in legs])
    tool: Matrix = np.array([look.position(row) for row in q[::_EVERY]])
    points = np.vstack([tool, ends])
    step = float(np.linalg.norm(np.diff(tool, axis=0), axis=1).max(initial=0.0))
    missed = path.missed(points)
    if missed.max() > _CLOSE + step:
        found.append(f"a waypoint is passed {missed.max():.6f} m away")
    return found, float(path.distance(points).max()) if path.specified else 0.0
