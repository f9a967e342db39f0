"""Refusals: why a motion cannot be planned, and the checks of a joint path against its limits."""

from typing import NamedTuple

import numpy as np
from mink import SE3
from scipy.interpolate import BSpline, PPoly

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import PlanError, RefusalReason, Rejection, Robo47Error
from robo47_qp.model.arm import Arm

AT_LIMIT = 1e-3
"""A joint this close to its limit is at it [rad or m]."""


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
        T_world_next: SE3 | None = None,
    ) -> None:
        """Tell where on the path and why."""
        super().__init__(f"the path fails {100 * fraction:.0f} % of the way: {explanation}")
        self.fraction = fraction
        self.reason = reason
        self.joint = joint
        self.q = None if q is None else q.copy()
        self.T_world_next = T_world_next


def shape_refused(waypoint: str, explanation: str) -> PlanError:
    """Return the error for waypoints that make no path."""
    rejection = Rejection(reason=RefusalReason.SHAPE, segment=waypoint, fraction=0.0)
    return PlanError(waypoint, explanation, rejection)


def path_refused(waypoint: str, error: PathError, time: float | None) -> PlanError:
    """Return the error for a path that cannot be followed, from `time` [s] on."""
    rejection = Rejection(
        reason=error.reason,
        segment=waypoint,
        fraction=float(error.fraction),
        time=time,
        joint=error.joint,
        q=None if error.q is None else tuple(error.q.tolist()),
        pose=None if error.T_world_next is None else tuple(error.T_world_next.wxyz_xyz.tolist()),
    )
    when = "" if time is None else f", {time:.2f} s from the start at full speed of the tool"
    return PlanError(waypoint, f"{error}{when}", rejection)


class Hit(NamedTuple):
    """Where a motion comes too close to something."""

    explanation: str
    """The bodies, their distance and the joint that moves them."""
    joint: str
    q: Vector
    """Configuration (n,) [rad]."""
    time: float
    """[s]"""
    fraction: float
    """Share of the motion before it, from 0 to 1."""


def collision_refused(waypoint: str, hit: Hit) -> PlanError:
    """Return the error for a motion to a waypoint that comes too close to something."""
    rejection = Rejection(
        reason=RefusalReason.COLLISION,
        segment=waypoint,
        fraction=hit.fraction,
        time=hit.time,
        joint=hit.joint,
        q=tuple(hit.q.tolist()),
    )
    return PlanError(waypoint, hit.explanation, rejection)


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
