"""Joint limits along a joint path."""

import numpy as np
from mink import SE3
from scipy.interpolate import BSpline, PPoly

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import RefusalReason, Robo47Error
from robo47_qp.model.arm import Arm
from robo47_qp.motion.following.small_steps import AT_LIMIT


class LinError(Robo47Error):
    """A tool path that the arm cannot follow.

    Attributes:
        fraction: Where on the path, 0 at its start and 1 at its end.
        reason: Why it cannot be followed.
        joint: The joint concerned, where there is one.
        q: The last configuration before, where there is one.
        T_world_next: The pose that is not reached from there, where there is one.
    """

    def __init__(
        self,
        fraction: float,
        explanation: str,
        reason: RefusalReason,
        joint: str | None = None,
        q: Vector | None = None,
        T_world_next: SE3 | None = None,
    ) -> None:
        """Tell where on the path and why."""
        super().__init__(f"the path fails {100 * fraction:.0f} % of the way: {explanation}")
        self.fraction = fraction
        self.reason = reason
        self.joint = joint
        self.q = None if q is None else q.copy()
        self.T_world_next = T_world_next


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
        raise LinError(at, f"{name} leaves its limits", RefusalReason.JOINT_LIMIT, name, q[row])


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
