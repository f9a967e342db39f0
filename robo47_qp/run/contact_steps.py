"""Steps that look for contact or live with it."""

from dataclasses import dataclass, replace

import numpy as np

from robo47_qp.arrays import Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.control.cartesian_impedance import CartesianImpedance
from robo47_qp.control.controller import Controller
from robo47_qp.control.pressing import Pressing
from robo47_qp.model.arm import Arm, JointReference, JointState
from robo47_qp.motion.paths.speed_limits import PathProfile
from robo47_qp.motion.planner import Planner
from robo47_qp.motion.trajectory import hold
from robo47_qp.run.conditions import Broken, demand, planned
from robo47_qp.run.control_loop import ControlLoop
from robo47_qp.run.failure import Failure, StepFailed
from robo47_qp.run.steps import Compliance, Comply, Guarded

_GUARD_ROWS = 2
"""Control periods between two looks at the world while something may be touched."""
_STILL = 2e-3
"""Joint speed below which the arm counts as at rest [rad/s]."""


class ContactSteps:
    """Carries out guarded and compliant motions."""

    def __init__(self, loop: ControlLoop) -> None:
        """Keep the loop to act with."""
        self._loop = loop
        self._stiff: Controller | None = None
        self._compliance: Compliance | None = None

    def guarded(self, step: Guarded) -> None:
        """Go until something is touched.

        Raises:
            StepFailed: The line cannot be planned, or nothing was touched.
        """
        loop = self._loop
        (leg,) = planned(loop, [step.waypoint], _no_faster(loop.scenario.planner, step.speed))
        loop.believe(step.waypoint.carried)
        before = loop.sim.felt_force()

        def touched() -> bool:
            change = loop.sim.felt_force() - before
            return float(np.sqrt(change.dot(change))) >= step.force

        # What is touched pushes the tool off its line before the arm stops.
        loop.begin(step.name, leg, compliant=True)
        if loop.track(leg.trajectory, touched, block=_GUARD_ROWS):
            loop.halt()
        elif step.missing is not None:
            evidence = f"nothing was touched on the way; {step.force:.1f} N were waited for"
            raise StepFailed(Failure(cause=step.missing, evidence=evidence, step=step.name))

    def comply(self, step: Comply) -> None:
        """Lead the tool on springs, pressing or not.

        Raises:
            StepFailed: The way cannot be planned, or what was to be so was not.
        """
        looking = _Looking(step)
        try:
            self._lead(step, looking)
            looking.judge()
        except StepFailed:
            self.stiffen()
            raise
        if not step.stay:
            self.stiffen()

    def soften(self, compliance: Compliance) -> None:
        """Give way from now on, until `stiffen`."""
        control = self._loop.control
        if compliance is self._compliance:
            return
        if self._stiff is None:
            self._stiff = control.controller
        self._compliance = compliance
        control.switch(self._controller(compliance))

    def stiffen(self) -> None:
        """Take where a yielding arm has come to as the reference, and bring it to rest there."""
        if self._stiff is None:
            return
        loop, stiff = self._loop, self._stiff
        self._stiff = self._compliance = None
        speed = loop.sim.state().v
        self._renew(stiff)
        if np.abs(speed).max() > _STILL:
            loop.reference = JointReference(loop.reference.q, speed, np.zeros(loop.arm.n))
            loop.halt()

    def _renew(self, controller: Controller) -> None:
        """Take where the arm is as the reference, at rest, and go on with a controller.

        Springs that lose their load at once would be felt: the torque goes over smoothly from
        what it was, not from what the old law asks for at the new reference.
        """
        loop, control = self._loop, self._loop.control
        loop.rest(np.clip(loop.sim.state().q, loop.arm.q_min, loop.arm.q_max))
        control.switch(_ConstantTorque(control.asked.copy()), seconds=0.0)
        control.switch(controller)

    def _lead(self, step: Comply, looking: "_Looking") -> None:
        loop = self._loop
        planner = _no_faster(loop.scenario.planner, step.speed)
        if step.renew and self._stiff is not None:
            self._renew(loop.control.controller)
        legs = planned(loop, step.waypoints, planner) if step.waypoints else []
        if step.carried is not None:
            loop.believe(step.carried)
        self.soften(step.compliance)
        for leg in legs:
            loop.begin(leg.waypoint.name, leg, compliant=True)
            if loop.track(leg.trajectory, looking, block=_GUARD_ROWS):
                # What is broken ends the yielding at once: an arm that presses would run on.
                if not looking.broken:
                    loop.halt()
                return
        if step.seconds:
            loop.begin(step.name, compliant=True)
            still = hold(loop.reference.q, round(step.seconds / TIMESTEP), TIMESTEP)
            loop.track(still, looking, block=_GUARD_ROWS)

    def _controller(self, compliance: Compliance) -> Controller:
        springs = CartesianImpedance(stiffness=compliance.stiffness, frame=compliance.frame)
        if compliance.axis is None:
            return springs
        loop, axis = self._loop, compliance.axis
        if compliance.frame == "tool":
            axis = loop.arm.pose(loop.reference.q).rotation().as_matrix().T @ axis
        pressing = Pressing(
            force=compliance.force, axis=axis, impedance=springs, speed_max=compliance.speed
        )
        return pressing.build(loop.control.arm, self._felt)

    def _felt(self) -> Vector:
        """Contact force on the tool and what it is believed to hold (3,), in the world [N]."""
        arm, felt = self._loop.control.arm, self._loop.sim.felt_force()
        if arm.payload is not None:
            felt -= arm.payload.mass * arm.model.opt.gravity
        return felt


@dataclass(frozen=True, eq=False)
class _ConstantTorque:
    """A torque that stays as it was."""

    tau: Vector

    def torque(self, arm: Arm, reference: JointReference, state: JointState) -> Vector:
        return self.tau.copy()


class _Looking:
    """Looks at the world while a step complies: whether it is over, and how."""

    def __init__(self, step: Comply) -> None:
        self._step, self._broken = step, Broken(step.name, step.during)
        self._met = False

    def __call__(self) -> bool:
        step = self._step
        if step.observe is not None:
            step.observe()
        self._met = step.until is not None and step.until.against() is None
        return self._broken() or self._met

    @property
    def broken(self) -> bool:
        """True where a condition was seen that does not hold."""
        return self._broken.error is not None

    def judge(self) -> None:
        """Go on only where nothing was broken and what was waited for has come about.

        Raises:
            StepFailed: Not so.
        """
        if self._broken.error is not None:
            raise self._broken.error
        if self._step.until is not None and not self._met:
            demand(self._step.name, (self._step.until,))


def _no_faster(planner: Planner, speed: float) -> Planner:
    """The planner with the speed of the tool bounded; accelerations stay."""

    def bounded(profile: PathProfile) -> PathProfile:
        v, a, j = profile.linear
        return replace(profile, linear=(min(speed, v), a, j))

    lin, continuous = planner.lin, planner.continuous
    return replace(
        planner,
        lin=replace(lin, profile=bounded(lin.profile)),
        continuous=replace(continuous, profile=bounded(continuous.profile)),
    )
