"""Blending: corners are cut where that saves time; where a stop is faster, the arm stops."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import inf
from typing import NamedTuple, TypeVar

import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import NO_PATH, InvalidValueError, PlanError
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import MotionProfile
from robo47_qp.motion.paths.curves import BlendError
from robo47_qp.motion.paths.segments import PathProfile
from robo47_qp.motion.request import STILL, Request
from robo47_qp.motion.timing.lower_bound import least_time
from robo47_qp.motion.timing.rest_to_rest import TimeLaw, plan_ptp
from robo47_qp.motion.timing.state_to_state import to_state
from robo47_qp.motion.tool_motion import tool_places
from robo47_qp.motion.trajectory import Trajectory, joined

Plan = TypeVar("Plan")


def quickest(
    corners: Sequence[int],
    plan: Callable[[frozenset[int]], Plan],
    duration: Callable[[Plan], float],
    with_stops: float,
) -> Plan:
    """Return a plan that takes no longer than one that stops at every corner.

    Where the plan without stops may be slower, the one that stops at all corners is made too.
    Where that is quicker, each corner in turn is blended again if it saves time.

    Args:
        corners: Where the motion may stop.
        plan: Plans with stops at some of the corners.
        duration: Gives the duration of a plan [s].
        with_stops: Shortest possible duration with a stop at every corner [s].

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


def blends_joints(requests: Sequence[Request]) -> bool:
    """Return whether all are motions of the joints that are blended into each other."""
    return all(one.path is None for one in requests) and all(one.blend for one in requests[:-1])


def least_with_stops(
    arm: Arm,
    q_start: Vector,
    requests: Sequence[Request],
    profile: MotionProfile,
    tool: PathProfile,
) -> float:
    """Return the time that a run takes at least if it stops at every waypoint [s].

    Args:
        arm: The arm.
        q_start: Configuration at its start (n,) [rad].
        requests: Its motions, each with a configuration to reach.
        profile: Bounds of the joints at full pace.
        tool: Bounds of the tool where its path is prescribed.
    """
    pose = arm.pose_as(requests[0].T_world_goal, q_start)
    total, q = 0.0, q_start
    for request in requests:
        q_goal = q if request.goal is None else request.goal.q
        if request.path is None:
            joints = profile.slowed(request.pace)
            bounds = zip(np.abs(q_goal - q), joints.v_max, joints.a_max, joints.j_max, strict=True)
            total += max(least_time(*(float(x) for x in row)) for row in bounds)
        else:
            path = request.path(pose)
            v, a, j = (float(x) for x in tool.along(path.length, path.angle, request.pace))
            # On an arc the jerk of the tool is not that of its path parameter.
            total += least_time(1.0, v, a, j if request.straight else inf)
        q, pose = q_goal, request.T_world_goal
    return total


def cut_ptp(
    arm: Arm,
    q_start: Vector,
    requests: Sequence[Request],
    profile: MotionProfile,
    law: TimeLaw,
    dt: float,
) -> tuple[Trajectory, list[int]]:
    """Plan motions of the joints with their corners cut; see `cut_corners`.

    Args:
        arm: The arm.
        q_start: Configuration at the start (n,) [rad].
        requests: The motions, all but the last blended.
        profile: Bounds of the joints at full pace; on a cut, the pace is the faster of both sides.
        law: How each motion runs.
        dt: Time between samples [s].

    Raises:
        PlanError: A waypoint is where the motion already is, or a blend does not fit.
    """
    profiles = [profile.slowed(request.pace) for request in requests]
    q = [q_start, *(request.goal.q for request in requests if request.goal is not None)]
    for request, (a, b) in zip(requests, pairwise(q), strict=True):
        if (np.abs(b - a) / profile.v_max).max() < STILL:
            raise PlanError(request.name, "it is where the motion already is", NO_PATH)
    motions = [
        plan_ptp(a, b, profile, dt, law)
        for (a, b), profile in zip(pairwise(q), profiles, strict=True)
    ]
    corners = [
        Corner(request.blend, _either(a, b))
        for request, (a, b) in zip(requests[:-1], pairwise(profiles), strict=True)
    ]
    try:
        return cut_corners(arm, motions, corners)
    except BlendError as error:
        raise PlanError(requests[error.segment].name, str(error), NO_PATH) from error


def _either(a: MotionProfile, b: MotionProfile) -> MotionProfile:
    """Return the larger bounds of two profiles."""
    return MotionProfile(
        v_max=np.maximum(a.v_max, b.v_max),
        a_max=np.maximum(a.a_max, b.a_max),
        j_max=np.maximum(a.j_max, b.j_max),
    )


_SHARES = np.linspace(1.0, 0.1, 10)
"""Shares of the path inside the radius that a cut may replace, in the order of trial."""
_ROUNDING = 1.0 + 1e-9
_MISSED = 1e-6
"""Share of the largest jerk that the miss of an end may show as in differences of positions: of
some states Ruckig misses the position by up to 1e-8 rad."""


class Corner(NamedTuple):
    """A corner between two motions."""

    radius: float
    """Largest distance of the tool from the waypoint on the cut [m]."""
    bounds: MotionProfile
    """Bounds of the joints on the cut; a jerk may be infinite."""


class _Cut(NamedTuple):
    left: int
    """Periods of the first motion that are left out at its end."""
    zone: Trajectory
    skipped: int
    """Periods of the second motion that are left out at its start."""


def cut_corners(
    arm: Arm, motions: Sequence[Trajectory], corners: Sequence[Corner]
) -> tuple[Trajectory, list[int]]:
    """Join motions into one; return it and the samples at which it passes the waypoints between.

    Within the radius of a corner the joints go in the least time from a state of the first
    motion to a state of the second, with continuous velocity and acceleration (Ruckig). Where
    that saves no time, the arm stops at the corner.

    Args:
        arm: The arm.
        motions: Each from rest where the one before it ends, to rest.
        corners: One less than motions.

    Raises:
        BlendError: The tool does not leave a radius on the way to the next waypoint.
    """
    _check_room(arm, motions, corners)
    whole, passes, used = motions[0], list[int](), 0
    for i, (motion, corner) in enumerate(zip(motions[1:], corners, strict=True)):
        cut = _cut(arm, (whole, motion), motions[i].steps - used, corner)
        start = whole.steps - cut.left
        zone = np.abs(cut.zone.q - motion.q[0]).max(axis=1)
        passes.append(start + int(zone.argmin()))
        parts = whole.part(0, start), cut.zone, motion.part(cut.skipped, motion.steps)
        whole, used = joined(parts), cut.skipped
    return whole, passes


def _check_room(arm: Arm, motions: Sequence[Trajectory], corners: Sequence[Corner]) -> None:
    for i, corner in enumerate(corners):
        place = arm.pose(motions[i].q[-1]).translation()
        for k, row in ((i, 0), (i + 1, -1)):
            far = np.linalg.norm(arm.pose(motions[k].q[row]).translation() - place)
            if far <= corner.radius:
                reason = f"it ends within the blend radius of {1e3 * corner.radius:.1f} mm"
                raise BlendError(k, reason)


def _cut(arm: Arm, pair: tuple[Trajectory, Trajectory], free: int, corner: Corner) -> _Cut:
    """Return the best cut; it may replace `free` periods at the end of the first motion."""
    before, after = pair
    place = arm.pose(after.q[0]).translation()
    back = _within(arm, before.q[::-1][: free + 1], place, corner.radius)
    # Half of the next motion is left to the next corner.
    ahead = _within(arm, after.q[: after.steps // 2 + 1], place, corner.radius)
    best = _Cut(0, after.part(0, 0), 0)
    saved = 0
    for share in _SHARES:
        left, skipped = round(share * back), round(share * ahead)
        if left + skipped <= saved:
            break
        try:
            zone = _transition(before, before.steps - left, after, skipped, corner.bounds)
        except InvalidValueError:
            # Ruckig finds nothing between some states that use their bounds to the last digit.
            continue
        gain = left + skipped - zone.steps
        if gain > saved and _fits(arm, zone, corner, place):
            best, saved = _Cut(left, zone, skipped), gain
    return best


def _transition(
    before: Trajectory, leave: int, after: Trajectory, enter: int, bounds: MotionProfile
) -> Trajectory:
    """Return the motion, in whole periods, from a sample of one motion to one of another."""
    ends = [
        np.stack([one.q[k], one.v[k], one.a[k]]) for one, k in ((before, leave), (after, enter))
    ]
    dt = before.dt
    transition = to_state(ends[0], ends[1], bounds.v_max, bounds.a_max, bounds.j_max, dt)
    steps = max(1, round(transition.duration / dt))
    states = np.array([transition.at(k * dt) for k in range(steps + 1)]).reshape(steps + 1, 3, -1)
    missed = float((np.abs(states[-1, 0] - ends[1][0]) / bounds.j_max).max()) / dt**3
    if missed > _MISSED:
        raise InvalidValueError("end of a cut", missed, f"a miss of at most {_MISSED}")
    states[0], states[-1] = ends
    q, v, a = states.transpose(1, 0, 2).copy()
    return Trajectory(dt=dt, q=q, v=v, a=a)


def _fits(arm: Arm, zone: Trajectory, corner: Corner, place: Vector) -> bool:
    within = _within(arm, zone.q, place, corner.radius) == zone.steps
    return within and _bounded(arm, zone, corner.bounds)


def _bounded(arm: Arm, zone: Trajectory, bounds: MotionProfile) -> bool:
    return bool(
        (np.abs(zone.v) <= bounds.v_max * _ROUNDING).all()
        and (np.abs(zone.a) <= bounds.a_max * _ROUNDING).all()
        and (np.abs(zone.jerk) <= bounds.j_max * _ROUNDING).all()
        and (zone.q >= arm.q_min).all()
        and (zone.q <= arm.q_max).all()
    )


def _within(arm: Arm, q: Matrix, place: Vector, radius: float) -> int:
    """Return for how many periods from the first on the tool stays within a radius."""
    away = np.linalg.norm(tool_places(arm, q)[0] - place, axis=1)
    out = away > radius
    return int(out.argmax()) - 1 if out.any() else len(q) - 1
