"""Motions for the three kinds of actions: joint targets, tool targets and torques."""

import numpy as np

from robo47_qp.arrays import Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.control.controller import Controller
from robo47_qp.errors import PlanError, RefusalReason, Rejection
from robo47_qp.ik.stream.stream import StreamIk
from robo47_qp.model.arm import JOINT_MARGIN, Arm, JointReference, JointState
from robo47_qp.motion.smooth_stream import SmoothStream
from robo47_qp.motion.timing.state_to_state import Transition, to_state
from robo47_qp.motion.trajectory import Trajectory
from robo47_qp.run.control_loop import ControlLoop
from robo47_qp.run.policy.policy import pose_of

_ROUNDING = 1e-9
"""Rounding error of a position at its limit, which is clipped [rad]."""
_REST = 1e-9
"""Speed below which a joint that the policy has left counts as at rest [rad/s]."""
_SMOOTHED = 40
"""Number of control periods over which streamed commands are averaged, a lag of 20 ms."""
_TAKEOVER = 0.1
"""Time over which the controller takes over after torques of the policy [s]."""


class JointTargets:
    """Moves to joint positions that may change at any time, time-optimal with bounded jerk."""

    def __init__(self, loop: ControlLoop) -> None:
        """Use a control loop."""
        self._loop = loop
        self._goal: Vector = loop.reference.q
        self._reached: Vector = self._goal
        self._transition: Transition | None = None
        self._left: JointReference | None = None
        self._done = 0

    def go(self, q_goal: Vector, periods: int) -> None:
        """Move towards joint positions inside the limits (n,) [rad] as fast as the profile allows.

        Raises:
            PlanError: The arm is too fast to stop inside its limits.
            InvalidValueError: Ruckig finds no motion.
            Aborted: See `ControlLoop.track`.
        """
        loop = self._loop
        if loop.reference is not self._left or not np.array_equal(q_goal, self._goal):
            self._aim(q_goal)
        loop.begin("joint targets", afresh=False)
        loop.track(self._next(periods))
        self._left = loop.reference

    def _aim(self, q_goal: Vector) -> None:
        arm, profile = self._loop.arm, self._loop.profile
        start, still = np.stack(self._loop.reference), np.zeros(arm.n)
        reached = arm.nearest(q_goal, start[0])
        goal = np.stack([reached, still, still])
        transition = to_state(start, goal, profile.v_max, profile.a_max, profile.j_max)
        low, high = transition.reach
        beyond = np.maximum(arm.q_min - low, high - arm.q_max)
        if (beyond > _ROUNDING).any():
            i = int(np.argmax(beyond))
            joint = arm.robot.joints[i]
            reason = f"{joint} is so fast that it leaves its limits by {beyond[i]:.4f}"
            rejection = Rejection(reason=RefusalReason.JOINT_LIMIT, joint=joint)
            raise PlanError("joint target", reason, rejection)
        self._transition, self._done = transition, 0
        self._goal, self._reached = q_goal, reached

    def _next(self, periods: int) -> Trajectory:
        """Return the next part of the motion; at rest at the goal after its end."""
        arm, transition, first = self._loop.arm, self._transition, self._done
        states = np.zeros((periods + 1, 3, arm.n))
        states[0] = np.stack(self._loop.reference)
        for k in range(1, periods + 1):
            time = (first + k) * TIMESTEP
            if transition is not None and time < transition.duration:
                states[k] = np.reshape(transition.at(time), (3, arm.n))
            else:
                states[k, 0] = self._reached
        self._done += periods
        q = np.clip(states[:, 0], arm.q_min, arm.q_max)  # rounding
        return Trajectory(dt=TIMESTEP, q=q, v=states[:, 1], a=states[:, 2])


class ToolTargets:
    """Moves to tool poses that may change at any time, by differential inverse kinematics."""

    def __init__(self, loop: ControlLoop) -> None:
        """Use a control loop."""
        self._loop = loop
        self._stream: SmoothStream | None = None
        self._left: JointReference | None = None

    def go(self, pose: Vector | None, periods: int) -> None:
        """Move towards a pose (7,) as in `Observation`; None brakes.

        Raises:
            Aborted: See `ControlLoop.track`.
        """
        loop, stream = self._loop, self._built()
        if loop.reference is not self._left:
            stream.reset(loop.reference)
        target = None if pose is None else pose_of(pose)
        loop.begin("tool targets", streamed=True, afresh=False)
        loop.track(stream.block([target] * periods))
        self._left = loop.reference

    @property
    def leads(self) -> bool:
        """True if this moved the reference last."""
        return self._loop.reference is self._left

    def _built(self) -> SmoothStream:
        if self._stream is None:
            settings = StreamIk(dt=TIMESTEP, profile=self._loop.profile, margin=JOINT_MARGIN)
            self._stream = SmoothStream(settings.build(self._loop.arm), _SMOOTHED)
        return self._stream


class OwnTorques:
    """Applies the policy's torques; the reference follows the measured state."""

    def __init__(self, loop: ControlLoop) -> None:
        """Use a control loop."""
        self._loop = loop
        self._torque = _RateLimited(loop.arm)
        self._usual: Controller | None = None

    def go(self, tau: Vector, periods: int) -> None:
        """Apply torques within the motors' limits (n,) [N·m].

        Raises:
            Aborted: See `ControlLoop.track`.
        """
        loop = self._loop
        if self._usual is None:
            self._torque.start(loop.control.commanded)
            self._usual = loop.control.controller
            loop.control.switch(self._torque, seconds=0.0)
            loop.compensate(on=False)
        loop.begin("torques", compliant=True, streamed=True, afresh=False)
        self._torque.wanted = tau
        for _ in range(periods):
            self._refer_to_state()
            now = loop.reference
            q, v, a = (np.stack([column, column]) for column in now)
            loop.track(Trajectory(dt=TIMESTEP, q=q, v=v, a=a), block=1)
        self._refer_to_state()

    def leave(self) -> None:
        """Return control to the usual controller, at the current reference."""
        if self._usual is not None:
            self._loop.control.switch(self._usual, seconds=_TAKEOVER)
            self._loop.compensate(on=True)
            self._usual = None

    def _refer_to_state(self) -> None:
        arm, state = self._loop.arm, self._loop.sim.state()
        # With noise, a joint at its limit may be measured outside.
        q = np.clip(state.q, arm.q_min, arm.q_max)
        # Ruckig fails on motions that only rounding made.
        v = np.where(np.abs(state.v) < _REST, 0.0, state.v)
        self._loop.take_over(JointReference(q, v, np.zeros(arm.n)))


class _RateLimited:
    """A controller that applies a given torque within the torque rate of the motors."""

    def __init__(self, arm: Arm) -> None:
        self._limit, self._step = arm.robot.tau_max, arm.robot.tau_rate_max * TIMESTEP
        self.wanted: Vector = np.zeros(arm.n)
        self._last: Vector = np.zeros(arm.n)

    def start(self, tau: Vector) -> None:
        """Start from a torque (n,) [N·m]."""
        self._last = np.clip(tau, -self._limit, self._limit)

    def torque(self, arm: Arm, reference: JointReference, state: JointState) -> Vector:
        """See `Controller.torque`."""
        self._last = np.clip(self.wanted, self._last - self._step, self._last + self._step)
        return self._last.copy()
