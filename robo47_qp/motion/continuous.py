"""Continuous motion through several waypoints, without a stop between them."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import NamedTuple, cast

import numpy as np
from mink import SE3
from scipy.interpolate import CubicSpline

from robo47_qp.arrays import Checked, Vector
from robo47_qp.errors import NO_PATH, PlanError
from robo47_qp.ik.tool_demand import FULL
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import MotionProfile
from robo47_qp.model.tool_poses import Target
from robo47_qp.motion.following.joint_path import JointPath, Stretch
from robo47_qp.motion.following.tracking import IkEffort, Tracking
from robo47_qp.motion.paths.curves import BlendError, PoseSpline, ToolCurve
from robo47_qp.motion.paths.segments import PathProfile, Segment, ToolPath
from robo47_qp.motion.paths.together import OnePath
from robo47_qp.motion.refusals import PathError, check_limits
from robo47_qp.motion.request import STILL, Request
from robo47_qp.motion.timing.retiming import Timing, limits
from robo47_qp.motion.trajectory import Trajectory

_LOOKS = 65
"""Points per section at which the joint limits are checked before the timing."""


class ContinuousMotion(NamedTuple):
    """A planned motion through waypoints."""

    trajectory: Trajectory
    passes: list[int]
    """Samples at which the waypoints before the last are passed."""
    effort: IkEffort
    """IK effort along the tool paths."""


class _Plan(NamedTuple):
    stretches: list[Stretch]
    radii: list[float]
    firsts: list[int]
    efforts: list[IkEffort]


@dataclass(frozen=True, kw_only=True)
class Continuous(Checked):
    """Plans arcs, blended motions and motions through via points. Its fields are settings."""

    profile: PathProfile = PathProfile()
    """Bounds on the tool in LIN and CIRC motions."""
    free: PathProfile | None = None
    """Bounds on the tool in PTP motions; None for no bounds."""
    tracking: Tracking = Tracking(knot_spacing=5e-3, polish=True)
    timing: Timing = Timing()

    def plan(
        self,
        arm: Arm,
        q_start: Vector,
        requests: Sequence[Request],
        profile: MotionProfile,
        dt: float,
    ) -> ContinuousMotion:
        """Plan from rest at q_start to rest at the last waypoint.

        Args:
            arm: The arm.
            q_start: Start configuration (n,) [rad].
            requests: The motions; all but the last are blended or passed.
            profile: Bounds of the joints at full pace.
            dt: Time between samples [s].

        Raises:
            PlanError: The motion is refused.
        """
        plan = _Plan([], [], [], [])
        q, first = q_start, 0
        for in_joints, group in groupby(requests, key=lambda one: one.path is None):
            members = list(group)
            if first:
                plan.radii.append(_radius(requests[first - 1]))
            if in_joints:
                goals = [one.goal.q for one in members if one.goal is not None]
                q = _add_joints(arm, plan, first, members, [q, *goals])
            else:
                q = self._add_tool(arm, plan, first, members, q)
            first += len(members)
        path = _joined(arm, plan, requests)
        owners = [_waypoints_of(path, low, high) for low, high in pairwise(path.cuts)]
        tools = [
            self.free if all(requests[i].path is None for i in own) else self.profile
            for own in owners
        ]
        paces = [min(requests[i].pace for i in own) for own in owners]
        try:
            trajectory = self.timing.timed(arm, path, path.cuts, limits(profile, tools, paces), dt)
        except PathError as error:
            raise PlanError(requests[0].name, *error.refusal(None)) from error
        passes = _passes(path, trajectory)
        try:
            check_limits(arm, trajectory.q)
        except PathError as error:
            k = round(error.fraction * len(trajectory.q))
            name = requests[int(np.searchsorted(passes, k))].name
            raise PlanError(name, *error.refusal(k * dt)) from error
        iterations = sum(effort.iterations for effort in plan.efforts)
        spent = IkEffort(iterations, sum(effort.seconds for effort in plan.efforts))
        return ContinuousMotion(trajectory, passes, spent)

    def _add_tool(
        self, arm: Arm, plan: _Plan, first: int, members: Sequence[Request], q: Vector
    ) -> Vector:
        ik = members[0].ik
        others = [request.name for request in members if request.ik != ik]
        if others:
            told = "without a stop before it, it must have the same objectives and demand"
            raise PlanError(others[0], told, NO_PATH)
        curve = _tool_curve(members, arm.pose_as(members[0].T_world_goal, q), self.profile)
        time = self.profile.least_time(curve.length, curve.angle)
        try:
            path, effort = self.tracking.joint_path(arm, ik, q, curve)
        except PathError as error:
            name = members[curve.segment_at(error.fraction)].name
            raise PlanError(name, *error.refusal(error.fraction * time)) from error
        plan.efforts.append(effort)
        plan.firsts.append(first)
        plan.stretches.append(Stretch(curve=path, time=time, cuts=curve.cuts, passes=curve.corners))
        end: Vector = path(1.0)
        return end


def _tool_curve(
    requests: Sequence[Request], start: Target, profile: PathProfile
) -> ToolCurve | PoseSpline | OnePath:
    """Return the curve of the tool from a pose through waypoints.

    Raises:
        PlanError: The waypoints do not make one curve.
    """
    poses, segments = [start], list[ToolPath]()
    for request in requests:
        if request.path is not None:
            segments.append(request.path(poses[-1]))
        whole = request.ik.tolerance.demand == FULL or not segments
        poses.append(request.T_world_goal if whole else segments[-1].at(1.0))
    for request, one in zip(requests, segments, strict=True):
        if profile.least_time(one.length, one.angle) < STILL:
            raise PlanError(request.name, "it is where the motion already is", NO_PATH)
    if not isinstance(start, SE3):
        # Several tools come to rest at every waypoint.
        (path,) = segments
        return OnePath(path)
    inner = requests[:-1]
    if inner and not any(request.blend for request in inner):
        bent = [request.name for request in requests if not request.straight]
        if bent:
            raise PlanError(bent[0], "an arc goes on without a stop only by a blend", NO_PATH)
        return PoseSpline(cast(list[SE3], poses), profile)
    _check_all_blended(inner)
    try:
        return ToolCurve(
            cast(list[Segment], segments), [request.blend for request in inner], profile
        )
    except BlendError as error:
        raise PlanError(requests[error.segment].name, str(error), NO_PATH) from error


def _check_all_blended(requests: Sequence[Request]) -> None:
    exact = [request.name for request in requests if not request.blend]
    if exact:
        raise PlanError(exact[0], "blends and points to pass exactly do not go together", NO_PATH)


def _add_joints(
    arm: Arm, plan: _Plan, first: int, members: Sequence[Request], points: Sequence[Vector]
) -> Vector:
    """Add a motion in joint space from the first of the points to the last, which it returns."""
    inner = members[:-1]
    times = (np.abs(np.diff(points, axis=0)) / arm.robot.profile.v_max).max(axis=1)
    for request, time in zip(members, times, strict=True):
        if time < STILL:
            raise PlanError(request.name, "it is where the motion already is", NO_PATH)
    if inner and not any(request.blend for request in inner):
        places = np.concatenate([[0.0], np.cumsum(times)]) / times.sum()
        plan.stretches.append(_through(places, points, float(times.sum())))
        plan.firsts.append(first)
        return points[-1]
    _check_all_blended(inner)
    for i, (ends, time) in enumerate(zip(pairwise(points), times, strict=True)):
        plan.stretches.append(_through(np.array([0.0, 1.0]), ends, float(time)))
        plan.firsts.append(first + i)
    plan.radii.extend(request.blend for request in inner)
    return points[-1]


def _through(places: Vector, points: Sequence[Vector], time: float) -> Stretch:
    """Return a natural cubic spline through configurations; a line through two of them."""
    curve = CubicSpline(places, np.array(points), bc_type="natural")
    return Stretch(curve=curve, time=time, cuts=places, passes=places[1:-1])


def _radius(before: Request) -> float:
    if before.blend == 0.0:
        explanation = "motions of the joints and of the tool meet here without a stop: give a blend"
        raise PlanError(before.name, explanation, NO_PATH)
    return before.blend


def _joined(arm: Arm, plan: _Plan, requests: Sequence[Request]) -> JointPath:
    try:
        path = JointPath(arm, plan.stretches, plan.radii)
    except BlendError as error:
        raise PlanError(requests[plan.firsts[error.segment]].name, str(error), NO_PATH) from error
    # Splines and bends may swing further than the waypoints they join.
    s = np.unique(np.concatenate([np.linspace(a, b, _LOOKS) for a, b in pairwise(path.cuts)]))
    try:
        check_limits(arm, path(s))
    except PathError as error:
        at = float(s[round(error.fraction * len(s))])
        name = requests[int(np.searchsorted(path.passes, at))].name
        raise PlanError(name, *error.refusal(at * path.time)) from error
    return path


def _waypoints_of(path: JointPath, low: float, high: float) -> range:
    """Return the indices of the waypoints whose motions a section belongs to."""
    inside = 1e-9 + 1e-6 * (high - low)
    first, last = np.searchsorted(path.passes, [low + inside, high - inside])
    return range(int(first), int(last) + 1)


def _passes(path: JointPath, trajectory: Trajectory) -> list[int]:
    """Return the samples nearest to the waypoints that are passed, in their order."""
    samples, at = [], 0
    for s in path.passes:
        away = np.linalg.norm(trajectory.q[at:] - path(float(s)), axis=1)
        at += int(away.argmin())
        samples.append(at)
    return samples
