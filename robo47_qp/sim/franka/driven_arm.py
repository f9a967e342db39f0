"""DrivenArm: a real arm of Franka Robotics in the place of a simulation."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from math import inf

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import ArmStopped, InvalidValueError
from robo47_qp.model.arm import Arm, bare_arm
from robo47_qp.model.gripper import Grip
from robo47_qp.model.robot import Robot
from robo47_qp.sim.franka.link import Link
from robo47_qp.sim.franka.protocol import JOINTS
from robo47_qp.sim.scene import BuildScene
from robo47_qp.sim.signal import Signal
from robo47_qp.sim.simulation import Simulation

_ROTORS, _DAMPING = np.array([0.195] * 4 + [0.074] * 3), np.full(JOINTS, 0.21)
_FRICTION = np.array([1.137] * 4 + [0.763, 0.44, 0.248])
"""Inertia of the rotors [kg m²], viscous [N·m s/rad] and dry friction [N·m] of an FR3's joints, as
identified in torque control (https://github.com/google-deepmind/mujoco_menagerie,
franka_fr3/CHANGELOG.md)."""
_RATE = 0.999
"""Share of the largest torque rate that commands without gravity may have [-]."""
_HELD = 1e-3
"""Least distance from the commanded width of fingers that hold something [m]."""
_NEAR = 0.06
"""Largest distance of what is held from the tool point [m]."""
_BRAKING = np.array([40.0, 40.0, 40.0, 40.0, 8.0, 8.0, 4.0])
"""Damping of an arm that has to stop at once [N·m s/rad]."""
_AT_REST, _LONGEST = 5e-3, 2000
"""Speed of the joints [rad/s] that ends braking, and after how many periods it ends anyway."""


@contextmanager
def uncollected() -> Iterator[None]:
    """Do without garbage collection, which takes more than a period."""
    enabled = gc.isenabled()
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.unfreeze()
        if enabled:
            gc.enable()


def driven(robot: Robot) -> Robot:
    """Return what is believed of an FR3 that is driven: its joints as others identified them.

    In our simulation its rotors have up to 3.1 times that inertia, as Franka told (see fr3.xml). An
    arm with lighter rotors than are believed swings, as commands take effect late; one with heavier
    rotors is followed by the observer. Dry friction is where the observer begins to learn it.

    Raises:
        InvalidValueError: The robot is no FR3.
    """
    _check_name(robot)
    return replace(robot, armature=_ROTORS, damping=_DAMPING, dry_friction=_FRICTION)


class DrivenArm(Simulation):
    """Stands for an arm that libfranka moves: what is told of it is written into a scene.

    Joints, velocities, width of the fingers and the force on the tool are those that the robot
    tells. Other contact forces are not measured, and 0. There is no camera: an object is where it
    was placed until the hand tells of a grasp, moves with the tool while that lasts, and stays
    where it was let go. Nothing is simulated.

    The hand moves while the arm stands, and time stands still then.
    """

    def __init__(
        self, robot: Robot, build_scene: BuildScene, host: str, *, drawn: bool = True
    ) -> None:
        """Connect and read; nothing moves before `step` or `command_grip`.

        Args:
            robot: The arm; it has seven joints and one gripper.
            build_scene: Adds what stands around the arm, which nobody measures.
            host: Address of the robot.
            drawn: See `Simulation`.

        Raises:
            InvalidValueError: The robot is no FR3.
            MissingExtraError, ArmStopped: See `Link`.
            UnknownNameError, ModelError: See `Simulation`.
        """
        _check_name(robot)
        self.link = Link(host)
        self._bare: Arm = bare_arm(robot)
        self._tau_d, self._ready = np.zeros(JOINTS), False
        self._grip = Grip(width=0.0, force=1.0)
        self._held: tuple[str, SE3] | None = None
        self._let_go: str | None = None
        self._told = {name: np.zeros(JOINTS) for name in ("tau_J", "tau_ext")}
        self._health = np.zeros(2)
        super().__init__(robot, build_scene, drawn=drawn)
        joints = robot.joints
        self.signals_last |= {
            Signal(name="franka/torque", labels=joints, unit="N·m"): (self._told["tau_J"],),
            Signal(name="franka/external_torque", labels=joints, unit="N·m"): (
                self._told["tau_ext"],
            ),
            Signal(name="franka/commands", labels=("success_rate", "lost"), unit="-"): (
                self._health,
            ),
        }
        self._views_last = [view for views in self.signals_last.values() for view in views]

    def report(self) -> list[str]:
        """Return what is known of the arm before it moves, as lines of text."""
        state, q = self.link.state, self.true_state().q
        T_base_tool = np.array(state.O_T_EE).reshape(4, 4).T
        off = T_base_tool[:3, 3] - self.tool_pose().translation()
        weight = np.abs(np.array(state.tau_J) - self._gravity())
        width = 1e3 * self.link.hand.width
        found = [
            f"the arm is in mode {state.robot_mode.name}, {self.from_home().max():.3f} rad from "
            f"home; the hand is open {width:.1f} mm",
            f"its tool is {1e3 * float(np.linalg.norm(off)):.1f} mm from where the model has it; "
            f"its torques differ from the model's by {weight.max():.2f} N·m at most",
            f"its joints are {np.degrees(min(q - self._bare.q_min)):.0f}° from their lower ends, "
            f"{np.degrees(min(self._bare.q_max - q)):.0f}° from their upper ones, at least",
        ]
        for name in self.objects:
            x, y, z = self.object_pose(name).translation()
            found.append(
                f"the {name} is taken to be at {x:.3f}, {y:.3f}, {z:.3f} m: nothing looks for it"
            )
        return found

    def get_ready(self) -> None:
        """Make arm and hand ready to move, once; see `Link.prepare`.

        Raises:
            ArmStopped: The robot takes no motion.
        """
        if not self._ready:
            self.link.prepare()
            self._ready = True

    @property
    def start(self) -> Vector:
        """See `Simulation.start`: where the arm is."""
        return self.true_state().q

    def reset(self) -> None:
        """Take what the arm tells for the start; it does not move."""
        mujoco.mj_resetData(self.model, self.data)
        self._contact.reset()
        self.link.look()
        self._held, self._let_go, self._tau_d[:] = None, None, 0.0
        self._q.write(np.array(self.link.state.q))
        self._write_hand()
        mujoco.mj_forward(self.model, self.data)
        self._motors.start(self._gravity())
        self._ctrl.flush()
        mujoco.mj_step1(self.model, self.data)
        self.data.qacc[:] = 0.0

    def step(self, tau: Vector) -> None:
        """Command torques (n,) [N·m] for a period, and wait for what the robot tells after it.

        They are held within tau_max, and within tau_rate_max with and without gravity.

        Raises:
            ArmStopped: The torques are not finite, or the robot has stopped; see `Link`.
        """
        try:
            if not self.link.active:
                self._begin()
            gravity = self._gravity()
            self._motors.deliver(tau)
        except InvalidValueError as error:
            self.stand_by()
            raise ArmStopped(str(error)) from error
        step = _RATE * self.robot.tau_rate_max * TIMESTEP
        wanted = self._ctrl.whole - gravity
        np.clip(wanted, self._tau_d - step, self._tau_d + step, out=self._tau_d)
        self._ctrl.write(self._tau_d + gravity)
        self._exchange()

    def stand_by(self) -> bool:
        """Bring the arm to rest, let the robot hold it, and read the hand; return True.

        Raises:
            ArmStopped: The robot has stopped otherwise.
        """
        if self.link.active:
            step = self.robot.tau_rate_max * TIMESTEP
            for _ in range(_LONGEST):
                v = self.true_state().v
                if np.abs(v).max() < _AT_REST:
                    break
                wanted = -_BRAKING * v
                np.clip(wanted, self._tau_d - step, self._tau_d + step, out=self._tau_d)
                self._exchange()
            self.link.finish(self._tau_d)
            self._tau_d[:] = 0.0
        self.link.look()
        self._write_hand()
        return True

    def close(self) -> None:
        """Stop the arm, whatever it does, and leave it; one that has stopped by itself is left."""
        if self.link.active:
            with suppress(ArmStopped):
                self.stand_by()
        self.link.close()

    def command_grip(self, grip: Grip, tool: int = 0) -> None:
        """Move the fingers, and wait for them; the arm stands still.

        Raises:
            InvalidValueError, NoGripperError: See `Simulation.command_grip`.
            ArmStopped: The hand has failed, or the robot takes no motion.
        """
        super().command_grip(grip, tool)
        self.get_ready()
        self.stand_by()
        speed = min(grip.speed, self.gripper_of(tool).speed_max)
        self._grip = grip
        # Fingers that close to a width are to stand there; those that close fully are to press.
        self.link.grip(grip.width, speed, None if grip.width > 0.0 else grip.force)
        self._write_hand()

    def grip_settled(self, tool: int = 0) -> bool:
        """Return True: a command to the hand returns when it is done."""
        return True

    def last_finger_forces(self, tool: int = 0) -> Vector:
        """Return the force that was commanded, on each finger while something is held (2,) [N]."""
        return np.full(2, self._grip.force if self._held is not None else 0.0)

    def look_at_friction(self) -> None:
        """Do nothing: friction at the fingers is not measured."""

    def _begin(self) -> None:
        """Begin to control torques where the arm is."""
        self.get_ready()
        self.link.start()
        self._tau_d[:] = 0.0
        self._motors.start(self._gravity())

    def _exchange(self) -> None:
        self.link.exchange(self._tau_d)
        self._write_state()

    def _gravity(self) -> Vector:
        """Return what the robot adds to commanded torques (n,) [N·m]: the one place that knows it.

        It is that of the arm with its hand. What the hand carries is in the controller's torques.
        """
        still = np.zeros(JOINTS)
        return self._bare.inverse_dynamics(self.true_state().q, still, still)

    def _write_state(self) -> None:
        """Write what the robot has told into the scene."""
        state, d = self.link.state, self.data
        q, v = np.array(state.q), np.array(state.dq)
        self._a.write((v - self._v.read()) / TIMESTEP)
        self._q.write(q)
        self._v.write(v)
        self._tau.write(self._ctrl.whole)
        d.time += TIMESTEP
        mujoco.mj_kinematics(self.model, d)
        self._told["tau_J"][:], self._told["tau_ext"][:] = state.tau_J, state.tau_ext_hat_filtered
        self._health[:] = state.control_command_success_rate, self.link.lost
        whole, within, _ = self._contact.tool_forces
        # Both libfranka and a sensor of MuJoCo tell the force of the tool on others.
        whole[0][:], within[0][:] = state.O_F_ext_hat_K[:3], 0.0
        if self._held is not None:
            name, T_tcp_object = self._held
            self._bodies.carry(name, self.tool_pose() @ T_tcp_object)
        elif self._let_go is not None:
            self._bodies.rest(self._let_go)

    def _write_hand(self) -> None:
        """Write what the hand tells, and take note of what it has grasped or let go."""
        hand = self.link.hand
        for fingers in self._hands:
            if fingers is not None:
                fingers.show(float(hand.width))
        holds = bool(hand.is_grasped) and hand.width > self._grip.width + _HELD
        if not holds:
            if self._held is not None:
                self._let_go = self._held[0]
            self._held = None
        elif self._held is None:
            self._held = self._grasped()
        mujoco.mj_kinematics(self.model, self.data)

    def _grasped(self) -> tuple[str, SE3] | None:
        """Return the object at the tool point, and T_tcp_object; None if there is none."""
        T_tcp_world, nearest, found = self.tool_pose().inverse(), inf, None
        for name in self.objects:
            T_tcp_object = T_tcp_world @ self.object_pose(name)
            distance = float(np.linalg.norm(T_tcp_object.translation()))
            if distance < min(nearest, _NEAR):
                nearest, found = distance, (name, T_tcp_object)
        return found


def _check_name(robot: Robot) -> None:
    if robot.name != "fr3" or len(robot.joints) != JOINTS:
        raise InvalidValueError("--robot", robot.name, "fr3 with --at, the robot of libfranka")
