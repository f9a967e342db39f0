"""PolicyCell: what a policy sees of a scenario, and what becomes of its actions."""

from robo47_qp.arrays import Vector
from robo47_qp.errors import PlanError
from robo47_qp.model.gripper import Grip
from robo47_qp.run.control_loop import TICK_ROWS, ControlLoop
from robo47_qp.run.policy.motion import JointTargets, OwnTorques, ToolTargets
from robo47_qp.run.policy.policy import (
    Action,
    JointTarget,
    Observation,
    ToolTarget,
    Torques,
    checked_action,
    grip_of,
    vector_of,
)


class PolicyCell:
    """A control loop seen from a policy: observations out, actions in."""

    def __init__(self, loop: ControlLoop) -> None:
        """Keep the loop to act with."""
        self._loop = loop
        self._joints, self._tool = JointTargets(loop), ToolTargets(loop)
        self._torques = OwnTorques(loop)
        self._grip: Grip | None = None

    def observe(self) -> Observation:
        """What the policy may know now: sensors and camera, not the truth."""
        sim, arm = self._loop.sim, self._loop.arm
        state = sim.state()
        return Observation(
            time=sim.time,
            q=state.q,
            v=state.v,
            tool=vector_of(arm.pose(state.q)),
            width=None if arm.robot.gripper is None else sim.width(),
            force=sim.felt_force(),
            objects={name: vector_of(sim.seen_pose(name)) for name in sim.objects},
            markers={name: vector_of(sim.marker_pose(name)) for name in sim.markers},
        )

    def checked(self, action: object) -> Action:
        """See `checked_action`."""
        return checked_action(action, self._loop.arm)

    def carry_out(self, action: Action, periods: int) -> None:
        """Do what a checked action asks for a number of control periods.

        Raises:
            PlanError, InvalidValueError: The arm cannot go there from how it moves now.
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
            # Too fast to turn round within the limits and the jerk: the stream brakes first.
            self._tool.go(None, periods)

    def rest(self) -> None:
        """Come to rest, under the controller.

        Raises:
            PlanError: The arm is so fast that it leaves its limits however it brakes.
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
