"""CIRC: the tool on an arc of a circle, turning at a steady rate."""

from collections.abc import Mapping
from dataclasses import dataclass

from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.model.arm import Arm
from robo47_qp.motion.motion_type import MotionType, PlannerSettings
from robo47_qp.motion.paths.segments import Arc, arc_about, arc_through
from robo47_qp.motion.request import Planned, Request


@dataclass(frozen=True)
class CircMotion(MotionType):
    """Circular; see `MotionType`."""

    prescribes_path = True
    straight = False
    passable = False
    points = ("through", "centre")
    colour = (120, 220, 140)

    def path(self, start: SE3, goal: SE3, points: Mapping[str, Vector]) -> Arc:
        """See `MotionType.path`."""
        if "through" in points:
            return arc_through(start, goal, points["through"])
        return arc_about(start, goal, points["centre"])

    def plan(
        self, settings: PlannerSettings, arm: Arm, request: Request, q_start: Vector, dt: float
    ) -> Planned:
        """See `MotionType.plan`."""
        [planned] = settings.without_stops(arm, [request], q_start, dt)
        path = (
            None
            if request.path is None
            else request.path(arm.pose_as(request.T_world_goal, q_start))
        )
        return planned._replace(path=path)
