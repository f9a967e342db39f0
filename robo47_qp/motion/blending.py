"""Blending: corners are cut where that saves time; where a stop is faster, the arm stops."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import inf
from typing import TypeVar

import numpy as np
from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.errors import PlanError
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import MotionProfile
from robo47_qp.motion.continuous import PacedProfile
from robo47_qp.motion.paths.arc import Arc
from robo47_qp.motion.paths.blended import BlendError
from robo47_qp.motion.paths.speed_limits import PathProfile
from robo47_qp.motion.ptp import plan_ptp
from robo47_qp.motion.route import STILL, misshapen, segment
from robo47_qp.motion.shortcut import Corner, cut_corners
from robo47_qp.motion.timing.lower_bound import least_time
from robo47_qp.motion.timing.time_law import TimeLaw
from robo47_qp.motion.trajectory import Trajectory
from robo47_qp.motion.waypoint import Motion, Waypoint

Plan = TypeVar("Plan")


def quickest(
    corners: Sequence[int],
    plan: Callable[[frozenset[int]], Plan],
    duration: Callable[[Plan], float],
    with_stops: float,
) -> Plan:
    """A plan that takes no longer than one that stops at every corner.

    Where the plan without stops may be slower, the one that stops at all corners is made too.
    Where that is quicker, each corner in turn is blended again if it saves time.

    Args:
        corners: Where the motion may stop.
        plan: Plans with stops at some of the corners.
        duration: Of a plan [s].
        with_stops: What the motion takes at least with all the stops [s].

    Raises:
        PlanError: There is no plan without stops.
    """
    best = plan(frozenset())
    if not corners or duration(best) <= with_stops:
        return best
    stops = frozenset(corners)
    try:
        stopping = plan(stops)
    except PlanError:
        return best
    if duration(best) <= duration(stopping):
        return best
    best = stopping
    for corner in corners if len(corners) > 1 else ():
        other = stops - {corner}
        try:
            tried = plan(other)
        except PlanError:
            continue
        if duration(tried) < duration(best):
            best, stops = tried, other
    return best


def blends_joints(run: Sequence[Waypoint]) -> bool:
    """True for PTP motions that are blended into each other."""
    return all(w.motion is Motion.PTP for w in run) and all(w.blend for w in run[:-1])


def parted(run: Sequence[Waypoint], stops: frozenset[int]) -> list[range]:
    """Numbers of the waypoints of each motion when a run stops at some of them."""
    ends = [-1, *sorted(stops), len(run) - 1]
    return [range(first + 1, last + 1) for first, last in pairwise(ends)]


def least_with_stops(
    poses: Sequence[SE3],
    q: Sequence[Vector],
    run: Sequence[Waypoint],
    profile: PacedProfile,
    tool: PathProfile,
) -> float:
    """Time that a run takes at least if it stops at every waypoint [s].

    Args:
        poses: T_world_tcp at its start and at each waypoint.
        q: Configurations there; used for PTP motions alone.
        run: The waypoints.
        profile: How fast the joints may go.
        tool: Bounds of the tool in LIN and CIRC motions.
    """
    total = 0.0
    for waypoint, (a, b), (q_a, q_b) in zip(run, pairwise(poses), pairwise(q), strict=True):
        pace = profile.pace * waypoint.pace
        if waypoint.motion is Motion.PTP:
            joints = profile.joints.slowed(pace)
            bounds = zip(np.abs(q_b - q_a), joints.v_max, joints.a_max, joints.j_max, strict=True)
            total += max(least_time(*(float(x) for x in row)) for row in bounds)
            continue
        way = segment(waypoint, a, b)
        v, acc, jerk = (float(x) for x in tool.along(way.length, way.angle, pace))
        # On an arc the jerk of the tool is not that of its way.
        total += least_time(1.0, v, acc, inf if isinstance(way, Arc) else jerk)
    return total


def cut_ptp(
    arm: Arm,
    run: Sequence[Waypoint],
    q: Sequence[Vector],
    profile: PacedProfile,
    law: TimeLaw,
    dt: float,
) -> tuple[Trajectory, list[int]]:
    """PTP motions with their corners cut; see `cut_corners`.

    Args:
        arm: The arm.
        run: The waypoints, all but the last blended.
        q: Configurations at the start and at each waypoint.
        profile: How fast the joints may go; on a cut, as fast as on the faster of both sides.
        law: How each motion runs.
        dt: Time between samples [s].

    Raises:
        PlanError: A waypoint is where the motion already is, or a blend does not fit.
    """
    profiles = [profile.joints.slowed(profile.pace * waypoint.pace) for waypoint in run]
    for waypoint, (a, b) in zip(run, pairwise(q), strict=True):
        if (np.abs(b - a) / profile.joints.v_max).max() < STILL:
            raise misshapen(waypoint, "it is where the motion already is")
    motions = [
        plan_ptp(a, b, profile, dt, law)
        for (a, b), profile in zip(pairwise(q), profiles, strict=True)
    ]
    corners = [
        Corner(waypoint.blend, _either(a, b))
        for waypoint, (a, b) in zip(run[:-1], pairwise(profiles), strict=True)
    ]
    try:
        return cut_corners(arm, motions, corners)
    except BlendError as error:
        raise misshapen(run[error.segment], str(error)) from error


def _either(a: MotionProfile, b: MotionProfile) -> MotionProfile:
    """What at least one of two profiles allows."""
    return MotionProfile(
        v_max=np.maximum(a.v_max, b.v_max),
        a_max=np.maximum(a.a_max, b.a_max),
        j_max=np.maximum(a.j_max, b.j_max),
    )
