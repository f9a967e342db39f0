"""PTP: all joints together, as fast as their limits allow; the path of the tool is no line."""

from collections.abc import Mapping
from dataclasses import dataclass

from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError, PlanError
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import MotionProfile
from robo47_qp.motion.motion_type import MotionType, PlannerSettings
from robo47_qp.motion.paths.segments import Segment
from robo47_qp.motion.request import Planned, Request
from robo47_qp.motion.timing.lower_bound import lower_bound
from robo47_qp.motion.timing.rest_to_rest import plan_ptp
from robo47_qp.motion.trajectory import Trajectory


@dataclass(frozen=True)
class PtpMotion(MotionType):
    """Point to point; see `MotionType`."""

    prescribes_path = False
    straight = False
    passable = True
    points = ()
    colour = (110, 160, 255)

    def path(self, start: SE3, goal: SE3, points: Mapping[str, Vector]) -> Segment:
        """See `MotionType.path`."""
        raise InvalidValueError("motion", "PTP", "one that prescribes the path of the tool")

    def plan(
        self, settings: PlannerSettings, arm: Arm, request: Request, q_start: Vector, dt: float
    ) -> Planned:
        """See `MotionType.plan`."""
        goal = request.goal
        if goal is None:
            raise InvalidValueError("goal of a PTP motion", None, "a configuration")
        if settings.continuous.free is not None and (goal.q != q_start).any():
            return settings.without_stops(arm, [request], q_start, dt)[0]
        profile = settings.profile.slowed(request.pace)
        trajectory = plan_ptp(q_start, goal.q, profile, dt, settings.law)
        settings.check_surroundings(request.name, trajectory)
        try:
            settings.check_collisions(request.name, trajectory)
        except PlanError:
            around_it = _detour(settings, arm, (q_start, goal.q), profile, dt)
            if around_it is None:
                raise
            trajectory = around_it
            settings.check_collisions(request.name, trajectory)
        return Planned(trajectory, goal, lower_bound(arm, trajectory.q, profile, None, True))


def _detour(
    settings: PlannerSettings,
    arm: Arm,
    ends: tuple[Vector, Vector],
    profile: MotionProfile,
    dt: float,
) -> Trajectory | None:
    """Return a motion around what the direct one hits; None where there is none."""
    if settings.detour is None or settings.collisions is None:
        return None
    return settings.detour.plan(arm, settings.collisions, ends, profile, dt)
