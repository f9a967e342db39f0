"""PolicyCell: gives observations to a policy and carries out its actions."""

from robo47_qp.arrays import Vector
from robo47_qp.errors import PlanError
from robo47_qp.model.gripper import Grip
from robo47_qp.run.control_loop import TICK_ROWS, ControlLoop
from robo47_qp.run.policy.action_check import grip_of
from robo47_qp.run.policy.motion import JointTargets, OwnTorques, ToolTargets
from robo47_qp.run.policy.policy import (
    Action,
    JointTarget,
    Observation,
    ToolTarget,
    Torques,
    vector_of,
)


class PolicyCell:
    """A control loop as a policy sees it: it returns observations and carries out actions."""

    def __init__(self, loop: ControlLoop) -> None:
        """Use a control loop."""
        self._loop = loop
        self._joints, self._tool = JointTargets(loop), ToolTargets(loop)
        self._torques = OwnTorques(loop)
        self._grip: Grip | None = None

    def observe(self) -> Observation:
        """Return the current readings of sensors and camera."""
        sensed = self._loop.senses.read()
        state, grips = sensed.state(), sensed.robot.gripper is not None
        objects = [name for name in sensed.seen if name in sensed.objects]
        return Observation(
            time=sensed.time,
            q=state.q,
            v=state.v,
            tool=vector_of(sensed.tool_pose()),
            width=sensed.width() if grips else None,
            fingers=sensed.finger_forces() if grips else None,
            force=sensed.felt_force(),
            objects={name: vector_of(sensed.seen_pose(name)) for name in objects},
            markers={name: vector_of(sensed.seen_pose(name)) for name in sensed.markers},
            frames={name: sensed.seen_time(name) for name in sensed.seen},
            sheet=sensed.sheet,
        )

    def carry_out(self, action: Action, periods: int) -> None:
        """Carry out a checked action for a number of control periods.

        Raises:
            PlanError, InvalidValueError: The arm cannot get there from its current motion.
            Aborted: See `ControlLoop.track`.
        """
        self._move_fingers(action)
        if not isinstance(action, Torques):
            self._torques.leave()
        match action:
            case JointTarget():
                self._go_to_joints(action.q, periods)
            case ToolTarget():
                self._tool.go(action.pose, periods)
            case Torques():
                self._torques.go(action.tau, periods)

    def _go_to_joints(self, q: Vector, periods: int) -> None:
        try:
            self._joints.go(q, periods)
        except PlanError:
            if not self._tool.leads:
                raise
            # Too fast to reverse within the limits and the jerk: the stream brakes first.
            self._tool.go(None, periods)

    def rest(self) -> None:
        """Come to rest under the controller.

        Raises:
            PlanError: The arm is too fast to stop inside its limits.
            Aborted: See `ControlLoop.track`.
        """
        self._torques.leave()
        try:
            self._loop.halt()
        except PlanError:
            if not self._tool.leads:
                raise
            # A stream brakes harder than jerk-limited stops, and it always can.
            while not self._loop.resting:
                self._tool.go(None, TICK_ROWS)

    def _move_fingers(self, action: Action) -> None:
        gripper = self._loop.arm.robot.gripper
        grip = None if gripper is None else grip_of(action, gripper)
        # Every command starts a new move from where the fingers are: repeated, it never squeezes.
        if grip is not None and grip != self._grip:
            self._loop.sim.command_grip(grip)
            self._grip = grip
