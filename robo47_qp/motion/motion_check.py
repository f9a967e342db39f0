"""Motion check: planned motions and refusals looked at a second time, by other means."""

from collections.abc import Sequence

import numpy as np
from mink import SE3

from robo47_qp.arm import Arm
from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import Obstacle, PlanError, Rejection
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.qp import QpIk
from robo47_qp.ik.stall import Stall
from robo47_qp.motion.chain import tool_target
from robo47_qp.motion.planner import Leg
from robo47_qp.robot import MotionProfile
from robo47_qp.waypoint import Motion, Waypoint

_SLACK = 1e-6
"""Relative slack for rounding in differences."""
_JUMP = 0.3
"""A configuration that is closer than this is on the same branch [rad or m]."""
_AT_LIMIT = 1e-3
"""A joint that slides along its limit is this close to it [rad or m]."""
_NEWTON = 20
_H = 1e-6
"""Half the width of differences [rad or m]."""
_SINGULAR = 0.05
"""A refusal for a singularity must show a singular value below [m and rad]."""


def broken(arm: Arm, legs: Sequence[Leg], profile: MotionProfile) -> list[str]:
    """Promises that a motion breaks, by its samples and by differences of its positions alone.

    Args:
        arm: The arm.
        legs: A motion from rest to rest.
        profile: The bounds that it was to keep.
    """
    parts = [leg.trajectory for leg in legs]
    q = np.vstack([parts[0].q[:1], *(part.q[1:] for part in parts)])
    v = np.vstack([parts[0].v[:1], *(part.v[1:] for part in parts)])
    a = np.vstack([parts[0].a[:1], *(part.a[1:] for part in parts)])
    dt, found = parts[0].dt, []
    if (q < arm.q_min).any() or (q > arm.q_max).any():
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
    # The positions tell the truth of velocity and acceleration: trapezoidal sums to order dt².
    if np.abs(np.diff(q, axis=0) / dt - 0.5 * (v[1:] + v[:-1])).max() > profile.j_max.max() * dt**2:
        found.append("velocities are not those of the positions")
    if np.abs(np.diff(v, axis=0) / dt - 0.5 * (a[1:] + a[:-1])).max() > profile.j_max.max() * dt:
        found.append("accelerations are not those of the velocities")
    if np.abs([v[0], v[-1], a[0], a[-1]]).max() > 1e-9:
        found.append("it does not start and end at rest")
    return found


def confirmed(
    arm: Arm, q_start: Vector, waypoints: Sequence[Waypoint], error: PlanError
) -> str | None:
    """What speaks against a refusal; None where its reason holds.

    Args:
        arm: The arm.
        q_start: Where the motion was to start (n,) [rad].
        waypoints: What was asked for.
        error: The refusal.
    """
    found = error.rejection
    named = next((w for w in waypoints if w.name == error.waypoint), None)
    if named is None:
        return f"no waypoint is called {error.waypoint!r}"
    if found is None:
        # The pose itself: another solver must not reach it either.
        ik = MultiStart(solver=QpIk(max_iterations=30, stall=Stall()))
        reached = ik.solve(arm, tool_target(arm, named), arm.home)
        return "the pose is reached" if reached.converged else None
    if found.obstacle is Obstacle.SHAPE:
        return None if _no_shape(arm, q_start, waypoints) else "the shape seems to be one"
    return _unfounded(arm, found)


def _unfounded(arm: Arm, found: Rejection) -> str | None:
    if found.q is None:
        return "no configuration is told"
    q = np.array(found.q)
    if found.obstacle is Obstacle.JOINT_LIMIT:
        return _within_limits(arm, found, q)
    if found.obstacle is Obstacle.SINGULARITY:
        least = float(np.linalg.svd(_slopes(arm, q), compute_uv=False)[-1])
        return None if least < _SINGULAR else f"the least gain is {least:.3f}"
    if found.obstacle in (Obstacle.REACH, Obstacle.BRANCH) and found.pose is not None:
        ik = MultiStart(solver=QpIk(max_iterations=30, stall=Stall()))
        reached = ik.solve(arm, SE3(np.array(found.pose)), q)
        if reached.converged != (found.obstacle is Obstacle.BRANCH):
            return "the pose is reached" if reached.converged else "the pose is not reached"
        near = bool(np.abs(reached.q - q).max() < _JUMP)
        return "it is reached nearby" if reached.converged and near else None
    return f"nothing here can confirm {found.obstacle.value}"


def _within_limits(arm: Arm, found: Rejection, q: Vector) -> str | None:
    """Newton's method without limits must lead the named joint out of them."""
    if found.joint not in arm.robot.joints:
        return f"no joint is called {found.joint}"
    i = arm.robot.joints.index(found.joint)
    for _ in range(_NEWTON if found.pose is not None else 0):
        way = arm.way_to(SE3(np.array(found.pose)), q)
        q = q + np.linalg.lstsq(_slopes(arm, q), way, rcond=1e-6)[0]
    margin = min(q[i] - arm.q_min[i], arm.q_max[i] - q[i])
    least = _AT_LIMIT if found.pose is None else 0.0
    return None if margin < least else f"{found.joint} stays {margin:.3f} inside its limits"


def _slopes(arm: Arm, q: Vector) -> Matrix:
    """The tool's Jacobian in its own frame, by differences of poses (6, n)."""
    columns = [
        (arm.way_to(arm.pose(q + _H * e), q) - arm.way_to(arm.pose(q - _H * e), q)) / (2.0 * _H)
        for e in np.eye(arm.n)
    ]
    return np.array(columns).T


def _no_shape(arm: Arm, q_start: Vector, waypoints: Sequence[Waypoint]) -> bool:
    """True where blends take more than there is, or three points of an arc lie on a line."""
    points = [arm.pose(q_start).translation()]
    for waypoint in waypoints:
        points.append(tool_target(arm, waypoint).translation())
    for i, waypoint in enumerate(waypoints):
        length = float(np.linalg.norm(points[i + 1] - points[i]))
        before = waypoints[i - 1].blend if i else 0.0
        if waypoint.motion is not Motion.CIRC and before + waypoint.blend > 0.9 * length:
            return True
    return False
