"""Refusals: why a motion cannot be planned, and the checks of a joint path against its limits."""

from typing import NamedTuple

import numpy as np
from mink import SE3
from scipy.interpolate import BSpline, PPoly

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import RefusalReason, Rejection, Robo47Error
from robo47_qp.model.arm import Arm
from robo47_qp.model.tool_poses import Target

AT_LIMIT = 1e-3
"""A joint this close to its limit is at it [rad or m]."""


class Refusal(NamedTuple):
    """Why a motion cannot be planned: what `PlanError` takes after the name of the waypoint."""

    explanation: str
    rejection: Rejection


class PathError(Robo47Error):
    """A path that the arm cannot follow.

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
        T_world_next: Target | None = None,
    ) -> None:
        """Tell where on the path and why."""
        super().__init__(f"the path fails {100 * fraction:.0f} % of the way: {explanation}")
        self.fraction = fraction
        self.reason = reason
        self.joint = joint
        self.q = None if q is None else q.copy()
        self.T_world_next = T_world_next

    def refusal(self, time: float | None) -> Refusal:
        """Return the refusal of the motion, whose path fails at `time` [s] if that is known."""
        pose = None if self.T_world_next is None else _numbers(self.T_world_next)
        rejection = Rejection(
            reason=self.reason,
            fraction=float(self.fraction),
            time=time,
            joint=self.joint,
            q=None if self.q is None else tuple(self.q.tolist()),
            pose=None if pose is None else tuple(pose.tolist()),
        )
        when = "" if time is None else f", {time:.2f} s from the start at full speed of the tool"
        return Refusal(f"{self}{when}", rejection)


def _numbers(target: Target) -> Vector:
    """Return a pose as seven numbers, of several tools one after the other."""
    poses = [target] if isinstance(target, SE3) else list(target.values())
    return np.concatenate([pose.wxyz_xyz for pose in poses])


def check_limits(arm: Arm, q: Matrix, s: Vector | None = None) -> None:
    """Check that configurations on a path are within the joint limits.

    Args:
        arm: The arm.
        q: The configurations (N, n).
        s: Where on the path they are (N,) [-]; None spreads them evenly.

    Raises:
        PathError: One is outside.
    """
    outside = (q < arm.q_min) | (q > arm.q_max)
    if outside.any():
        row, joint = np.argwhere(outside)[0]
        name = arm.robot.joints[joint]
        at = row / len(outside) if s is None else float(s[row])
        raise PathError(at, f"{name} leaves its limits", RefusalReason.JOINT_LIMIT, name, q[row])


def check_spline_limits(arm: Arm, path: BSpline) -> None:
    """Check that a joint path is within the joint limits, between its knots too.

    Raises:
        PathError: It leaves them.
    """
    s = np.linspace(0.0, 1.0, 4 * len(path.c))
    q = path(s)
    room = np.minimum(q - arm.q_min, arm.q_max - q).min(axis=0)
    if (room < AT_LIMIT).any():
        # A joint at its limit may exceed it between two knots and return.
        turns = [_turning_points(path, joint) for joint in np.flatnonzero(room < AT_LIMIT)]
        s = np.sort(np.concatenate([s, *turns]))
        q = path(s)
    check_limits(arm, q, s)


def _turning_points(path: BSpline, joint: np.intp) -> Vector:
    """Return where on its path a joint reverses (N,) [-]."""
    slope = PPoly.from_spline(BSpline(path.t, path.c[:, joint], path.k)).derivative()
    s: Vector = slope.roots(discontinuity=False, extrapolate=False)
    return s[np.isfinite(s)]
