"""From waypoints to trajectories: IK, then PTP or LIN."""

from collections.abc import Sequence
from dataclasses import dataclass

from mink import SE3

from robo47_qp.arm import Arm
from robo47_qp.arrays import Vector
from robo47_qp.errors import PlanError
from robo47_qp.ik.solver import IkResult, IkSolver
from robo47_qp.motion.chain import Chain, tool_target
from robo47_qp.motion.lin import Lin, LinError
from robo47_qp.motion.ptp import plan_ptp
from robo47_qp.motion.trajectory import Trajectory
from robo47_qp.robot import MotionProfile
from robo47_qp.waypoint import Motion, Waypoint


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
    chain: Chain = Chain()
    """How configurations are chosen."""

    def __post_init__(self) -> None:
        """Check the pace.

        Raises:
            InvalidValueError: `speed` is outside (0, 1].
        """
        self.profile.slowed(self.speed)

    def plan(self, arm: Arm, waypoint: Waypoint, q_start: Vector, dt: float) -> Leg:
        """Plan from rest at q_start to rest at a waypoint.

        The goal of a PTP motion is sought near home, so that it does not depend on where
        the arm comes from, and such that the straight motions that are to follow can be
        followed from it; a LIN motion follows the arm from where it is.

        Raises:
            InvalidValueError: `q_start` is not finite.
            PlanError: The waypoint is not reached by IK, the way there is not possible, or
                it does not lead on; the waypoint that is in the way is named.
        """
        q_start = arm.checked_q("q_start", q_start)
        if waypoint.motion is Motion.LIN:
            return self._lin(arm, waypoint, q_start, dt)
        result = self.chain.leading_on(arm, self.ik, self.lin, waypoint)
        return self._ptp(arm, waypoint, result, q_start, dt)

    def plan_chain(
        self, arm: Arm, waypoints: Sequence[Waypoint], q_start: Vector, dt: float
    ) -> list[Leg]:
        """Plan through waypoints that are all known, their configurations chosen together.

        Raises:
            InvalidValueError: `q_start` is not finite.
            PlanError: No choice leads through; the waypoint that rules the chain out is named.
        """
        q = arm.checked_q("q_start", q_start)
        v_max = self.profile.v_max
        chosen = self.chain.choose(arm, self.ik, self.lin, waypoints, q, v_max)
        legs: list[Leg] = []
        for waypoint, result in zip(waypoints, chosen, strict=True):
            if waypoint.motion is Motion.LIN:
                legs.append(self._lin(arm, waypoint, q, dt))
            else:
                legs.append(self._ptp(arm, waypoint, result, q, dt))
            q = legs[-1].trajectory.end.q
        return legs

    def _ptp(
        self, arm: Arm, waypoint: Waypoint, result: IkResult, q_start: Vector, dt: float
    ) -> Leg:
        profile = self.profile.slowed(self.speed * waypoint.speed)
        trajectory = plan_ptp(q_start, result.q, profile, dt)
        return _leg(arm, waypoint, result, trajectory, q_start)

    def _lin(self, arm: Arm, waypoint: Waypoint, q_start: Vector, dt: float) -> Leg:
        pace = self.speed * waypoint.speed
        profile, target = self.profile.slowed(pace), tool_target(arm, waypoint)
        try:
            trajectory, result = self.lin.plan(arm, self.ik, q_start, target, profile, dt, pace)
        except LinError as error:
            raise PlanError(waypoint.name, str(error)) from error
        return _leg(arm, waypoint, result, trajectory, q_start)


def _leg(
    arm: Arm, waypoint: Waypoint, result: IkResult, trajectory: Trajectory, q_start: Vector
) -> Leg:
    return Leg(
        waypoint=waypoint,
        ik=result,
        trajectory=trajectory,
        T_world_start=arm.pose(q_start),
        T_world_goal=tool_target(arm, waypoint),
    )
