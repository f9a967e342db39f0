"""Continuous motion: through several waypoints without a stop between them."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from robo47_qp.arrays import Vector
from robo47_qp.ik.solver import IkSolver
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import MotionProfile
from robo47_qp.motion.following.joint_path import JointPath, Stretch
from robo47_qp.motion.following.limits import LinError, check_limits
from robo47_qp.motion.following.tracking import Effort, Tracking
from robo47_qp.motion.paths.curves import BlendError
from robo47_qp.motion.paths.segments import PathProfile
from robo47_qp.motion.route import (
    STILL,
    Curve,
    misshapen,
    refused,
    tool_curve,
)
from robo47_qp.motion.timing.retiming import Timing, limits
from robo47_qp.motion.trajectory import Trajectory
from robo47_qp.motion.waypoint import Motion, Waypoint

_LOOKS = 65
"""Points per section at which the joint limits are looked at before the timing."""


class PacedProfile(NamedTuple):
    """How fast the joints may go."""

    joints: MotionProfile
    """Bounds at full pace."""
    pace: float
    """Pace of joints and tool in (0, 1], beside that of the waypoints."""


class Passage(NamedTuple):
    """A planned motion through waypoints."""

    trajectory: Trajectory
    passes: list[int]
    """Samples at which the waypoints before the last are passed."""
    curves: list[tuple[int, Curve]]
    """What the tool keeps to, each with the number of its first waypoint."""
    effort: Effort
    """Of IK along the curves."""


class _Plan(NamedTuple):
    stretches: list[Stretch]
    radii: list[float]
    curves: list[tuple[int, Curve]]
    firsts: list[int]
    efforts: list[Effort]


@dataclass(frozen=True, kw_only=True)
class Continuous:
    """Plans arcs, blended motions and motions through via points. Its fields are settings."""

    profile: PathProfile = PathProfile()
    """Bounds on the tool in LIN and CIRC motions."""
    free: PathProfile | None = None
    """Bounds on the tool in PTP motions; None where it may move as the joints can."""
    tracking: Tracking = Tracking(knot_spacing=5e-3, polish=True)
    timing: Timing = Timing()

    def plan(
        self,
        arm: Arm,
        ik: IkSolver,
        q_start: Vector,
        waypoints: Sequence[Waypoint],
        goals: Sequence[Vector],
        profile: PacedProfile,
        dt: float,
    ) -> Passage:
        """Plan from rest at q_start to rest at the last waypoint.

        Args:
            arm: The arm.
            ik: Solves the knots of tool paths.
            q_start: Start configuration (n,) [rad].
            waypoints: All but the last are blended or passed.
            goals: Configurations at the waypoints; used for PTP motions alone.
            profile: How fast the joints may go.
            dt: Time between samples [s].

        Raises:
            PlanError: The motion is refused.
        """
        plan = _Plan([], [], [], [], [])
        q, first = q_start, 0
        for ptp, group in groupby(waypoints, key=lambda one: one.motion is Motion.PTP):
            members = list(group)
            if first:
                plan.radii.append(_radius(waypoints[first - 1]))
            if ptp:
                q = _add_joints(arm, plan, first, members, [q, *goals[first:][: len(members)]])
            else:
                q = self._add_tool(arm, ik, plan, first, members, q)
            first += len(members)
        path = _joined(arm, plan, waypoints)
        owners = [_owners(path, low, high) for low, high in pairwise(path.cuts)]
        tools = [
            self.free if all(waypoints[i].motion is Motion.PTP for i in own) else self.profile
            for own in owners
        ]
        paces = [profile.pace * min(waypoints[i].pace for i in own) for own in owners]
        bounds = limits(profile.joints, tools, paces)
        try:
            trajectory = self.timing.timed(arm, path, path.cuts, bounds, dt)
        except LinError as error:
            raise refused(waypoints[0], error, None) from error
        try:
            check_limits(arm, trajectory.q)
        except LinError as error:
            k = round(error.fraction * len(trajectory.q))
            ends = _passes(path, trajectory)
            waypoint = waypoints[int(np.searchsorted(ends, k))]
            raise refused(waypoint, error, k * dt) from error
        iterations = sum(effort.iterations for effort in plan.efforts)
        spent = Effort(iterations, sum(effort.seconds for effort in plan.efforts))
        return Passage(trajectory, _passes(path, trajectory), plan.curves, spent)

    def _add_tool(
        self,
        arm: Arm,
        ik: IkSolver,
        plan: _Plan,
        first: int,
        members: Sequence[Waypoint],
        q: Vector,
    ) -> Vector:
        curve = tool_curve(members, arm.pose(q), arm.pose(arm.home), self.profile)
        time = self.profile.least_time(curve.length, curve.angle)
        try:
            path, effort = self.tracking.joint_path(arm, ik, q, curve)
        except LinError as error:
            waypoint = members[curve.segment_at(error.fraction)]
            raise refused(waypoint, error, error.fraction * time) from error
        plan.efforts.append(effort)
        plan.curves.append((first, curve))
        plan.firsts.append(first)
        plan.stretches.append(Stretch(curve=path, time=time, cuts=curve.cuts, passes=curve.corners))
        end: Vector = path(1.0)
        return end


def _add_joints(
    arm: Arm, plan: _Plan, first: int, members: Sequence[Waypoint], points: Sequence[Vector]
) -> Vector:
    """Add a motion in joint space from the first of the points to the last, which it returns."""
    inner = members[:-1]
    times = (np.abs(np.diff(points, axis=0)) / arm.robot.profile.v_max).max(axis=1)
    for waypoint, time in zip(members, times, strict=True):
        if time < STILL:
            raise misshapen(waypoint, "it is where the motion already is")
    if inner and not any(waypoint.blend for waypoint in inner):
        places = np.concatenate([[0.0], np.cumsum(times)]) / times.sum()
        plan.stretches.append(_through(places, points, float(times.sum())))
        plan.firsts.append(first)
        return points[-1]
    if not all(waypoint.blend for waypoint in inner):
        raise misshapen(inner[0], "blends and points to pass exactly do not go together")
    for i, (ends, time) in enumerate(zip(pairwise(points), times, strict=True)):
        plan.stretches.append(_through(np.array([0.0, 1.0]), ends, float(time)))
        plan.firsts.append(first + i)
    plan.radii.extend(waypoint.blend for waypoint in inner)
    return points[-1]


def _through(places: Vector, points: Sequence[Vector], time: float) -> Stretch:
    """On a natural cubic spline through configurations; between two of them, a line."""
    curve = CubicSpline(places, np.array(points), bc_type="natural")
    return Stretch(curve=curve, time=time, cuts=places, passes=places[1:-1])


def _radius(before: Waypoint) -> float:
    if before.blend == 0.0:
        raise misshapen(
            before, "motions of the joints and of the tool meet here without a stop: give a blend"
        )
    return before.blend


def _joined(arm: Arm, plan: _Plan, waypoints: Sequence[Waypoint]) -> JointPath:
    try:
        path = JointPath(arm, plan.stretches, plan.radii)
    except BlendError as error:
        raise misshapen(waypoints[plan.firsts[error.segment]], str(error)) from error
    # Splines and bends may swing further than the waypoints they join.
    s = np.unique(np.concatenate([np.linspace(a, b, _LOOKS) for a, b in pairwise(path.cuts)]))
    try:
        check_limits(arm, path(s))
    except LinError as error:
        at = float(s[round(error.fraction * len(s))])
        waypoint = waypoints[int(np.searchsorted(path.passes, at))]
        raise refused(waypoint, error, at * path.time) from error
    return path


def _owners(path: JointPath, low: float, high: float) -> range:
    """Numbers of the waypoints on the way to which a section is."""
    inside = 1e-9 + 1e-6 * (high - low)
    first, last = np.searchsorted(path.passes, [low + inside, high - inside])
    return range(int(first), int(last) + 1)


def _passes(path: JointPath, trajectory: Trajectory) -> list[int]:
    """Samples nearest to where waypoints are passed, in their order."""
    samples, at = [], 0
    for s in path.passes:
        away = np.linalg.norm(trajectory.q[at:] - path(float(s)), axis=1)
        at += int(away.argmin())
        samples.append(at)
    return samples
