"""StepExecutor: carries out the steps of a program, each from where the last one ended."""

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
"""Rate at which a stream removes the remaining error [1/s]; the velocity of the target is fed
forward. A higher rate would exceed the limits of the motors."""


@dataclass(frozen=True, kw_only=True)
class Step(ABC):
    """One step of a program: what it needs, and how it is carried out."""

    before: tuple[Condition, ...] = ()
    """Conditions that must hold before the step starts."""
    after: tuple[Condition, ...] = ()
    """Conditions that must hold at its end."""
    starts_stiff: ClassVar[bool] = True
    """False: if the last step left the arm compliant, it stays compliant."""
    starts_at_rest: ClassVar[bool] = True
    """False: if the last step left the reference in motion, it keeps moving."""
    grips: ClassVar[bool] = False
    """True: it needs a gripper, whether or not its waypoints do."""

    @property
    @abstractmethod
    def name(self) -> str:
        """Name for the recording and for messages."""

    @property
    def path(self) -> tuple[Waypoint, ...]:
        """The waypoints that it visits, as far as they are known in advance."""
        return ()

    @abstractmethod
    def carry_out(self, executor: "StepExecutor") -> None:
        """Move the arm and its fingers.

        Raises:
            StepFailed: It cannot be planned, or one of its conditions is violated.
            Aborted: See `ControlLoop.track`.
        """


class StepExecutor:
    """Carries out steps, and provides planning, a stream and compliance to them."""

    def __init__(self, loop: ControlLoop, planner: Planner) -> None:
        """Use a control loop and a planner."""
        self.loop, self.compliance, self._planner = loop, CompliantMode(loop), planner
        inner = Arm(loop.arm.robot, obstacles=loop.arm.obstacles, margin=JOINT_MARGIN)
        self._inner = loop.arm if inner.limit_margin(inner.home) < 0.0 else inner

    def perform(self, step: Step) -> None:
        """Check the conditions before a step, carry it out, and check those after it.

        Raises:
            StepFailed, Aborted: See `Step.carry_out`.
        """
        require(step.name, step.before)
        if step.starts_stiff:
            self.compliance.stiffen()
        if step.starts_at_rest:
            self.loop.halt()
        step.carry_out(self)
        require(step.name, step.after)

    def plan(self, waypoints: Sequence[Waypoint], speed: float = inf) -> list[Leg]:
        """Plan through one or more waypoints from the reference, which is at rest.

        Args:
            waypoints: At least one; several are planned as one motion.
            speed: Speed limit of the tool on LIN and CIRC, besides that of the planner [m/s].

        Raises:
            StepFailed: The plan is refused.
        """
        planner = self._planner if speed == inf else _limited(self._planner, speed)
        try:
            return self._planned(planner, waypoints, self.loop.reference.q)
        except PlanError as error:
            raise StepFailed(refusal(error)) from error

    def rehearse(self, waypoints: Sequence[Waypoint], q_start: Vector) -> list[Leg]:
        """Plan through waypoints from rest at q_start (n,) [rad], as `plan` would.

        Raises:
            PlanError: The plan is refused.
        """
        return self._planned(self._planner, waypoints, q_start)

    @cached_property
    def stream(self) -> StreamSolver:
        """Differential inverse kinematics within the loop's motion limits."""
        settings = StreamIk(dt=TIMESTEP, profile=self.loop.profile, home_gain=0.0, gain=_GAIN)
        return settings.build(self.loop.arm)

    def planning_arm(self, q: Vector) -> Arm:
        """Return the arm with a margin at its joint limits, unless q or home is inside it."""
        return self.loop.arm if self._inner.limit_margin(q) < 0.0 else self._inner

    def _planned(self, planner: Planner, waypoints: Sequence[Waypoint], q: Vector) -> list[Leg]:
        arm = self.planning_arm(q)
        if len(waypoints) == 1:
            return [planner.plan(arm, waypoints[0], q, TIMESTEP)]
        return planner.plan_chain(arm, waypoints, q, TIMESTEP)


def _limited(planner: Planner, speed: float) -> Planner:
    """Return the planner with a lower speed limit of the tool and the same accelerations."""

    def bounded(profile: PathProfile) -> PathProfile:
        v, a, j = profile.linear
        return replace(profile, linear=(min(speed, v), a, j))

    lin, continuous = planner.lin, planner.continuous
    return replace(
        planner,
        lin=replace(lin, profile=bounded(lin.profile)),
        continuous=replace(continuous, profile=bounded(continuous.profile)),
    )
