"""The steps that most programs are written in: moves, grips and waits."""

from dataclasses import dataclass
from math import inf
from typing import ClassVar, TypeAlias

from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.gripper import Grip
from robo47_qp.motion.waypoint import Waypoint
from robo47_qp.run.compliance import Compliance
from robo47_qp.run.control_loop import TICK_ROWS
from robo47_qp.run.failure import Condition, StepMonitor, require
from robo47_qp.run.step_executor import Step, StepExecutor

_TICK = TICK_ROWS * TIMESTEP
_GRIP_STILL = 0.05
"""How long the fingers must stand still for a grip to count as done [s]."""
_GRIP_TIMEOUT = 3.0
"""When a grip is over whether or not the fingers stand still [s]."""


@dataclass(frozen=True, kw_only=True)
class Move(Step):
    """Visit waypoints that are known together: all are planned before the arm moves."""

    waypoints: tuple[Waypoint, ...]
    during: tuple[Condition, ...] = ()
    """What has to hold all the time: where it is violated, the arm stops and the step fails."""

    def __post_init__(self) -> None:
        """Check that there is somewhere to go.

        Raises:
            InvalidValueError: There is no waypoint.
        """
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
        for leg in executor.plan(self.waypoints):
            waypoint = leg.waypoint
            loop.set_payload(waypoint.carried)
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

    force: float
    """Force of each finger [N]."""
    width: float = 0.0
    """Opening width to close to, if nothing is in between [m]."""
    speed: float = inf
    """Largest rate of the opening width, beside that of the gripper [m/s]."""
    compliance: Compliance | None = None
    """How the tool gives way to fingers that touch one after the other; None keeps it stiff."""
    name: str = "grasp"
    grips: ClassVar[bool] = True

    def carry_out(self, executor: StepExecutor) -> None:
        """See `Step.carry_out`."""
        grip = Grip(width=self.width, force=self.force, speed=self.speed)
        _grip(executor, self.name, grip, self.compliance)


@dataclass(frozen=True, kw_only=True)
class Release(Step):
    """Open the fingers and wait until they stand still; the tool then carries nothing."""

    width: float | None = None
    """Opening width to open to [m]; None opens them fully."""
    name: str = "release"
    grips: ClassVar[bool] = True

    def carry_out(self, executor: StepExecutor) -> None:
        """See `Step.carry_out`."""
        gripper = executor.loop.sim.gripper
        width = gripper.width_max if self.width is None else self.width
        _grip(executor, self.name, Grip(width=width, force=gripper.force_max))


@dataclass(frozen=True, kw_only=True)
class Wait(Step):
    """Stand still until a condition holds."""

    seconds: float
    """How long at most; the whole time where `until` is None [s]."""
    until: Condition | None = None
    """What is waited for; the step fails with its cause if it does not hold in time."""
    name: str = "wait"

    def carry_out(self, executor: StepExecutor) -> None:
        """See `Step.carry_out`."""
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
    executor: StepExecutor, name: str, grip: Grip, compliance: Compliance | None = None
) -> None:
    loop, sim = executor.loop, executor.loop.sim
    if grip.width > sim.width():
        loop.set_payload(None)
    sim.command_grip(grip)
    if compliance is not None:
        executor.compliance.soften(compliance)
    loop.begin(name, compliant=compliance is not None, afresh=False)
    still, waited = 0.0, 0.0
    while still < _GRIP_STILL and waited < _GRIP_TIMEOUT:
        loop.hold(_TICK)
        waited += _TICK
        still = still + _TICK if sim.grip_settled() else 0.0
    executor.compliance.stiffen()
    force = sim.last_finger_forces()
    loop.note(f"{name}: {1e3 * sim.width():.1f} mm, fingers {force[0]:.1f} N, {force[1]:.1f} N")


StepLike: TypeAlias = Waypoint | tuple[Waypoint, ...] | Step
"""What a program may yield: a waypoint, or several known together, stand for a `Move`."""


def as_step(step: StepLike) -> Step:
    """Return the step that an entry of a program stands for."""
    if isinstance(step, Waypoint):
        return Move(waypoints=(step,))
    return Move(waypoints=step) if isinstance(step, tuple) else step
