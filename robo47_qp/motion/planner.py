"""From waypoints to trajectories: IK, then PTP or LIN."""

from dataclasses import dataclass

from mink import SE3

from robo47_qp.arm import Arm
from robo47_qp.arrays import Vector
from robo47_qp.errors import PlanError
from robo47_qp.ik.solver import IkResult, IkSolver, judged
from robo47_qp.motion.lin import Lin, LinError
from robo47_qp.motion.ptp import plan_ptp
from robo47_qp.motion.trajectory import Trajectory
from robo47_qp.robot import MotionProfile
from robo47_qp.waypoint import Motion, Place, Waypoint


@dataclass(frozen=True, kw_only=True, eq=False)
class Leg:
    """A planned way to a waypoint."""

    waypoint: Waypoint
    ik: IkResult
    trajectory: Trajectory
    T_world_start: SE3
    """Tool pose at the start."""
    T_world_goal: SE3
    """Tool pose asked for."""


@dataclass(frozen=True, kw_only=True)
class Planner:
    """Plans one leg at a time. Its fields are settings."""

    ik: IkSolver
    profile: MotionProfile
    """Bounds of the joints at full pace."""
    speed: float = 1.0
    """Pace of every motion, in (0, 1]."""
    lin: Lin = Lin()

    def __post_init__(self) -> None:
        """Check the pace.

        Raises:
            InvalidValueError: `speed` is outside (0, 1].
        """
        self.profile.slowed(self.speed)

    def plan(self, arm: Arm, waypoint: Waypoint, q_start: Vector, dt: float) -> Leg:
        """Plan from rest at q_start to rest at a waypoint.

        The goal of a PTP motion is sought near home, so that it does not depend on where
        the arm comes from; a LIN motion follows the arm from where it is.

        Raises:
            InvalidValueError: `q_start` is not finite.
            PlanError: The waypoint is not reached by IK, or the way there is not possible.
        """
        q_start = arm.checked_q("q_start", q_start)
        T_world_start = arm.pose(q_start)
        home = waypoint.target is Place.HOME
        target = arm.pose(arm.home) if isinstance(waypoint.target, Place) else waypoint.target
        pace = self.speed * waypoint.speed
        if waypoint.motion is Motion.LIN:
            try:
                profile = self.profile.slowed(pace)
                trajectory, result = self.lin.plan(arm, self.ik, q_start, target, profile, dt, pace)
            except LinError as error:
                raise PlanError(waypoint.name, str(error)) from error
        else:
            result = (
                judged(arm, target, arm.home, self.ik.tolerance, 0)
                if home
                else self.ik.solve(arm, target, arm.home)
            )
            if not result.converged:
                raise PlanError(waypoint.name, result.explanation)
            trajectory = plan_ptp(q_start, result.q, self.profile.slowed(pace), dt)
        return Leg(
            waypoint=waypoint,
            ik=result,
            trajectory=trajectory,
            T_world_start=T_world_start,
            T_world_goal=target,
        )
