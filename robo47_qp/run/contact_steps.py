"""Steps that seek contact or keep it."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Annotated, ClassVar

import numpy as np

from robo47_qp.arrays import Checked, NotNegative, Positive, Range
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.payload import Payload
from robo47_qp.motion.trajectory import hold
from robo47_qp.motion.waypoint import PRESCRIBED, Waypoint
from robo47_qp.run.compliance import Compliance
from robo47_qp.run.failure import Cause, Condition, Failure, StepFailed, StepMonitor
from robo47_qp.run.steps import Step, StepExecutor

_TICK_ROWS = 2
"""Control periods between two checks of the world while contact is expected."""


@dataclass(frozen=True, kw_only=True)
class Guarded(Checked, Step):
    """Move on a straight line until contact, and stop there."""

    waypoint: Waypoint
    """End of the line; its pace and `speed` both limit the tool."""
    force: Positive
    """Change of the contact force on the tool that counts as contact [N]."""
    speed: Positive = 0.02
    """Largest speed of the tool [m/s]."""
    missing: Cause | None = Cause.TIMEOUT
    """Cause of the failure without contact up to the end; None if that is allowed."""

    def __post_init__(self) -> None:
        """Check motion and numbers.

        Raises:
            InvalidValueError: The motion is not LIN, or a number is out of range.
        """
        if not self.waypoint.motion.type.straight:
            raise InvalidValueError("guarded motion", self.waypoint.motion.name, "LIN")
        super().__post_init__()

    @property
    def name(self) -> str:
        """Name of the waypoint."""
        return self.waypoint.name

    @property
    def path(self) -> tuple[Waypoint, ...]:
        """See `Step.path`."""
        return (self.waypoint,)

    def carry_out(self, executor: StepExecutor) -> None:
        """See `Step.carry_out`."""
        loop = executor.loop
        (leg,) = executor.plan([self.waypoint], self.speed)
        loop.set_payload(self.waypoint.carried)
        before = loop.sim.felt_force()

        def touched() -> bool:
            change = loop.sim.felt_force() - before
            return float(np.sqrt(change.dot(change))) >= self.force

        # Contact pushes the tool off its line before the arm stops.
        loop.begin(self.name, leg, compliant=True)
        if loop.track(leg.trajectory, touched, block=_TICK_ROWS):
            loop.halt()
        elif self.missing is not None:
            evidence = f"nothing was touched on the way; {self.force:.1f} N were expected"
            raise StepFailed(Failure(cause=self.missing, evidence=evidence, step=self.name))


@dataclass(frozen=True, kw_only=True)
class Comply(Checked, Step):
    """Move the compliant tool along waypoints, pressing if the compliance has a force.

    The tool need not end at its last waypoint.
    """

    waypoints: tuple[Waypoint, ...]
    """LIN and CIRC waypoints; none to stay in place for `seconds`."""
    compliance: Compliance
    carried: Payload | None = None
    """Payload of the tool from now on; None keeps the one that was set before."""
    speed: Annotated[float, Range(above=0.0, infinite=True)] = inf
    """Speed limit along the waypoints, besides their own pace [m/s]."""
    seconds: NotNegative = 0.0
    """Longest time at the last waypoint [s]."""
    until: Condition | None = None
    """Ends the step once it holds; the step fails with its cause if it never does. None: the step
    runs to its end."""
    during: tuple[Condition, ...] = ()
    """Conditions that must hold all the time: on a violation the arm stops and the step fails."""
    observe: Callable[[], None] | None = None
    """Called every few control periods to observe the world."""
    stay: bool = False
    """True: stay compliant if the next step is a `Comply`; it then starts from the reference of
    this one."""
    renew: bool = False
    """True, after a step that stays compliant: start from the measured pose, with unloaded springs,
    instead of from the reference of that step."""
    name: str = "comply"
    starts_stiff: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Check waypoints and numbers.

        Raises:
            InvalidValueError: A waypoint is reached by PTP, a number is out of range, or there is
                neither a waypoint nor a time.
        """
        ptp = [waypoint.name for waypoint in self.waypoints if not waypoint.prescribes_path]
        if ptp:
            raise InvalidValueError("compliant motion", ptp, f"waypoints reached by {PRESCRIBED}")
        super().__post_init__()
        if not self.waypoints and self.seconds == 0.0:
            found = "no waypoint and 0 s"
            raise InvalidValueError(self.name, found, "waypoints, or a time to stay")

    @property
    def path(self) -> tuple[Waypoint, ...]:
        """See `Step.path`."""
        return self.waypoints

    def carry_out(self, executor: StepExecutor) -> None:
        """See `Step.carry_out`."""
        monitor = StepMonitor(self.name, self.during, self.until, self.observe)
        try:
            self._move(executor, monitor)
            monitor.judge()
        except StepFailed:
            executor.compliance.stiffen()
            raise
        if not self.stay:
            executor.compliance.stiffen()

    def _move(self, executor: StepExecutor, monitor: StepMonitor) -> None:
        loop = executor.loop
        if self.renew:
            executor.compliance.unload()
        legs = executor.plan(self.waypoints, self.speed) if self.waypoints else []
        if self.carried is not None:
            loop.set_payload(self.carried)
        executor.compliance.soften(self.compliance)
        for leg in legs:
            loop.begin(leg.waypoint.name, leg, compliant=True)
            if loop.track(leg.trajectory, monitor, block=_TICK_ROWS):
                # A violation stiffens the arm at once: while it presses, it would slide on.
                if monitor.error is None:
                    loop.halt()
                return
        if self.seconds:
            loop.begin(self.name, compliant=True)
            still = hold(loop.reference.q, round(self.seconds / TIMESTEP), TIMESTEP)
            loop.track(still, monitor, block=_TICK_ROWS)


@dataclass(frozen=True, kw_only=True)
class Unload(Checked, Step):
    """Take the arm's position as its reference, so that its springs carry no load.

    Two hands that hold one body stiffly press and pull at it by what their positions lack to fit:
    that goes, and until a hand opens, disturbances are compensated no further than they were, as
    hands that insist on their positions would press ever harder. The body should stand on
    something, as its weight would be let go as well.
    """

    seconds: NotNegative = 0.2
    """Time in which the forces fade [s]."""
    name: str = "unload"

    def carry_out(self, executor: StepExecutor) -> None:
        """See `Step.carry_out`."""
        executor.loop.compensate(on=False)
        executor.compliance.unload_stiff()
        executor.loop.begin(self.name, compliant=True)
        executor.loop.hold(self.seconds)
