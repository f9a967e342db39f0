"""The step that follows a moving pose."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from mink import SE3

from robo47_qp.arrays import NotNegative
from robo47_qp.constants import TIMESTEP
from robo47_qp.model.gripper import Grip
from robo47_qp.model.payload import Payload
from robo47_qp.motion.smooth_stream import SmoothStream
from robo47_qp.motion.trajectory import Trajectory
from robo47_qp.run.control_loop import TICK_ROWS, ControlLoop
from robo47_qp.run.failure import Condition, StepFailed, require, violation
from robo47_qp.run.steps import Step, StepExecutor


@dataclass(frozen=True, kw_only=True)
class Follow(Step):
    """Keep the tool at a moving pose by differential inverse kinematics."""

    target: Callable[[float], SE3 | None]
    """Return T_world_tcp at a time [s], up to 30 ms ahead; None brakes."""
    until: Condition
    """Ends the step once it holds; the step fails with its cause if it does not hold in time."""
    seconds: NotNegative
    """Time limit [s]."""
    during: tuple[Condition, ...] = ()
    """Checked meanwhile: the step fails at once where one does not hold."""
    grip: Grip | None = None
    """Command to the gripper at the start of the step."""
    carried: Payload | None = None
    """Payload of the tool."""
    name: str = "follow"
    starts_at_rest: ClassVar[bool] = False

    def carry_out(self, executor: StepExecutor) -> None:
        """See `Step.carry_out`; a step continues the stream of the one before it."""
        loop, stream = executor.loop, executor.stream
        if not stream.stands_at(loop.reference):
            stream.reset(loop.reference)
        loop.set_payload(self.carried)
        if self.grip is not None:
            loop.sim.command_grip(self.grip)
        loop.begin(self.name, streamed=True)
        end = loop.sim.time + self.seconds - 0.5 * TIMESTEP
        while (evidence := self.until.against()) is not None:
            if loop.sim.time > end:
                raise StepFailed(violation(self.name, self.until, evidence))
            require(self.name, self.during)
            loop.track(self._block(loop, stream))

    def _block(self, loop: ControlLoop, stream: SmoothStream) -> Trajectory:
        """Return the references of the next few control periods."""
        # The target at the start of each period: steady motion then has no lead or lag.
        start = loop.sim.time + stream.lag
        return stream.block([self.target(start + k * TIMESTEP) for k in range(TICK_ROWS)])
