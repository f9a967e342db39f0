"""LIN: the tool on a straight line, turning at a steady rate."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError, PlanError
from robo47_qp.model.arm import Arm
from robo47_qp.motion.motion_type import MotionType, PlannerSettings
from robo47_qp.motion.paths.segments import Line
from robo47_qp.motion.refusals import PathError
from robo47_qp.motion.request import Planned, Request
from robo47_qp.motion.timing.lower_bound import lower_bound


@dataclass(frozen=True)
class LinMotion(MotionType):
    """Linear; see `MotionType`."""

    prescribes_path = True
    straight = True
    passable = True
    points = ()
    colour = (255, 180, 70)

    def path(self, start: SE3, goal: SE3, points: Mapping[str, Vector]) -> Line:
        """See `MotionType.path`."""
        return Line(start, goal)

    def plan(
        self, settings: PlannerSettings, arm: Arm, request: Request, q_start: Vector, dt: float
    ) -> Planned:
        """See `MotionType.plan`."""
        goal, pace = request.T_world_goal, request.pace
        lin, profile = replace(settings.lin, law=settings.law), settings.profile.slowed(pace)
        if request.path is None:
            raise InvalidValueError("path of a LIN motion", None, "a path")
        line = request.path(arm.pose_as(goal, q_start))
        try:
            trajectory, end = lin.plan(arm, request.ik, q_start, line, profile, dt, pace)
        except PathError as error:
            time = error.fraction * lin.profile.least_time(line.length, line.angle)
            raise PlanError(request.name, *error.refusal(time)) from error
        settings.check_collisions(request.name, trajectory)
        bound = lower_bound(arm, trajectory.q, profile, lin.profile.slowed(pace), True)
        return Planned(trajectory, end, bound, line)
