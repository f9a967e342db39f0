"""StepExecutor: carries out the steps of a program, each from where the last one has ended."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf
from typing import ClassVar

from robo47_qp.arrays import Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import PlanError
from robo47_qp.ik.stream.stream import StreamIk, StreamSolver
from robo47_qp.model.arm import JOINT_MARGIN, Arm
from robo47_qp.motion.paths.segments import PathProfile
from robo47_qp.motion.planner import Leg, Planner
from robo47_qp.motion.waypoint import Waypoint
from robo47_qp.run.compliance import CompliantMode
from robo47_qp.run.control_loop import ControlLoop
from robo47_qp.run.failure import Condition, StepFailed, refusal, require

_GAIN = 15.0
"""Rate at which a stream removes a short remaining distance [1/s]. The target's own velocity is
known, so that this only acts on the rest; a higher one would ask too much of the motors."""


@dataclass(frozen=True, kw_only=True)
class Step(ABC):
    """One step of a program: what it needs, and how it is carried out."""

    before: tuple[Condition, ...] = ()
    """What has to hold before the step starts."""
    after: tuple[Condition, ...] = ()
    """What has to hold at its end, or the step has failed."""
    starts_stiff: ClassVar[bool] = True
    """False: an arm that the last step left compliant stays so."""
    starts_at_rest: ClassVar[bool] = True
    """False: a reference that the last step left in motion goes on moving."""
    grips: ClassVar[bool] = False
    """True: it needs a gripper, whatever its waypoints ask for."""

    @property
    @abstractmethod
    def name(self) -> str:
        """Name for the recording and for messages."""

    @property
    def path(self) -> tuple[Waypoint, ...]:
        """The waypoints that it visits, as far as they are known before."""
        return ()

    @abstractmethod
    def carry_out(self, executor: "StepExecutor") -> None:
        """Move the arm and its fingers.

        Raises:
            StepFailed: It cannot be planned, or one of its conditions is violated.
            Aborted: See `ControlLoop.track`.
        """


class StepExecutor:
    """Carries out steps, and offers them what they share: plans, a stream, compliance."""

    def __init__(self, loop: ControlLoop, planner: Planner) -> None:
        """Keep the loop to act with, and what plans its motions."""
        self.loop, self.compliance = loop, CompliantMode(loop)
        self._planner = planner
        inner = Arm(loop.arm.robot, obstacles=loop.arm.obstacles, margin=JOINT_MARGIN)
        self._inner = loop.arm if inner.limit_margin(inner.home) < 0.0 else inner

    def perform(self, step: Step) -> None:
        """Carry out one step.

        Raises:
            StepFailed: It cannot be planned, or one of its conditions is violated.
            Aborted: See `ControlLoop.track`.
        """
        require(step.name, step.before)
        if step.starts_stiff:
            self.compliance.stiffen()
        if step.starts_at_rest:
            self.loop.halt()
        step.carry_out(self)
        require(step.name, step.after)

    def plan(self, waypoints: Sequence[Waypoint], speed: float = inf) -> list[Leg]:
        """Return motions through waypoints that are known together, from the reference at rest.

        Args:
            waypoints: At least one.
            speed: Largest speed of the tool on LIN and CIRC, beside that of the planner [m/s].

        Raises:
            StepFailed: There are none.
        """
        planner = self._planner if speed == inf else _limited(self._planner, speed)
        try:
            return self._planned(planner, waypoints, self.loop.reference.q)
        except PlanError as error:
            raise StepFailed(refusal(error)) from error

    def rehearse(self, waypoints: Sequence[Waypoint], q_start: Vector) -> list[Leg]:
        """Return motions through waypoints from rest at q_start, as `plan` would.

        Raises:
            PlanError: There are none.
        """
        return self._planned(self._planner, waypoints, q_start)

    @cached_property
    def stream(self) -> StreamSolver:
        """Differential inverse kinematics within the loop's motion limits."""
        settings = StreamIk(dt=TIMESTEP, profile=self.loop.profile, home_gain=0.0, gain=_GAIN)
        return settings.build(self.loop.arm)

    def planning_arm(self, q: Vector) -> Arm:
        """Return the arm that motions from q are planned with: its joint limits have a margin.

        Where q or home is inside that margin, it is the one with the whole range.
        """
        return self.loop.arm if self._inner.limit_margin(q) < 0.0 else self._inner

    def _planned(self, planner: Planner, waypoints: Sequence[Waypoint], q: Vector) -> list[Leg]:
        arm = self.planning_arm(q)
        if len(waypoints) == 1:
            return [planner.plan(arm, waypoints[0], q, TIMESTEP)]
        return planner.plan_chain(arm, waypoints, q, TIMESTEP)


def _limited(planner: Planner, speed: float) -> Planner:
    """Return the planner with the speed of the tool bounded; accelerations stay."""

    def bounded(profile: PathProfile) -> PathProfile:
        v, a, j = profile.linear
        return replace(profile, linear=(min(speed, v), a, j))

    lin, continuous = planner.lin, planner.continuous
    return replace(
        planner,
        lin=replace(lin, profile=bounded(lin.profile)),
        continuous=replace(continuous, profile=bounded(continuous.profile)),
    )
