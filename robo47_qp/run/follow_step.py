"""The step that follows a pose that moves."""

import numpy as np

from robo47_qp.constants import TIMESTEP
from robo47_qp.ik.stream.stream import IkStream, StreamIk
from robo47_qp.model.arm import JointReference
from robo47_qp.motion.trajectory import Trajectory
from robo47_qp.run.control_loop import TICK_ROWS, ControlLoop
from robo47_qp.run.failure import Failure, StepFailed
from robo47_qp.run.steps import Follow

_GAIN = 15.0
"""Part of a short remaining way that is gone per second [1/s]. The target's own velocity is known:
this only takes away what is left, and taking it away at once would ask too much of the motors."""


class FollowSteps:
    """Follows targets by differential inverse kinematics; several steps go on from each other."""

    def __init__(self, loop: ControlLoop) -> None:
        """Keep the loop to act with."""
        self._loop = loop
        self._stream: IkStream | None = None

    def follow(self, step: Follow) -> None:
        """Keep the tool at the target until the condition holds.

        Raises:
            StepFailed: The condition does not hold in time.
        """
        loop, stream = self._loop, self._built()
        now = loop.reference
        if not (np.array_equal(stream.q, now.q) and np.array_equal(stream.v, now.v)):
            stream.reset(now.q, now.v)
        loop.believe(step.carried)
        if step.grip is not None:
            loop.sim.command_grip(step.grip)
        loop.begin(step.name, streamed=True)
        end = loop.sim.time + step.seconds - 0.5 * TIMESTEP
        while (against := step.until.against()) is not None:
            if loop.sim.time > end:
                raise StepFailed(
                    Failure(
                        cause=step.until.cause,
                        evidence=against,
                        step=step.name,
                        condition=step.until.name,
                    )
                )
            loop.track(self._block(stream, step))

    def _built(self) -> IkStream:
        if self._stream is None:
            planner = self._loop.scenario.planner
            profile = planner.profile.slowed(planner.pace)
            self._stream = StreamIk(dt=TIMESTEP, profile=profile, homing=0.0, gain=_GAIN).build(
                self._loop.arm
            )
        return self._stream

    def _block(self, stream: IkStream, step: Follow) -> Trajectory:
        """The next few periods, towards where the target will be then."""
        time, states = self._loop.sim.time, [self._loop.reference]
        for k in range(TICK_ROWS):
            # A tick starts from where the target is now: steady motion then has no lead or lag.
            tick = stream.tick(step.target(time + k * TIMESTEP))
            states.append(JointReference(tick.q, tick.v, tick.a))
        q, v, a = (np.array(column) for column in zip(*states, strict=True))
        return Trajectory(dt=TIMESTEP, q=q, v=v, a=a)
