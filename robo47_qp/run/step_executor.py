"""What each step of a program does with the control loop."""

from robo47_qp.constants import TIMESTEP
from robo47_qp.model.gripper import Grip
from robo47_qp.run.conditions import Broken, demand, planned
from robo47_qp.run.contact_steps import ContactSteps
from robo47_qp.run.control_loop import TICK_ROWS, ControlLoop
from robo47_qp.run.follow_step import FollowSteps
from robo47_qp.run.steps import (
    Compliance,
    Comply,
    Follow,
    Grasp,
    Guarded,
    Move,
    Release,
    StepLike,
    Wait,
    as_step,
)

_GRIP_STILL = 0.05
"""How long the fingers must stand still for a grip to count as done [s]."""
_GRIP_TIMEOUT = 3.0
"""When a grip is over whether or not the fingers stand still [s]."""


class StepExecutor:
    """Carries out steps, each from where the one before has left the arm."""

    def __init__(self, loop: ControlLoop) -> None:
        """Keep the loop to act with."""
        self._loop = loop
        self._touching = ContactSteps(loop)
        self._following = FollowSteps(loop)

    def perform(self, step: StepLike) -> None:
        """Carry out one step.

        Raises:
            StepFailed: It cannot be planned, or one of its conditions does not hold.
            Aborted: See `ControlLoop.track`.
        """
        step = as_step(step)
        demand(step.name, step.before)
        if not isinstance(step, Comply):
            self.finish()
        if not isinstance(step, Follow):
            self._loop.halt()
        match step:
            case Move():
                self._move(step)
            case Grasp():
                grip = Grip(width=step.width, force=step.force, speed=step.speed)
                self._grip(step.name, grip, step.compliance)
            case Release():
                self._release(step)
            case Wait():
                self._wait(step)
            case Guarded():
                self._touching.guarded(step)
            case Comply():
                self._touching.comply(step)
            case Follow():
                self._following.follow(step)
        demand(step.name, step.after)

    def finish(self) -> None:
        """Make an arm stiff that has been left yielding.

        Raises:
            Aborted: See `ControlLoop.track`.
        """
        self._touching.stiffen()

    def _move(self, step: Move) -> None:
        loop = self._loop
        for leg in planned(loop, step.waypoints):
            waypoint = leg.waypoint
            loop.believe(waypoint.carried)
            if leg.trajectory.steps:
                loop.begin(waypoint.name, leg)
                broken = Broken(step.name, step.during)
                loop.track(leg.trajectory, broken)
                if broken.error is not None:
                    loop.halt()
                    raise broken.error
            if waypoint.grip is not None:
                opening = waypoint.grip.width > loop.sim.width()
                self._grip("open gripper" if opening else "close gripper", waypoint.grip)

    def _release(self, step: Release) -> None:
        gripper = self._loop.sim.gripper
        width = gripper.width_max if step.width is None else step.width
        self._grip(step.name, Grip(width=width, force=gripper.force_max))

    def _grip(self, name: str, grip: Grip, compliance: Compliance | None = None) -> None:
        loop, sim = self._loop, self._loop.sim
        if grip.width > sim.width():
            loop.believe(None)
        sim.command_grip(grip)
        if compliance is not None:
            self._touching.soften(compliance)
        loop.begin(name, compliant=compliance is not None, afresh=False)
        still, waited = 0.0, 0.0
        while still < _GRIP_STILL and waited < _GRIP_TIMEOUT:
            loop.hold(TICK_ROWS * TIMESTEP)
            waited += TICK_ROWS * TIMESTEP
            still = still + TICK_ROWS * TIMESTEP if sim.grip_settled() else 0.0
        self.finish()
        force = sim.last_finger_forces()
        loop.note(f"{name}: {1e3 * sim.width():.1f} mm, fingers {force[0]:.1f} N, {force[1]:.1f} N")

    def _wait(self, step: Wait) -> None:
        until, waited = step.until, 0.0
        while until is None or until.against() is not None:
            if waited >= step.seconds - 0.5 * TIMESTEP:
                break
            seconds = min(TICK_ROWS * TIMESTEP, step.seconds - waited)
            self._hold(step.name, seconds)
            waited += seconds
        if until is not None:
            demand(step.name, (until,))

    def _hold(self, name: str, seconds: float) -> None:
        self._loop.begin(name, afresh=False)
        self._loop.hold(seconds)
