"""Motion types: what each defines, in one file of `types`, and the settings that they share."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from mink import SE3

from robo47_qp.arrays import Checked, Vector
from robo47_qp.ik.solver import IkSolver, judged
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import MotionProfile
from robo47_qp.motion.blending import blends_joints, cut_ptp
from robo47_qp.motion.collision_check import Collisions
from robo47_qp.motion.continuous import Continuous, ContinuousMotion
from robo47_qp.motion.detour import Detour
from robo47_qp.motion.following.lin import Lin
from robo47_qp.motion.following.tracking import IkEffort
from robo47_qp.motion.motor_share import MotorShare
from robo47_qp.motion.paths.segments import Segment
from robo47_qp.motion.request import Planned, Request
from robo47_qp.motion.timing.lower_bound import lower_bound
from robo47_qp.motion.timing.rest_to_rest import S_CURVE, TimeLaw
from robo47_qp.motion.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class PlannerSettings(Checked):
    """Settings that all motion types share."""

    ik: IkSolver
    profile: MotionProfile
    """Bounds of the joints at full pace."""
    pace: float = 1.0
    """Ratio of the speeds of all motions to those of the profiles, in (0, 1]."""
    lin: Lin = Lin()
    continuous: Continuous = Continuous()
    """How arcs and motions without stops are planned."""
    law: TimeLaw = S_CURVE
    """How PTP and LIN motions run from rest to rest."""
    motors: MotorShare | None = None
    """What the motors may spend on a motion; None leaves it to the profile."""
    collisions: Collisions | None = None
    """Collision check of all motions; None for none."""
    surroundings: Collisions | None = None
    """Further collision check of PTP motions that start clear of it: of what the tool may touch in
    other motions."""
    detour: Detour | None = None
    """Plans PTP motions around what `collisions` finds; None refuses them."""

    def __post_init__(self) -> None:
        """Check the pace.

        Raises:
            InvalidValueError: `pace` is outside (0, 1], or a part is none.
        """
        self.profile.slowed(self.pace)
        super().__post_init__()

    def unplanned(self, arm: Arm) -> MotionProfile:
        """Return the bounds of motions that are not planned whole: of stops and streams."""
        profile = self.profile.slowed(self.pace)
        return profile if self.motors is None else self.motors.smoothed(arm, profile)

    def check_collisions(self, waypoint: str, trajectory: Trajectory) -> None:
        """Check that a trajectory to a waypoint keeps the clearance.

        Raises:
            PlanError: It does not; bodies, joint and time are named.
        """
        if self.collisions is not None:
            self.collisions.check(waypoint, trajectory)

    def check_surroundings(self, waypoint: str, trajectory: Trajectory) -> None:
        """Check that a PTP motion that starts clear of its surroundings keeps clear of them.

        Raises:
            PlanError: It does not; see `check_collisions`.
        """
        around = self.surroundings
        if around is not None and around.at(trajectory.q[0]) is None:
            around.check(waypoint, trajectory)

    def without_stops(
        self, arm: Arm, requests: Sequence[Request], q_start: Vector, dt: float
    ) -> list[Planned]:
        """Plan one motion from rest through waypoints to rest at the last.

        Raises:
            PlanError: The motion is refused; the waypoint in question is named.
        """
        if len(requests) > 1 and self.continuous.free is None and blends_joints(requests):
            cut = cut_ptp(arm, q_start, requests, self.profile, self.law, dt)
            passage = ContinuousMotion(*cut, IkEffort(0, 0.0))
        else:
            passage = self.continuous.plan(arm, q_start, requests, self.profile, dt)
        whole, ends = passage.trajectory, [*passage.passes, passage.trajectory.steps]
        planned: list[Planned] = []
        for request, first, last in zip(requests, [0, *ends], ends, strict=False):
            part = whole.part(first, last)
            end = judged(arm, request.T_world_goal, part.end.q, request.ik.tolerance, 0)
            if request.path is None:
                self.check_surroundings(request.name, part)
            self.check_collisions(request.name, part)
            planned.append(Planned(part, replace(end, **passage.effort._asdict())))
        pace = max(request.pace for request in requests)
        in_joints = any(request.path is None for request in requests)
        tool = None if in_joints else self.continuous.profile.slowed(pace)
        bound = lower_bound(arm, whole.q, self.profile.slowed(pace), tool, False)
        return [planned[0]._replace(lower_bound=bound), *planned[1:]]


class MotionType(Protocol):
    """A type of motion to a waypoint: its path, how it is planned and drawn."""

    prescribes_path: bool
    """True where the tool keeps to a path; else the joints move as they can."""
    straight: bool
    """True where that path is a straight line."""
    passable: bool
    """True where a smooth curve may lead exactly through such waypoints without a stop."""
    points: tuple[str, ...]
    """Fields of a waypoint that may shape the path, of which one is given; none needs none."""
    colour: tuple[int, int, int]
    """Of planned paths in recordings: red, green, blue."""

    def path(self, start: SE3, goal: SE3, points: Mapping[str, Vector]) -> Segment:
        """Return the path of the tool.

        Args:
            start: T_world_tcp where it begins.
            goal: T_world_tcp where it ends.
            points: Those of the fields `points` that are given (3,) [m].

        Raises:
            InvalidValueError: The points make no path, or none is prescribed.
        """
        ...

    def plan(
        self, settings: PlannerSettings, arm: Arm, request: Request, q_start: Vector, dt: float
    ) -> Planned:
        """Plan from rest at q_start to rest at a waypoint.

        Args:
            settings: How to plan.
            arm: The arm.
            request: The waypoint, with a configuration to reach where no path is prescribed.
            q_start: Configuration at the start (n,) [rad].
            dt: Time between samples [s].

        Raises:
            PlanError: The motion is not possible.
        """
        ...
