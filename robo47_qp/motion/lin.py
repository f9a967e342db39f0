"""LIN: the tool on a straight line, from rest to rest."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from mink import SE3
from scipy.interpolate import BSpline, make_interp_spline

from robo47_qp.arm import Arm
from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import Robo47Error
from robo47_qp.ik.solver import IkResult, IkSolver, judged
from robo47_qp.motion.jerk_limited import rest_to_rest
from robo47_qp.motion.line import Line
from robo47_qp.motion.path_profile import PathProfile
from robo47_qp.motion.trajectory import Trajectory, hold
from robo47_qp.robot import MotionProfile

_MAX_STRETCH = 1000.0
"""A path that must be slowed more than this is no path for the arm."""


class LinError(Robo47Error):
    """A straight tool path that the arm cannot follow.

    Attributes:
        fraction: Where on the path, 0 at its start and 1 at its end.
    """

    def __init__(self, fraction: float, reason: str) -> None:
        """Tell where on the path and why."""
        super().__init__(f"the straight path fails {100 * fraction:.0f} % of the way: {reason}")
        self.fraction = fraction


class _Effort(NamedTuple):
    iterations: int
    seconds: float


@dataclass(frozen=True, kw_only=True)
class Lin:
    """Plans straight tool paths. Its fields are settings.

    IK solves the path at knots, each started from the one before; a spline of degree 5
    joins them, so that the jerk is bounded; the knots are doubled until the spline keeps to
    the line. The timing is that of the tool's profile along the path, and where a joint
    would exceed its own profile, the whole motion is stretched in time until none does.
    """

    profile: PathProfile = PathProfile()
    """Bounds on the tool."""
    deviation: float = 5e-6
    """How far the tool may be from its place on the line [m], and from its turn [rad]."""
    knot_spacing: float = 0.01
    """First spacing of the knots [m] and [rad]."""
    doublings: int = 4
    """How often the knots are doubled before giving up."""
    jump: float = 0.3
    """Change of a joint between knots that counts as another branch of IK [rad]."""

    def plan(
        self,
        arm: Arm,
        ik: IkSolver,
        q_start: Vector,
        T_world_goal: SE3,
        joints: MotionProfile,
        dt: float,
        speed: float = 1.0,
    ) -> tuple[Trajectory, IkResult]:
        """Plan from the tool pose at q_start to a goal pose.

        Args:
            arm: The arm.
            ik: Solves the knots.
            q_start: Start configuration, at rest (n,) [rad].
            T_world_goal: Tool pose to come to rest at.
            joints: Bounds of the joints.
            dt: Time between samples [s].
            speed: Pace of the tool in (0, 1].

        Returns:
            The trajectory, and the IK result at its end with the effort of all knots.

        Raises:
            LinError: IK fails on the path or changes branch, the path leaves the joint
                limits, or no number of knots keeps it on the line.
        """
        line = Line(arm.pose(q_start), T_world_goal)
        if max(line.length, line.angle) <= min(ik.tolerance.position, ik.tolerance.orientation):
            there = judged(arm, T_world_goal, q_start, ik.tolerance, 0)
            if not there.converged:
                raise LinError(1.0, there.explanation)
            return hold(q_start, 0, dt), there
        path, effort = self._path(arm, ik, q_start, line)
        trajectory = self._timed(arm, path, line, joints, dt, speed)
        end = judged(arm, T_world_goal, trajectory.end.q, ik.tolerance, 0)
        return trajectory, replace(end, iterations=effort.iterations, seconds=effort.seconds)

    def follow(self, arm: Arm, ik: IkSolver, q_start: Vector, T_world_goal: SE3) -> IkResult:
        """Where a line ends in the branch in which it starts, without timing the motion.

        Raises:
            LinError: See `plan`.
        """
        line = Line(arm.pose(q_start), T_world_goal)
        path, effort = self._path(arm, ik, q_start, line)
        s = np.linspace(0.0, 1.0, 4 * len(path.c))
        _check_limits(arm, path(s))
        end = judged(arm, T_world_goal, path(1.0), ik.tolerance, 0)
        return replace(end, iterations=effort.iterations, seconds=effort.seconds)

    def _path(self, arm: Arm, ik: IkSolver, q_start: Vector, line: Line) -> tuple[BSpline, _Effort]:
        """Joint path over s in [0, 1] that keeps to the line."""
        knots = max(8, int(np.ceil(max(line.length, line.angle) / self.knot_spacing)))
        iterations, seconds, off, fraction = 0, 0.0, np.inf, 0.0
        for _ in range(self.doublings + 1):
            q, results = self._solved(arm, ik, q_start, line, knots)
            iterations += sum(result.iterations for result in results)
            seconds += sum(result.seconds for result in results)
            path = make_interp_spline(np.linspace(0.0, 1.0, knots + 1), q, k=5)
            off, fraction = _worst_deviation(arm, line, path, knots)
            if off <= self.deviation:
                return path, _Effort(iterations, seconds)
            knots *= 2
        raise LinError(fraction, f"{knots // 2} knots leave the tool {1e6 * off:.0f} µm off")

    def _solved(
        self, arm: Arm, ik: IkSolver, q_start: Vector, line: Line, knots: int
    ) -> tuple[Matrix, list[IkResult]]:
        """Configurations at the knots (knots + 1, n), and how each was solved."""
        s = np.linspace(0.0, 1.0, knots + 1)
        q, results = [q_start], []
        for fraction in s[1:]:
            result = ik.solve(arm, line.at(fraction), q[-1])
            if not result.converged:
                raise LinError(fraction, result.explanation)
            moved = np.abs(result.q - q[-1])
            if moved.max() > self.jump:
                joint = arm.robot.joints[int(moved.argmax())]
                raise LinError(fraction, f"{joint} would jump by {moved.max():.2f} rad")
            q.append(result.q)
            results.append(result)
        return np.array(q), results

    def _timed(
        self, arm: Arm, path: BSpline, line: Line, joints: MotionProfile, dt: float, speed: float
    ) -> Trajectory:
        bounds = self.profile.along(line.length, line.angle, speed)
        stretch = 1.0
        while True:
            trajectory = _along(path, bounds / stretch ** np.arange(1, 4), dt)
            excess = _excess(trajectory, joints)
            if excess <= 1.0:
                break
            # Samples of a stretched motion fall elsewhere: stretch a little more than needed.
            stretch *= 1.0005 * excess
            if stretch > _MAX_STRETCH:
                raise LinError(0.0, f"it would have to be {stretch:.0f} times slower")
        _check_limits(arm, trajectory.q)
        return trajectory


def _check_limits(arm: Arm, q: Matrix) -> None:
    outside = (q < arm.q_min) | (q > arm.q_max)
    if outside.any():
        row, joint = np.argwhere(outside)[0]
        raise LinError(row / len(outside), f"{arm.robot.joints[joint]} leaves its limits")


def _worst_deviation(arm: Arm, line: Line, path: BSpline, knots: int) -> tuple[float, float]:
    """Largest pose error between the knots, in m or rad, and where it is."""
    s = (np.arange(2 * knots) + 0.5) / (2 * knots)
    off = [max(arm.distance_to(line.at(x), q)) for x, q in zip(s, path(s), strict=True)]
    worst = int(np.argmax(off))
    return off[worst], float(s[worst])


def _along(path: BSpline, bounds: Vector, dt: float) -> Trajectory:
    """Run the path under bounds on its parameter: q(t) = path(s(t)), by the chain rule."""
    v_max, a_max, j_max = bounds[:, None]
    start, goal = np.zeros(1), np.ones(1)
    s, ds, dds = rest_to_rest(start, goal, v_max, a_max, j_max, dt)
    s = s[:, 0]
    dq, ddq = path.derivative(1)(s), path.derivative(2)(s)
    return Trajectory(dt=dt, q=path(s), v=dq * ds, a=ddq * ds**2 + dq * dds)


def _excess(trajectory: Trajectory, joints: MotionProfile) -> float:
    """Factor by which time must be stretched to bring every joint within its bounds."""
    v = np.abs(trajectory.v).max(axis=0) / joints.v_max
    a = np.abs(trajectory.a).max(axis=0) / joints.a_max
    j = np.abs(trajectory.jerk).max(axis=0) / joints.j_max
    return float(max(v.max(), a.max() ** 0.5, j.max() ** (1 / 3)))
