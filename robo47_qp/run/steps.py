"""The steps that programs are written in, and the executor that carries them out.

Most programs consist of moves, grips and waits; other steps have files of their own.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf
from typing import ClassVar, TypeAlias

import numpy as np

from robo47_qp.arrays import Checked, Longest, NotNegative, Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import InvalidValueError, PlanError
from robo47_qp.ik.stream.stream import StreamIk
from robo47_qp.model.arm import JOINT_MARGIN, Arm
from robo47_qp.model.gripper import Grip
from robo47_qp.motion.planner import Leg, Planner
from robo47_qp.motion.smooth_stream import SmoothStream
from robo47_qp.motion.waypoint import Place, Waypoint
from robo47_qp.run.compliance import Compliance, CompliantMode
from robo47_qp.run.control_loop import TICK_ROWS, ControlLoop
from robo47_qp.run.failure import Condition, StepFailed, StepMonitor, refusal, require
from robo47_qp.run.loosening import AT_HOME, Loosening

_GAIN = 15.0
"""Rate at which a stream removes the remaining error [1/s]; the velocity of the target is fed
forward. A higher rate would exceed the limits of the motors."""
_SMOOTHED = 20
"""Ticks of a stream whose mean is taken [-]: its acceleration may jump from bound to bound."""
_LETTING_GO_ROWS = 2
"""Control periods between two looks at the force of fingers that let an item go."""
_GRIP_STILL, _OPEN_STILL = 0.05, 0.02
"""How long the fingers must stand still for closing and opening to count as done [s]."""
_GRIP_TIMEOUT, _SLOW = 3.0, 2.0
"""When a grip is over whether or not the fingers stand still, beside the time that its speed takes:
a time [s], or so many times what the gripper takes at its own speed, if that is more."""


@dataclass(frozen=True, kw_only=True)
class Step(Checked, ABC):
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


_FIRST_PACE = 0.2
"""Pace of the first way home of an arm that does not stand there."""


class StepExecutor:
    """Carries out steps, and provides planning, a stream and compliance to them."""

    def __init__(self, loop: ControlLoop, planner: Planner) -> None:
        """Use a control loop and a planner."""
        self.loop, self.compliance, self._planner = loop, CompliantMode(loop), planner
        self.loosening = Loosening(loop, planner)
        """What the arm does while there is nothing to do yet."""
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
        self.loop.pause()
        require(step.name, step.after)

    def plan(self, waypoints: Sequence[Waypoint], speed: float = inf) -> list[Leg]:
        """Plan through one or more waypoints from the reference, which is at rest.

        Args:
            waypoints: At least one; several are planned as one motion.
            speed: Speed limit of the tool on LIN and CIRC, besides that of the planner [m/s].

        Raises:
            StepFailed: The plan is refused.
        """
        planner = self._planner if speed == inf else self._planner.slower(speed)
        try:
            legs = self._planned(planner, waypoints, self.loop.reference.q)
            return [replace(leg, speed=speed) for leg in legs]
        except PlanError as error:
            raise StepFailed(refusal(error)) from error

    def way_home(self) -> list[Leg]:
        """Plan home from where a real arm stands, slowly; no legs where it stands there.

        Raises:
            PlanError: The plan is refused.
        """
        reference, home = self.loop.reference, self.loop.arm.home
        if np.abs(reference.q - home).max() <= AT_HOME:
            return []
        slow = replace(self._planner, pace=min(self._planner.pace, _FIRST_PACE))
        return self._planned(
            slow, [Waypoint(name="first way home", target=Place.HOME)], reference.q
        )

    def go_home(self) -> None:
        """Move home where the arm does not start there.

        Raises:
            StepFailed: The plan is refused.
            Aborted: See `ControlLoop.track`.
        """
        try:
            legs = self.way_home()
        except PlanError as error:
            raise StepFailed(refusal(error)) from error
        for leg in legs:
            self.loop.begin(leg.waypoint.name, leg)
            self.loop.track(leg.trajectory)
            self.loop.pause()

    def rehearse(self, waypoints: Sequence[Waypoint], q_start: Vector) -> list[Leg]:
        """Plan through waypoints from rest at q_start (n,) [rad], as `plan` would.

        Raises:
            PlanError: The plan is refused.
        """
        return self._planned(self._planner, waypoints, q_start)

    @cached_property
    def stream(self) -> SmoothStream:
        """Differential inverse kinematics within the loop's motion limits, as plans leave them."""
        settings = StreamIk(
            dt=TIMESTEP,
            profile=self.loop.profile,
            home_gain=0.0,
            gain=_GAIN,
            margin=JOINT_MARGIN,
        )
        return SmoothStream(settings.build(self.loop.arm), _SMOOTHED)

    def planning_arm(self, q: Vector) -> Arm:
        """Return the arm with a margin at its joint limits, unless q or home is inside it."""
        return self.loop.arm if self._inner.limit_margin(q) < 0.0 else self._inner

    def _planned(self, planner: Planner, waypoints: Sequence[Waypoint], q: Vector) -> list[Leg]:
        arm = self.planning_arm(q)
        if len(waypoints) == 1:
            return [planner.plan(arm, waypoints[0], q, TIMESTEP)]
        return planner.plan_chain(arm, waypoints, q, TIMESTEP)


@dataclass(frozen=True, kw_only=True)
class Move(Step):
    """Visit waypoints that are known together: all are planned before the arm moves."""

    waypoints: tuple[Waypoint, ...]
    during: tuple[Condition, ...] = ()
    """What has to hold all the time: where it is violated, the arm stops and the step fails."""
    meanwhile: Grip | None = None
    """What the main gripper, which holds nothing, does on the way; it is not waited for."""

    def __post_init__(self) -> None:
        """Check that there is somewhere to go.

        Raises:
            InvalidValueError: There is no waypoint.
        """
        super().__post_init__()
        if not self.waypoints:
            raise InvalidValueError("waypoints of a move", "none", "at least one waypoint")

    @property
    def name(self) -> str:
        """Name of the last waypoint."""
        return self.waypoints[-1].name

    @property
    def path(self) -> tuple[Waypoint, ...]:
        """See `Step.path`."""
        return self.waypoints

    def carry_out(self, executor: StepExecutor) -> None:
        """See `Step.carry_out`."""
        loop = executor.loop
        legs = executor.plan(self.waypoints)
        if self.meanwhile is not None:
            loop.sim.command_grip(self.meanwhile)
        for leg in legs:
            waypoint = leg.waypoint
            loop.set_payload(waypoint.carried)
            if waypoint.holding is not None and len(waypoint.holding) > 1:
                loop.hold_together(tuple(waypoint.holding))
            if leg.trajectory.steps:
                loop.begin(waypoint.name, leg)
                monitor = StepMonitor(self.name, self.during)
                loop.track(leg.trajectory, monitor)
                if monitor.error is not None:
                    loop.halt()
                    raise monitor.error
            if waypoint.grip is not None:
                opening = waypoint.grip.width > loop.sim.width()
                _grip(executor, "open gripper" if opening else "close gripper", waypoint.grip)


@dataclass(frozen=True, kw_only=True)
class Grasp(Step):
    """Close the fingers and wait until they stand still."""

    force: NotNegative
    """Force of each finger [N]."""
    tool: str | None = None
    """Name of the tool whose fingers close; None is the main one."""
    width: NotNegative = 0.0
    """Opening width to close to, if nothing is in between [m]."""
    speed: Longest = inf
    """Largest rate of the opening width, beside that of the gripper [m/s]."""
    compliance: Compliance | None = None
    """How the tool gives way to fingers that touch one after the other; None keeps it stiff."""
    during: tuple[Condition, ...] = ()
    """Conditions that must hold while they close."""
    name: str = "grasp"
    grips: ClassVar[bool] = True

    def carry_out(self, executor: StepExecutor) -> None:
        """See `Step.carry_out`."""
        grip = Grip(width=self.width, force=self.force, speed=self.speed)
        _grip(executor, self.name, grip, self.compliance, self.tool, self.during)


@dataclass(frozen=True, kw_only=True)
class Release(Step):
    """Open the fingers and wait until they stand still; the tool then carries nothing."""

    tool: str | None = None
    """Name of the tool whose fingers open; None is the main one."""
    width: NotNegative | None = None
    """Opening width to open to [m]; None opens them fully."""
    name: str = "release"
    grips: ClassVar[bool] = True

    def carry_out(self, executor: StepExecutor) -> None:
        """See `Step.carry_out`."""
        gripper = executor.loop.sim.gripper_of(place_of(executor, self.tool))
        width = gripper.width_max if self.width is None else self.width
        _grip(executor, self.name, Grip(width=width, force=gripper.force_max), tool=self.tool)


@dataclass(frozen=True, kw_only=True)
class Look(Step):
    """Let the camera take images of what is not held: the arm may loosen its joints meanwhile."""

    seconds: NotNegative
    """How long [s]."""
    lasts: float
    """How long such steps will take, at least, with this one [s]."""
    name: str = "look"
    starts_at_rest: ClassVar[bool] = False

    def carry_out(self, executor: StepExecutor) -> None:
        """See `Step.carry_out`."""
        executor.loop.begin(self.name, afresh=False)
        executor.loosening.spend(self.seconds, self.lasts)


@dataclass(frozen=True, kw_only=True)
class Wait(Step):
    """Stand still until a condition holds."""

    seconds: NotNegative
    """How long at most; the whole time where `until` is None [s]."""
    until: Condition | None = None
    """What is waited for; the step fails with its cause if it does not hold in time."""
    untouched: bool = False
    """Whether tools are known to touch nothing: what the wrists read is then their zero."""
    name: str = "wait"

    def carry_out(self, executor: StepExecutor) -> None:
        """See `Step.carry_out`."""
        executor.loop.untouched = self.untouched
        try:
            self._wait(executor)
        finally:
            executor.loop.untouched = False

    def _wait(self, executor: StepExecutor) -> None:
        until, waited = self.until, 0.0
        while until is None or until.against() is not None:
            if waited >= self.seconds - 0.5 * TIMESTEP:
                break
            seconds = min(TICK_ROWS * TIMESTEP, self.seconds - waited)
            executor.loop.begin(self.name, afresh=False)
            executor.loop.hold(seconds)
            waited += seconds
        if until is not None:
            require(self.name, (until,))


def _grip(
    executor: StepExecutor,
    name: str,
    grip: Grip,
    compliance: Compliance | None = None,
    tool: str | None = None,
    during: Sequence[Condition] = (),
) -> None:
    place = place_of(executor, tool)
    if place and compliance is not None:
        raise InvalidValueError(f"compliance of tool {tool!r}", "one", "None: the main tool's only")
    loop, sim = executor.loop, executor.loop.sim
    opening = grip.width > sim.width(place)
    if opening and loop.yielding and not executor.compliance.active:
        loop.compensate(on=True)
    sim.command_grip(grip, place)
    if compliance is not None:
        executor.compliance.soften(compliance)
    loop.begin(name, compliant=compliance is not None, afresh=False)
    way, gripper = abs(grip.width - sim.width(place)), sim.robot.tools[place].gripper
    slowest = grip.speed if gripper is None else gripper.speed_max
    longest = max(_GRIP_TIMEOUT, _SLOW * way / slowest) + way / grip.speed
    enough = _OPEN_STILL if opening else _GRIP_STILL
    still, waited = 0, 0
    while still * TIMESTEP < enough and waited * TIMESTEP < longest:
        carried = loop.carried_weight(place) if opening else 0.0
        rows = _LETTING_GO_ROWS if carried else TICK_ROWS - waited % TICK_ROWS
        loop.hold(rows * TIMESTEP)
        require(name, during)
        waited += rows
        still = still + rows if sim.grip_settled(place) else 0
        # With a friction of 0.5, fingers that press with less than its weight lose an item.
        if carried and loop.senses.sensed.finger_forces(place).min() < carried:
            loop.let_go(place)
    if opening:
        loop.let_go(place)
    executor.compliance.stiffen()
    width, force = 1e3 * sim.width(place), sim.last_finger_forces(place)
    moving = "" if still * TIMESTEP >= enough else f", still moving after {waited * TIMESTEP:.1f} s"
    loop.note(f"{name}: {width:.1f} mm, fingers {force[0]:.1f} N, {force[1]:.1f} N{moving}")


def place_of(executor: StepExecutor, tool: str | None) -> int:
    """Return the place of a tool among the robot's."""
    return 0 if tool is None else executor.loop.arm.robot.tool_index(tool)


StepLike: TypeAlias = Waypoint | tuple[Waypoint, ...] | Step
"""What a program may yield: a waypoint, or several known together, stand for a `Move`."""


def as_step(step: StepLike) -> Step:
    """Return the step that an entry of a program stands for.

    Raises:
        InvalidValueError: It stands for none.
    """
    if isinstance(step, Step):
        return step
    waypoints = step if isinstance(step, tuple) else (step,)
    if not all(isinstance(one, Waypoint) for one in waypoints):
        expected = "a Step, a Waypoint or a tuple of Waypoints"
        raise InvalidValueError("what a program yields", repr(step), expected)
    return Move(waypoints=waypoints)
