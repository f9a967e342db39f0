"""Straight lines of the tool from rest to rest: followed by IK and timed."""

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from mink import SE3
from scipy.interpolate import BSpline

from robo47_qp.arrays import Vector
from robo47_qp.errors import RefusalReason
from robo47_qp.ik.solver import IkResult, IkSolver, judged
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import MotionProfile
from robo47_qp.motion.following.tracking import Tracking
from robo47_qp.motion.paths.segments import Line, PathProfile, ToolPath
from robo47_qp.motion.refusals import PathError, check_limits
from robo47_qp.motion.timing.rest_to_rest import S_CURVE, TimeLaw
from robo47_qp.motion.timing.retiming import Timing, limits
from robo47_qp.motion.trajectory import Trajectory, hold

_MAX_STRETCH = 1000.0
"""Largest factor by which time may be stretched before a path is refused."""
_UNEVEN, _LONG = 2.0, 1.0
"""Stretch factor and duration [s] above which a motion is also timed section by section."""
_SECTIONS = 16
_WORTH = 0.7
"""Share of the even duration below which the timing by sections is taken."""


@dataclass(frozen=True, kw_only=True)
class Lin(Tracking):
    """Plans straight tool paths. Its fields are settings.

    The timing is that of the tool's profile along the path, and where a joint would exceed
    its own profile, the whole motion is stretched in time until none does. Where one part of
    the line causes most of that, only the sections around it are slowed.
    """

    profile: PathProfile = PathProfile()
    """Bounds on the tool."""
    law: TimeLaw = S_CURVE
    """Time law from rest to rest."""
    timing: Timing = Timing()
    """Timing by sections, used with the default law only."""

    def plan(
        self,
        arm: Arm,
        ik: IkSolver,
        q_start: Vector,
        goal: SE3 | ToolPath,
        joints: MotionProfile,
        dt: float,
        pace: float = 1.0,
    ) -> tuple[Trajectory, IkResult]:
        """Plan from the tool pose at q_start to a goal pose, or along a path that starts there.

        Args:
            arm: The arm.
            ik: Solves the knots.
            q_start: Start configuration, at rest (n,) [rad].
            goal: Tool pose to come to rest at, or the path of one tool or several.
            joints: Bounds of the joints.
            dt: Time between samples [s].
            pace: Pace of the tool in (0, 1].

        Returns:
            The trajectory, and the IK result at its end with the effort of all knots.

        Raises:
            PathError: IK fails on the path or changes branch, the path leaves the joint
                limits, or no number of knots keeps it on the line.
        """
        line: ToolPath = Line(arm.pose(q_start), goal) if isinstance(goal, SE3) else goal
        T_world_goal = goal if isinstance(goal, SE3) else goal.at(1.0)
        if max(line.length, line.angle) <= min(ik.tolerance.position, ik.tolerance.orientation):
            there = judged(arm, T_world_goal, q_start, ik.tolerance, 0)
            if not there.converged:
                raise PathError(1.0, there.explanation, RefusalReason.JOINT_LIMIT)
            return hold(q_start, 0, dt), there
        path, effort = self.joint_path(arm, ik, q_start, line)
        trajectory = self._timed(arm, path, line, joints, dt, pace)
        end = judged(arm, T_world_goal, trajectory.end.q, ik.tolerance, 0)
        return trajectory, replace(end, iterations=effort.iterations, seconds=effort.seconds)

    def follow(
        self, arm: Arm, ik: IkSolver, q_start: Vector, path: ToolPath
    ) -> tuple[IkResult, BSpline]:
        """Follow a tool path in the branch in which it starts, without timing it.

        Returns:
            The IK result at its end, and the joint path over [0, 1].

        Raises:
            PathError: See `plan`.
        """
        joints, effort = self.joint_path(arm, ik, q_start, path)
        end = judged(arm, path.at(1.0), joints(1.0), ik.tolerance, 0)
        return replace(end, iterations=effort.iterations, seconds=effort.seconds), joints

    def _timed(
        self, arm: Arm, path: BSpline, line: ToolPath, joints: MotionProfile, dt: float, pace: float
    ) -> Trajectory:
        bounds = self.profile.along(line.length, line.angle, pace)
        stretch = 1.0
        while True:
            trajectory = _along(path, bounds / stretch ** np.arange(1, 4), dt, self.law)
            excess = _excess(trajectory, joints, self.law)
            if excess <= 1.0:
                break
            # Samples of a stretched motion fall elsewhere: stretch a little more than needed.
            stretch *= 1.0005 * excess
            if stretch > _MAX_STRETCH:
                raise PathError(
                    0.0, f"it would have to be {stretch:.0f} times slower", RefusalReason.PACE
                )
        if stretch > _UNEVEN and pace * trajectory.duration > _LONG and self.law is S_CURVE:
            cuts = np.linspace(0.0, 1.0, _SECTIONS + 1)
            bound = limits(joints, [self.profile.slowed(pace)] * _SECTIONS, [1.0] * _SECTIONS)
            with suppress(PathError):
                uneven = self.timing.timed(arm, path, cuts, bound, dt)
                if uneven.duration < _WORTH * trajectory.duration:
                    trajectory = uneven
        check_limits(arm, trajectory.q)
        return trajectory


def _along(path: BSpline, bounds: Vector, dt: float, law: TimeLaw) -> Trajectory:
    """Return the motion along the path under bounds on its parameter."""
    s, ds, dds = law.run(1.0, bounds, dt).T[:, :, None]
    s = s[:, 0]
    # Derivative splines: the orders of one spline differ from them in the last digits.
    dq, ddq = path.derivative(1)(s), path.derivative(2)(s)
    return Trajectory(dt=dt, q=path(s), v=dq * ds, a=ddq * ds**2 + dq * dds)


def _excess(trajectory: Trajectory, joints: MotionProfile, law: TimeLaw) -> float:
    """Return the factor by which to stretch time to bring every joint within its bounds."""
    v = np.abs(trajectory.v).max(axis=0) / joints.v_max
    a = np.abs(trajectory.a).max(axis=0) / joints.a_max
    j = np.abs(trajectory.jerk).max(axis=0) / joints.j_max
    return float(max(v.max(), a.max() ** 0.5, j.max() ** (1 / 3) if law.bounds_jerk else 0.0))
