"""ActiveController: runs a controller and keeps its state between periods."""

from collections.abc import Sequence

import numpy as np

from robo47_qp.arrays import Vector
from robo47_qp.constants import MANY
from robo47_qp.control.closed_chain import ClosedChain
from robo47_qp.control.compiled import CompiledControl, law_of
from robo47_qp.control.controller import Controller
from robo47_qp.control.joint_stops import JointStops
from robo47_qp.control.observer import DisturbanceObserver
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm, JointReference, JointState


class ActiveController:
    """Runs a controller within the arm's limits, and switches it without a jump in torque.

    commanded = controller + joint stops + (1 - s) bump
    torque = the torque closest to `commanded` within tau_max, and within tau_rate_max of the last

    The bump is the difference between the torques of the old and the new controller (or gains,
    or payload) at the switch; s rises from 0 to 1 over a chosen time as 3x² - 2x³, so that the
    torque and its rate are continuous (bumpless transfer: Åström and Hägglund, Advanced PID
    Control, 2006, sec. 3.5).
    """

    def __init__(
        self,
        controller: Controller,
        arm: Arm,
        *,
        dt: float,
        stops: JointStops | None = None,
        observer: DisturbanceObserver | None = None,
        start: Vector | None = None,
    ) -> None:
        """Start at rest, with the torque that holds the arm there.

        Args:
            controller: The control law.
            arm: The model of the robot, with the payload that it is believed to hold.
            dt: Control period [s].
            stops: The springs at the joint limits; by default `JointStops()`.
            observer: What estimates the state and the disturbance; by default the state is taken
                as it is measured, and no disturbance is compensated.
            start: Joint positions (n,) [rad] at which it starts; by default home.
        """
        self.controller, self.arm = controller, arm
        self._dt, self._n = dt, arm.n
        self.observed = None if observer is None else observer.build(arm, dt)
        """The estimate of the observer; None without one."""
        self._stops = JointStops() if stops is None else stops
        still = np.zeros(arm.n)
        robot = arm.robot
        low, high = self._stops.inside(arm)
        bounds = (robot.tau_rate_max * dt, robot.tau_max, low, high)
        self._bounds = [bound.tolist() for bound in bounds]
        self.commanded: Vector = arm.inverse_dynamics(
            arm.home if start is None else start, still, still
        )
        """Torque of the last period before the limits (n,) [N·m]."""
        self._last: list[float] = np.clip(self.commanded, -robot.tau_max, robot.tau_max).tolist()
        self._before: tuple[Controller, Arm, Vector] | None = None
        self._bump, self._left, self._fade = still, 0, 0
        self._build_compiled()

    def switch(self, controller: Controller, *, seconds: float = 0.1) -> None:
        """Change the control law or its gains.

        Args:
            controller: The new one.
            seconds: Time in which the bump fades; with 0 the torque jumps within its limits.

        Raises:
            InvalidValueError: The time is negative or not finite.
        """
        self._change(controller, self.arm, seconds)

    def set_arm(self, arm: Arm, *, seconds: float = 0.1) -> None:
        """Change the model, for example to another payload.

        Args:
            arm: The same robot, with another payload.
            seconds: See `switch`.

        Raises:
            InvalidValueError: The arm is of another robot; the time is negative or not finite.
        """
        if arm.robot is not self.arm.robot:
            raise InvalidValueError(
                "arm", f"one of {arm.robot.name!r}", f"an arm of {self.arm.robot.name!r}"
            )
        self._change(self.controller, arm, seconds)

    def compensate(self, on: bool, *, learn: bool = True, touching: bool = False) -> None:
        """Compensate disturbances, or hold the compensation; see `ObservedJoints.compensate`."""
        if self.observed is not None:
            self.observed.compensate(on, learn=learn, touching=touching)

    def close(self, tools: Sequence[int], q: Vector) -> None:
        """Compensate, while it is held, as far as tools that hold one body may.

        Args:
            tools: Their places in `Robot.tools`.
            q: Joint positions (n,) [rad].
        """
        if self.observed is not None:
            self.observed.close(ClosedChain.of(self.arm, tools, q))

    def jump(self, q_ref: Vector) -> None:
        """Continue from another reference (n,) [rad], to which the joints do not move."""
        if self.observed is not None:
            self.observed.jump(q_ref)

    def tune(self, reference: JointReference, periods: int) -> None:
        """Let the observer follow noisy positions as fast as is quiet at a reference.

        Args:
            reference: The one that is reached.
            periods: Control periods since the last call.
        """
        if self.observed is not None:
            self.observed.tune(self.arm, reference, periods)

    def state(self, measured: JointState) -> JointState:
        """Return the state at the start of the next period: as the observer expects it."""
        return measured if self.observed is None else self.observed.ahead(measured)

    def torque(self, reference: JointReference, state: JointState) -> Vector:
        """Return the torque for the period that starts now (n,) [N·m], within its limits.

        Args:
            reference: The joints' reference at the instant of `state`.
            state: The joints' state now.
        """
        compiled, observed = self.compiled, self.observed
        reference = self.sampled(reference)
        if compiled is not None:
            self.enter(compiled, state.q)
            tau = compiled.torque(reference, state)
            self.leave(compiled, 1)
            return tau
        if observed is None:
            return self._torque(reference, state)
        arm = self.arm
        reference, state = observed.estimate(reference, state.q)
        arm.evaluated = False
        tau = self._torque(reference, state)
        if not arm.evaluated:
            arm.inverse_dynamics(*state, reference.a)
        observed.expect(arm, reference, tau)
        return tau

    def sampled(self, reference: JointReference) -> JointReference:
        """Return a reference, or many, with the velocity that sampled joints have on it.

        Both the velocity of a joint that is simulated by steps, q' = q + T v', and one estimated
        from sampled positions are the mean of the period that has ended: T a / 2 less than at its
        end. A law that held it against the latter would let q run ahead by T ζ a / ω.
        """
        q, v, a = reference
        return JointReference(q, v - 0.5 * self._dt * a, a)

    @property
    def compiled(self) -> CompiledControl | None:
        """What computes the next periods in the compiled core; None where Python does."""
        # The first period after a switch asks both controllers.
        return self._compiled if self._before is None else None

    def enter(self, compiled: CompiledControl, q: Vector) -> int:
        """Bring the state into the core; returns how many periods it may go on.

        Args:
            compiled: That of `compiled`.
            q: Measured positions now (n,).
        """
        c = compiled.c
        compiled.last[:] = self._last
        compiled.bump[:] = self._bump
        c.left, c.fade = self._left, self._fade
        return MANY if self.observed is None else self.observed.enter(c, q)

    def leave(self, compiled: CompiledControl, periods: int) -> None:
        """Take the state back after some periods."""
        c = compiled.c
        self._last, self.commanded = compiled.last.tolist(), compiled.commanded.copy()
        self._left, self._fade = c.left, c.fade
        if self.observed is not None:
            self.observed.leave(c, self.arm, periods)

    def _build_compiled(self) -> None:
        self._compiled: CompiledControl | None = None
        law = law_of(self.controller, self.arm)
        seen = None if self.observed is None else self.observed.compiled
        if law is not None and (self.observed is None or seen is not None):
            self._compiled = CompiledControl(law, self.arm, self._stops, self._dt, seen)

    def _torque(self, reference: JointReference, state: JointState) -> Vector:
        asked = self.controller.torque(self.arm, reference, state)
        if self._fade:
            self._smooth(asked, reference, state)
        # Scalars, because numpy takes three times the time for so few numbers.
        new = asked.tolist()
        joints = zip(new, self._last, state.q.tolist(), *self._bounds, strict=True)
        for ask, last, q, step, most, low, high in joints:
            if not (-step <= ask - last <= step and -most <= ask <= most and low <= q <= high):
                return self._limited(asked, reference, state)
        self.commanded, self._last = asked, new
        return asked

    def _limited(self, asked: Vector, reference: JointReference, state: JointState) -> Vector:
        """Add the joint stops, and keep the torque limits."""
        self._stops.push(asked, self.arm, reference.q, state.q)
        self.commanded = asked
        robot, last = self.arm.robot, np.array(self._last)
        step = robot.tau_rate_max * self._dt
        tau: Vector = np.minimum(np.maximum(asked, last - step), last + step)
        tau = np.minimum(np.maximum(tau, -robot.tau_max), robot.tau_max)
        self._last = tau.tolist()
        return tau

    def _change(self, controller: Controller, arm: Arm, seconds: float) -> None:
        if not (np.isfinite(seconds) and seconds >= 0.0):
            raise InvalidValueError("seconds", seconds, "finite and not negative [s]")
        steps = round(seconds / self._dt)
        if not steps:
            self._before = None
        elif self._before is None:
            self._before = self.controller, self.arm, self._remaining()
        self._fade = self._left = steps
        self.controller, self.arm = controller, arm
        self._build_compiled()

    def _smooth(self, asked: Vector, reference: JointReference, state: JointState) -> None:
        """Add the remaining bump."""
        if self._before is not None:
            controller, arm, remaining = self._before
            self._bump = controller.torque(arm, reference, state) + remaining - asked
            self._before = None
        asked += self._remaining()
        self._left -= 1
        if not self._left:
            self._fade = 0

    def _remaining(self) -> Vector:
        if not self._fade:
            return np.zeros(self._n)
        x = self._left / self._fade
        return x * x * (3.0 - 2.0 * x) * self._bump
