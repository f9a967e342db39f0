"""Joint limits along a joint path."""

import numpy as np
from scipy.interpolate import BSpline, PPoly

from robo47_qp.arm import Arm
from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import Obstacle
from robo47_qp.motion.blocked import AT_LIMIT
from robo47_qp.motion.lin_error import LinError


def check_limits(arm: Arm, q: Matrix, s: Vector | None = None) -> None:
    """Refuse configurations (N, n) on a path outside the joint limits.

    Args:
        arm: The arm.
        q: The configurations.
        s: Where on the path they are (N,) [-]; None spreads them evenly.

    Raises:
        LinError: One is outside.
    """
    outside = (q < arm.q_min) | (q > arm.q_max)
    if outside.any():
        row, joint = np.argwhere(outside)[0]
        name = arm.robot.joints[joint]
        at = row / len(outside) if s is None else float(s[row])
        raise LinError(at, f"{name} leaves its limits", Obstacle.JOINT_LIMIT, name, q[row])


def check_all_along(arm: Arm, path: BSpline) -> None:
    """Refuse a path that leaves the joint limits, between samples, too.

    Raises:
        LinError: It does.
    """
    s = np.linspace(0.0, 1.0, 4 * len(path.c))
    q = path(s)
    room = np.minimum(q - arm.q_min, arm.q_max - q).min(axis=0)
    if (room < AT_LIMIT).any():
        # A joint at its limit may swing over it between two knots, and back.
        turns = [_turns(path, joint) for joint in np.flatnonzero(room < AT_LIMIT)]
        s = np.sort(np.concatenate([s, *turns]))
        q = path(s)
    check_limits(arm, q, s)


def _turns(path: BSpline, joint: np.intp) -> Vector:
    """Where on its path a joint turns back (N,) [-]."""
    slope = PPoly.from_spline(BSpline(path.t, path.c[:, joint], path.k)).derivative()
    s: Vector = slope.roots(discontinuity=False, extrapolate=False)
    return s[np.isfinite(s)]
