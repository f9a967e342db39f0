"""Simulation: robot and objects in MuJoCo."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.constants import MANY
from robo47_qp.errors import NoGripperError
from robo47_qp.model.arm import JointState
from robo47_qp.model.gripper import Grip, Gripper
from robo47_qp.model.obstacle import Obstacle
from robo47_qp.model.robot import Robot
from robo47_qp.sim.columns import Columns, spans
from robo47_qp.sim.compiled import CompiledWorld, compiled_world
from robo47_qp.sim.contact import ContactSensing
from robo47_qp.sim.friction_use import FrictionUse
from robo47_qp.sim.gripper import SimulatedGripper
from robo47_qp.sim.motors import SimulatedMotors
from robo47_qp.sim.objects import SimulatedObjects
from robo47_qp.sim.scene import MOUNT_GEOMS, BuildScene, compile_scene, fixed_obstacle
from robo47_qp.sim.sensing import MASS_TOLERANCE, SIZE_TOLERANCE, SensorErrors, figures
from robo47_qp.sim.signal import POSE, POSE_UNIT, Signal

_EXACT = {**figures(SensorErrors()), MASS_TOLERANCE: 0.0, SIZE_TOLERANCE: 0.0}


class Simulation:
    """Simulates robot and objects in MuJoCo, stepped with joint torques.

    Positions, velocities and poses are those at `time`. Accelerations, forces and torques of the
    period that ended then are named `last_...`.
    """

    def __init__(self, robot: Robot, build_scene: BuildScene, *, drawn: bool = True) -> None:
        """Compile the scene and put the robot at home, at rest, with its gripper open.

        Args:
            robot: The robot to simulate, its base at the world's origin.
            build_scene: Adds the task's bodies.
            drawn: Whether `model` holds what of the robot is there to be seen only. The motion is
                the same to the bit without it, and takes less time.

        Raises:
            UnknownNameError, ModelError: See `compile_scene`.
        """
        self.robot = robot
        self.model = compile_scene(robot, build_scene, drawn=drawn)
        self.data = mujoco.MjData(self.model)
        self._bodies = SimulatedObjects(self.model, self.data)
        self.objects, self.markers = self._bodies.objects, self._bodies.markers
        m, d = self.model, self.data  # whose arrays keep their place: each view is taken once
        joint_ids = [m.joint(name) for name in robot.joints]
        self._free = ~m.jnt_limited[[joint.id for joint in joint_ids]].astype(bool)
        at_q = spans([int(joint.qposadr[0]) for joint in joint_ids])
        at_v = spans([int(joint.dofadr[0]) for joint in joint_ids])
        self._q, self._v, self._a = (
            Columns(array, at) for array, at in ((d.qpos, at_q), (d.qvel, at_v), (d.qacc, at_v))
        )
        self._bias, self._passive = Columns(d.qfrc_bias, at_v), Columns(d.qfrc_passive, at_v)
        self._ctrl = Columns(d.ctrl, spans([m.actuator(name).id for name in robot.motors]))
        self._tau = Columns(d.qfrc_actuator, at_v)
        sites = [m.site(tool.tcp).id for tool in robot.tools]
        self._tcps = [(d.site_xpos[site], d.site_xquat[site]) for site in sites]
        self._hands = [
            None if tool.gripper is None else SimulatedGripper(tool.gripper, m, d, label)
            for label, tool in robot.tool_labels()
        ]
        self._grippers = hands = [hand for hand in self._hands if hand is not None]
        self._beside = mujoco.MjData(m)
        self._frictions = [
            FrictionUse(tool.gripper, m, d, label)
            for label, tool in robot.tool_labels()
            if tool.gripper is not None
        ]
        self._contact = ContactSensing(m, d, [label for label, _ in robot.tool_labels()])
        joints, unit = robot.joints, robot.unit
        self.signals_now: dict[Signal, tuple[Vector, ...]] = {
            Signal(name="joints/q", labels=joints, unit=unit("rad", "m")): self._q.views,
            Signal(name="joints/v", labels=joints, unit=unit("rad/s", "m/s")): self._v.views,
            **{
                Signal(name=f"tool/{label}pose", labels=POSE, unit=POSE_UNIT): tcp
                for (label, _), tcp in zip(robot.tool_labels(), self._tcps, strict=True)
            },
            **{signal: views for hand in hands for signal, views in hand.signals_now.items()},
            **self._bodies.signals_now,
        }
        """Signals at `time`, each with the views of MjData that hold its columns."""
        self.signals_last: dict[Signal, tuple[Vector, ...]] = {
            Signal(name="joints/a", labels=joints, unit=unit("rad/s²", "m/s²")): self._a.views,
            Signal(name="joints/tau", labels=joints, unit=unit("N·m", "N")): self._tau.views,
            **self._contact.signals_last,
            **self._bodies.signals_last,
            **{signal: views for hand in hands for signal, views in hand.signals_last.items()},
            **{signal: it for one in self._frictions for signal, it in one.signals_last.items()},
        }
        """Signals of the last period, likewise."""
        self._views_now = [view for views in self.signals_now.values() for view in views]
        self._views_last = [view for views in self.signals_last.values() for view in views]
        self._motors = SimulatedMotors(robot, self._ctrl.whole)
        columns, views = (self._q, self._v, self._ctrl), (self._views_now, self._views_last)
        self._compiled = compiled_world(robot, m, d, columns, hands, self._contact, views)
        self.lately: Callable[[str], Matrix] | None = None
        """Returns the values of a signal in the control periods since the last look at the world
        (N, size), from who records them; None where nobody does."""
        self.reset()

    def reset(self) -> None:
        """Put the robot at home, held at rest, its gripper open, and the objects at their start."""
        mujoco.mj_resetData(self.model, self.data)
        self._bodies.reset()
        self.lately = None
        self._contact.reset()
        self._q.write(self.robot.home)
        for hand in self._grippers:
            hand.reset()
        mujoco.mj_forward(self.model, self.data)
        self._motors.start(self._bias.read() - self._passive.read())
        self._ctrl.flush()
        mujoco.mj_step1(self.model, self.data)

    def step(self, tau: Vector) -> None:
        """Apply the commanded joint torques (n,) [N·m] for one period.

        A motor delivers the torque closest to the command within tau_max, and within
        tau_rate_max of its last torque.

        Raises:
            InvalidValueError: The command is not finite, or not (n,); nothing has moved.
        """
        self._motors.deliver(tau)
        self._ctrl.flush()
        for hand in self._grippers:
            hand.move()
        mujoco.mj_step2(self.model, self.data)
        mujoco.mj_step1(self.model, self.data)

    @property
    def start(self) -> Vector:
        """Joint positions (n,) that `reset` leads to [rad or m]: here, home."""
        return np.array(self.robot.home)

    def stand_by(self) -> bool:
        """Bring to rest what goes on outside of `step`; return whether: here, nothing does."""
        return False

    def from_home(self) -> Vector:
        """Return how far each joint is from home (n,) [rad or m].

        Whole turns of a joint without limits count as none.
        """
        away = self.true_state().q - self.robot.home
        turns = np.round(away / (2.0 * np.pi)) * self._free
        distance: Vector = np.abs(away - 2.0 * np.pi * turns)
        return distance

    @property
    def compiled(self) -> CompiledWorld | None:
        """The same world in the compiled core; None where only Python can go on with it."""
        return self._compiled if type(self) is Simulation else None

    def ahead(self) -> int:
        """Return how many periods the core may go on from now, all ready; 0 where Python has to."""
        return MANY

    def look(self) -> None:
        """Let a camera take and show what is due after periods in the core: here, there is none."""

    def gripper_of(self, tool: int = 0) -> Gripper:
        """Return the gripper of a tool, by its place in `Robot.tools`, as everywhere below.

        Raises:
            NoGripperError: The tool has no gripper.
        """
        return self._needed("the task", tool).gripper

    def command_grip(self, grip: Grip, tool: int = 0) -> None:
        """Start moving the fingers of a tool to a width, with a bounded speed and force.

        Raises:
            InvalidValueError: Width or force is outside the limits of the gripper.
            NoGripperError: The tool has no gripper.
        """
        self._needed("a grip", tool).command(grip)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self.data.time)

    def write_now(self, row: Vector) -> None:
        """Write the columns of `signals_now` into a row."""
        np.concatenate(self._views_now, out=row)

    def write_last(self, row: Vector) -> None:
        """Write the columns of `signals_last` into a row."""
        self._contact.update()
        np.concatenate(self._views_last, out=row)

    def state(self) -> JointState:
        """Return the measured joint positions and velocities."""
        return JointState(self._q.read(), self._v.read())

    def true_state(self) -> JointState:
        """Return the true joint positions and velocities."""
        return JointState(self._q.read(), self._v.read())

    def tool_pose(self, tool: int = 0) -> SE3:
        """Return T_world_tcp of a tool."""
        position, quaternion = self._tcps[tool]
        return SE3(np.concatenate([quaternion, position]))

    def width(self, tool: int = 0) -> float:
        """Return the opening width of a gripper [m]."""
        return self._needed("its width", tool).width()

    def width_speed(self, tool: int = 0) -> float:
        """Return the rate of the opening width [m/s]."""
        return self._needed("its width", tool).width_speed()

    def width_command(self, tool: int = 0) -> float:
        """Return the setpoint of a gripper's servo on the opening width [m]."""
        return self._needed("its width", tool).width_command()

    def grip_settled(self, tool: int = 0) -> bool:
        """Return whether the fingers stand still, at the commanded width or at the full force."""
        return self._needed("a grip", tool).settled()

    def last_acceleration(self) -> Vector:
        """Return the joint accelerations in the last period (n,) [rad/s²]."""
        return self._a.read()

    def last_torque(self) -> Vector:
        """Return the torques that the motors delivered in the last period (n,) [N·m]."""
        return self._tau.read()

    def motor_torque(self) -> Vector:
        """Return the torques that the motors were set to last (n,) [N·m]."""
        return self._ctrl.whole.copy()

    def last_finger_forces(self, tool: int = 0) -> Vector:
        """Return the magnitude of the net contact force on each finger of a tool (2,) [N]."""
        return self._needed("the force of its fingers", tool).forces()

    def last_tool_force(self, tool: int = 0) -> Vector:
        """Return the net contact force on a tool in the last period (3,), in the world [N].

        From outside on the body of the last joint and all that it carries, without inertia and
        weight: +z for a hand that presses on a table.
        """
        return self._contact.tool_force(tool)

    def felt_force(self, tool: int = 0) -> Vector:
        """Return `last_tool_force` as measured for controllers (3,) [N]: here, the true one."""
        return self._contact.tool_force(tool)

    def fixed_force_peak(self, tool: int = 0) -> float:
        """Return the largest sum of a tool's contact forces with what stands fixed [N].

        Since the last call; what the tool holds does not count as the tool.
        """
        return self._contact.fixed_peak(tool)

    def last_links_force(self) -> float:
        """Return the sum of contact force magnitudes on the links in the last period [N].

        The tool does not count. Forces between links do, which would cancel in a net force.
        """
        return self._contact.links_force()

    def object_pose(self, name: str) -> SE3:
        """Return T_world_object.

        Raises:
            UnknownNameError: No free body has this name.
        """
        return self._bodies.pose(name)

    def seen_pose(self, name: str) -> SE3:
        """Return T_world_object as the camera of the cell measures it: here, the true one.

        Raises:
            UnknownNameError: No free body has this name.
        """
        return self.object_pose(name)

    def seen_marker(self, name: str) -> SE3:
        """Return T_world_marker as the camera measures it, or as it is asked for: the true one.

        Raises:
            UnknownNameError: No marker has this name.
        """
        return self.marker_pose(name)

    def seen_time(self, name: str) -> float:
        """Return when the last frame with an object or a marker in it was taken: here, now [s].

        Raises:
            UnknownNameError: Nothing has this name.
        """
        if name not in self.objects and name not in self.markers:
            self.marker_pose(name)
        return self.time

    @property
    def payload_factor(self) -> float:
        """Told mass and moments of payloads relative to the true ones [-]: here, 1."""
        return 1.0

    @property
    def joint_data_sheet(self) -> tuple[float, float, float, float]:
        """Of measured positions the noise [rad], then mean delays of state and command, jitter [s].

        As a data sheet says them, noise and jitter as standard deviations: here, 0.
        """
        return 0.0, 0.0, 0.0, 0.0

    @property
    def noise_figures(self) -> dict[str, Any]:
        """Figures of sensors, lines and objects by data sheets, as in `CellSheet`: here, exact."""
        return dict(_EXACT)

    def object_twist(self, name: str) -> Vector:
        """Return the velocity (6,) as `SimulatedObjects` has it: linear [m/s], angular [rad/s]."""
        return self._bodies.twist(name)

    def place_object(self, name: str, T_world_object: SE3) -> None:
        """Put a free body at a pose, at rest.

        Raises:
            UnknownNameError: No free body has this name.
        """
        self._bodies.place(name, T_world_object)

    def look_at_friction(self) -> None:
        """Bring the signals of the friction in use at the fingers up to date.

        It solves for the contact forces once more, so that it is no part of every period.
        """
        for friction in self._frictions:
            friction.update(self._solved_beside)

    def _solved_beside(self) -> mujoco.MjData:
        mujoco.mj_copyData(self._beside, self.model, self.data)
        mujoco.mj_forward(self.model, self._beside)
        return self._beside

    def fixed(self) -> tuple[Obstacle, ...]:
        """Return what stands fixed and can be touched, where it is now, but for the robot's mount.

        Raises:
            ModelError: A shape is none of `Shape`.
        """
        m = self.model
        mount = int(m.numeric(MOUNT_GEOMS).data[0])
        own = np.flatnonzero(m.geom_bodyid == 0)[:mount].tolist()
        return tuple(
            fixed_obstacle(m, self.data, geom)
            for geom in self._contact.fixed_geoms
            if geom not in own
        )

    def set_friction(self, name: str, friction: float) -> None:
        """Set the coefficient of sliding friction of a free body's geoms [-].

        A contact has the larger one of both geoms, so that an object's own counts on fingers,
        table and belt, which have the smallest.

        Raises:
            UnknownNameError: No free body has this name.
        """
        self._bodies.set_friction(name, friction)

    def marker_pose(self, name: str) -> SE3:
        """Return T_world_marker of a mocap body, which only the program moves.

        Raises:
            UnknownNameError: No marker has this name.
        """
        return self._bodies.marker_pose(name)

    def place_marker(self, name: str, T_world_marker: SE3) -> None:
        """Put a marker at a pose.

        Raises:
            UnknownNameError: No marker has this name.
        """
        self._bodies.place_marker(name, T_world_marker)

    def _needed(self, wanted: str, tool: int) -> SimulatedGripper:
        hand = self._hands[tool]
        if hand is None:
            raise NoGripperError(self.robot.name, wanted)
        return hand
