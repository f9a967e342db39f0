"""Route: the curve of the tool that waypoints ask for, or why there is none."""

from collections.abc import Sequence
from itertools import pairwise

from mink import SE3

from robo47_qp.errors import (
    InvalidValueError,
    PlanError,
    RefusalReason,
    Rejection,
)
from robo47_qp.motion.following.limits import LinError
from robo47_qp.motion.paths.curves import BlendError, Through, ToolCurve
from robo47_qp.motion.paths.segments import Arc, Line, PathProfile, arc_about, arc_through
from robo47_qp.motion.waypoint import Motion, Place, Waypoint

Curve = ToolCurve | Through
STILL = 1e-6
"""A way that takes less at full speed is none [s]."""


def segment(waypoint: Waypoint, start: SE3, goal: SE3) -> Line | Arc:
    """The way of the tool to a LIN or CIRC waypoint.

    Args:
        waypoint: The waypoint.
        start: T_world_tcp where the way begins.
        goal: T_world_tcp at the waypoint.

    Raises:
        PlanError: The points of an arc do not make one.
    """
    try:
        if waypoint.through is not None:
            return arc_through(start, goal, waypoint.through)
        if waypoint.centre is not None:
            return arc_about(start, goal, waypoint.centre)
    except InvalidValueError as error:
        raise misshapen(waypoint, str(error)) from error
    return Line(start, goal)


def tool_curve(waypoints: Sequence[Waypoint], start: SE3, home: SE3, profile: PathProfile) -> Curve:
    """The curve through LIN and CIRC waypoints, of which the last may be rested at.

    Args:
        waypoints: At least one.
        start: T_world_tcp where it begins.
        home: T_world_tcp at home.
        profile: Bounds of the tool, which weigh moving against turning.

    Raises:
        PlanError: The waypoints do not make one curve.
    """
    targets = [start]
    for waypoint in waypoints:
        targets.append(home if isinstance(waypoint.target, Place) else waypoint.target)
    segments = [segment(w, a, b) for w, (a, b) in zip(waypoints, pairwise(targets), strict=True)]
    for waypoint, one in zip(waypoints, segments, strict=True):
        if profile.least_time(one.length, one.angle) < STILL:
            raise misshapen(waypoint, "it is where the motion already is")
    inner = waypoints[:-1]
    if inner and not any(waypoint.blend for waypoint in inner):
        bent = [waypoint for waypoint in waypoints if waypoint.motion is Motion.CIRC]
        if bent:
            raise misshapen(bent[0], "an arc goes on without a stop only by a blend")
        return Through(targets, profile)
    exact = [waypoint for waypoint in inner if not waypoint.blend]
    if exact:
        raise misshapen(exact[0], "blends and points to pass exactly do not go together")
    try:
        return ToolCurve(segments, [waypoint.blend for waypoint in inner], profile)
    except BlendError as error:
        raise misshapen(waypoints[error.segment], str(error)) from error


def misshapen(waypoint: Waypoint, explanation: str) -> PlanError:
    """What was asked for is no path."""
    rejection = Rejection(reason=RefusalReason.SHAPE, segment=waypoint.name, fraction=0.0)
    return PlanError(waypoint.name, explanation, rejection)


def refused(waypoint: Waypoint, error: LinError, time: float | None) -> PlanError:
    """A path that cannot be followed; time is when it is met [s]."""
    rejection = Rejection(
        reason=error.reason,
        segment=waypoint.name,
        fraction=float(error.fraction),
        time=time,
        joint=error.joint,
        q=None if error.q is None else tuple(error.q.tolist()),
        pose=None if error.T_world_next is None else tuple(error.T_world_next.wxyz_xyz.tolist()),
    )
    when = "" if time is None else f", {time:.2f} s from the start at full speed of the tool"
    return PlanError(waypoint.name, f"{error}{when}", rejection)
