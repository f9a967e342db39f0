"""ServedArm: a simulated arm that does what libfranka's commands say, and refuses what it must."""

import numpy as np
from mink import SE3, SO3
from numpy.typing import NDArray

from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import JointState, bare_arm
from robo47_qp.sim.franka import protocol
from robo47_qp.sim.franka.limits import (
    LOST_MAX,
    JointCommands,
    ToolCommands,
    measured_error,
    torque_error,
)
from robo47_qp.sim.franka.protocol import Controller, Generator, RobotMode
from robo47_qp.sim.simulation import Simulation

_FREQUENCY = 60.0
"""Natural frequency of the joints where the robot itself controls them [rad/s]."""
_FLANGE = SE3.from_translation(np.array([0.0, 0.0, 0.107]))
"""Pose of the flange in the frame of the last link (Franka, Denavit-Hartenberg parameters)."""
_FILTER = 0.3
"""Share of a new value in the filtered external forces [-]."""
_THRESHOLD = 100.0
"""External torques [N·m] and forces [N] that are a collision, until a client sets others."""
_DAMPING, _STEPS = 1e-4, 3
"""Damping and steps of the inverse kinematics of a period."""
_WINDOW = 100
"""Periods that the success rate tells of."""


class ServedArm:
    """The arm of a simulation as a libfranka robot: modes, motions, limits and errors."""

    def __init__(self, simulation: Simulation) -> None:
        """Serve the robot of a simulation.

        Raises:
            InvalidValueError: The robot is no arm with seven joints and one tool.
        """
        robot = simulation.robot
        if len(robot.joints) != protocol.JOINTS or len(robot.tools) != 1:
            raise InvalidValueError("robot", robot.name, "an arm with seven joints and one tool")
        self.sim, self._bare = simulation, bare_arm(robot)
        self._state = np.zeros((), protocol.STATE)
        self._message = {name: self._state[name] for name in protocol.STATE.names or ()}
        self._T_flange_tcp = _flange_to_tool(simulation)
        self._ee = _what_is_mounted(simulation)
        self._q_d, self._v_d, self._a_d = simulation.true_state().q, np.zeros(7), np.zeros(7)
        """What the joints are to do where the robot itself controls them."""
        self._pose_of: Vector | None = None
        """The `_q_d` whose pose the message holds."""
        self._last: np.void | None = None
        self.reset()

    def reset(self) -> None:
        """Forget what earlier clients have set, and hold the arm where it is."""
        self.mode, self.generator, self.controller = (
            RobotMode.IDLE,
            Generator.IDLE,
            Controller.OTHER,
        )
        self.errors: list[str] = []
        self.reflex_reason: list[str] = []
        self._load = (0.0, np.zeros(3), np.zeros(9))
        self.T_ne_ee, self.T_ee_k = SE3.identity(), SE3.identity()
        self.torque_limits = np.full(7, _THRESHOLD)
        self.force_limits = np.full(6, _THRESHOLD)
        self._tau_d = np.zeros(7)
        self._ext, self._ext_k, self._tau_ext = np.zeros(6), np.zeros(6), np.zeros(7)
        self._rest()
        self._describe()

    @property
    def moving(self) -> bool:
        """Whether a client moves the arm."""
        return self.mode is RobotMode.MOVE

    def set_load(self, mass: float, com: Vector, inertia: Vector) -> None:
        """Tell the robot what it carries, in the frame of its flange.

        Args:
            mass: Mass, whose weight the robot then bears [kg].
            com: Its centre (3,) [m].
            inertia: Its inertia, by columns (9,), which is told back only [kg m²].
        """
        self._load = (mass, com, inertia)
        self._describe()

    def set_frames(self, T_ne_ee: SE3 | None = None, T_ee_k: SE3 | None = None) -> None:
        """Set the frame of the tool on that of the hand, or that of stiffness on the tool's."""
        self.T_ne_ee = self.T_ne_ee if T_ne_ee is None else T_ne_ee
        self.T_ee_k = self.T_ee_k if T_ee_k is None else T_ee_k
        self._rest()
        self._describe()

    def start(self, controller: Controller, generator: Generator) -> None:
        """Start a motion, from rest where the robot holds the arm."""
        self.mode, self.controller, self.generator = RobotMode.MOVE, controller, generator
        self.reflex_reason = []
        self._describe()
        self._tau_d = np.zeros(7)
        self._joints = JointCommands(self._q_d)
        self._tool = ToolCommands(self._tool_pose(self._q_d))
        self._last = None
        self._lost, self._answered = 0, [1.0] * _WINDOW

    def stop(self, at: Vector | None = None) -> None:
        """End a motion, and hold the joints at positions (7,) [rad]; None is where they are."""
        self.mode, self.generator, self.controller = (
            RobotMode.IDLE,
            Generator.IDLE,
            Controller.OTHER,
        )
        self._tau_d = np.zeros(7)
        self._rest(at)

    def recover(self) -> None:
        """Clear the errors of a reflex."""
        self.errors = []
        self.mode = RobotMode.IDLE
        self._describe()

    def reflex(self, error: str) -> None:
        """Stop because of an error."""
        self.stop()
        self.mode, self.errors, self.reflex_reason = RobotMode.REFLEX, [error], [error]
        self._describe()

    def advance(self, command: np.void | None) -> bool:
        """Let a period pass.

        Args:
            command: The client's, of type `protocol.COMMAND`; None where none has come.

        Returns:
            Whether a motion that was going on has ended, by the client or by a reflex.
        """
        moving, error = self.moving, None
        state = self.sim.true_state()
        tau = None
        if moving:
            error = self._taken(command)
            if error is None and self.controller is Controller.EXTERNAL:
                tau, error = self._external(state)
        if error is not None:
            self.reflex(error)
            tau = None
        self.sim.step(self._held(state) if tau is None else tau)
        self._feel()
        if self.moving:
            error = measured_error(*self.sim.true_state()) or self._collision()
            if error is not None:
                self.reflex(error)
            elif self._finished:
                self.stop(at=self._q_d)
        return moving and not self.moving

    def packed(self, message_id: int) -> bytes:
        """Return the state as a message."""
        now = self._message
        q, v = self.sim.true_state()
        now["id"][...] = message_id
        for name in ("q", "theta"):
            now[name][...] = q
        for name in ("dq", "dtheta"):
            now[name][...] = v
        now["O_T_EE"][...] = self._columns(self.sim.tool_pose() @ self.T_ne_ee)
        if self._pose_of is not self._q_d:
            self._pose_of, columns = self._q_d, self._columns(self._tool_pose(self._q_d))
            now["O_T_EE_d"][...] = now["O_T_EE_c"][...] = columns
        now["q_d"][...], now["dq_d"][...], now["ddq_d"][...] = self._q_d, self._v_d, self._a_d
        now["tau_J"][...], now["tau_J_d"][...] = self.sim.motor_torque(), self._tau_d
        now["elbow"][...] = q[2], np.sign(q[3])
        now["elbow_d"][...] = now["elbow_c"][...] = self._q_d[2], np.sign(self._q_d[3])
        now["tau_ext"][...], now["O_F_ext"][...] = self._tau_ext, self._ext
        now["K_F_ext"][...] = self._ext_k
        now["generator"][...], now["controller"][...] = self.generator, self.controller
        now["robot_mode"][...] = self.mode
        now["success_rate"][...] = sum(self._answered) / _WINDOW if self.moving else 0.0
        return self._state.tobytes()

    def _describe(self) -> None:
        """Fill what of the state changes by requests only."""
        now, (mass, com, inertia) = self._message, self._ee
        now["F_T_EE"][...] = self._columns(self._T_flange_tcp @ self.T_ne_ee)
        now["F_T_NE"][...] = self._columns(self._T_flange_tcp)
        now["NE_T_EE"][...], now["EE_T_K"][...] = map(self._columns, (self.T_ne_ee, self.T_ee_k))
        now["m_ee"][...], now["F_x_Cee"][...], now["I_ee"][...] = mass, com, inertia.T.ravel()
        now["m_load"][...], now["F_x_Cload"][...], now["I_load"][...] = self._load
        now["O_ddP_O"][...] = self._bare.model.opt.gravity
        for name, found in (("errors", self.errors), ("reflex_reason", self.reflex_reason)):
            now[name][...] = [error in found for error in protocol.ERRORS]

    def _taken(self, command: np.void | None) -> str | None:
        """Take a command, or do without; return the error, or None."""
        self._answered = [*self._answered[1:], float(command is not None)]
        self._finished = False
        if command is None:
            self._lost += 1
            return "communication_constraints_violation" if self._lost >= LOST_MAX else None
        self._lost, self._last = 0, command
        self._finished = bool(command["motion_finished"] or command["torque_finished"])
        kind = self.generator
        if kind is Generator.JOINT_POSITION:
            error = self._joints.position(np.array(command["q"]))
        elif kind is Generator.JOINT_VELOCITY:
            error = self._joints.velocity(np.array(command["dq"]))
        elif kind in (Generator.CARTESIAN_POSITION, Generator.CARTESIAN_VELOCITY):
            error = self._of_tool(command, kind)
        else:
            return None
        if error is None:
            self._q_d, self._v_d, self._a_d = self._joints.q, self._joints.v, self._joints.a
        return error

    def _of_tool(self, command: np.void, kind: Generator) -> str | None:
        """Take a pose or a twist; the joints follow by inverse kinematics."""
        if kind is Generator.CARTESIAN_POSITION:
            matrix = np.array(command["O_T_EE"]).reshape(4, 4).T
            if not np.allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-5):
                return "cartesian_position_motion_generator_invalid_frame_flag"
            rotation = SO3.from_matrix(matrix[:3, :3])
            error = self._tool.target(
                SE3.from_rotation_and_translation(rotation, matrix[:3, 3].copy())
            )
        else:
            error = self._tool.twist(np.array(command["O_dP_EE"]))
        if error is not None:
            return error
        target, q = self._tool.pose @ self.T_ne_ee.inverse(), self._q_d.copy()
        for _ in range(_STEPS):
            twist = (self._bare.pose(q).inverse() @ target).log()
            J = self._bare.jacobian(q)
            q = q + J.T @ np.linalg.solve(J @ J.T + _DAMPING**2 * np.eye(6), twist)
        return self._joints.of_tool(q)

    def _external(self, state: JointState) -> tuple[Vector | None, str | None]:
        """Return the torque (7,) of the client with gravity [N·m], or the error."""
        still = np.zeros(7)
        gravity = self._bare.inverse_dynamics(state.q, still, still) + self._load_torque(state.q)
        tau = self._tau_d if self._last is None else np.array(self._last["tau"])
        error = torque_error(tau, self._tau_d, gravity)
        if error is not None:
            return None, error
        self._tau_d = tau
        if self.generator is Generator.NONE:
            # Where the client lets go, the robot takes over there.
            self._q_d, self._v_d, self._a_d = state.q, still, still
        return tau + gravity, None

    def _held(self, state: JointState) -> Vector:
        """Return the torque (7,) with which the robot itself follows its reference [N·m]."""
        a = self._a_d + _FREQUENCY**2 * (self._q_d - state.q)
        a = a + 2.0 * _FREQUENCY * (self._v_d - state.v)
        return self._bare.inverse_dynamics(state.q, state.v, a) + self._load_torque(state.q)

    def _load_torque(self, q: Vector) -> Vector:
        """Return the torques (7,) that bear the weight of the load [N·m]."""
        mass, com, _ = self._load
        if mass == 0.0:
            return np.zeros(7)
        centre = self._T_flange_tcp.inverse().apply(com)
        J = self._bare.jacobian(q)
        at_centre = J[:3] - np.cross(centre, J[3:], axisb=0).T
        lift = -mass * self._bare.pose(q).rotation().inverse().apply(self._bare.model.opt.gravity)
        tau: Vector = at_centre.T @ lift
        return tau

    def _rest(self, at: Vector | None = None) -> None:
        q = self.sim.true_state().q if at is None else at
        self._q_d, self._v_d, self._a_d = q, np.zeros(7), np.zeros(7)
        self._pose_of = None
        self._joints, self._finished = JointCommands(self._q_d), False
        self._lost, self._answered = 0, [0.0] * _WINDOW

    def _feel(self) -> None:
        """Estimate the force of the tool on others, and the torques that make it.

        By its signs, `tau_J` is `tau_ext` and what the model expects (libfranka, `RobotState`).
        """
        force = self._load[0] * self._bare.model.opt.gravity - self.sim.last_tool_force()
        if not (force.any() or self._ext.any()):
            return
        self._ext[:3] += _FILTER * (force - self._ext[:3])
        turned = self.sim.tool_pose().rotation().inverse().apply(self._ext[:3])
        self._tau_ext = self._bare.jacobian(self.sim.true_state().q)[:3].T @ turned
        R_k_tool = (self.T_ne_ee @ self.T_ee_k).rotation().inverse()
        self._ext_k[:3] = R_k_tool.apply(turned)

    def _collision(self) -> str | None:
        if (np.abs(self._ext) > self.force_limits).any():
            return "cartesian_reflex"
        return "joint_reflex" if (np.abs(self._tau_ext) > self.torque_limits).any() else None

    def _tool_pose(self, q: Vector) -> SE3:
        return self._bare.pose(q) @ self.T_ne_ee

    @staticmethod
    def _columns(T: SE3) -> Vector:
        columns: Vector = T.as_matrix().T.ravel()
        return columns


def _flange_to_tool(simulation: Simulation) -> SE3:
    """Return T_flange_tcp."""
    m, d, robot = simulation.model, simulation.data, simulation.robot
    last = int(m.joint(robot.joints[-1]).bodyid[0])
    T_world_link = SE3(np.concatenate([d.xquat[last], d.xpos[last]]))
    return (T_world_link @ _FLANGE).inverse() @ simulation.tool_pose()


def _what_is_mounted(simulation: Simulation) -> tuple[float, Vector, Vector]:
    """Return mass [kg], centre (3,) [m] and inertia (3, 3) [kg m²] beyond the flange, in its frame.

    The inertia is that about the centre of mass.
    """
    m, d, robot = simulation.model, simulation.data, simulation.robot
    last = int(m.joint(robot.joints[-1]).bodyid[0])
    T = (SE3(np.concatenate([d.xquat[last], d.xpos[last]])) @ _FLANGE).inverse()
    bodies = [b for b in range(last + 1, m.nbody) if _below(m.body_parentid, b, last)]
    mass = float(sum(m.body_mass[b] for b in bodies))
    if mass == 0.0:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    centres = {b: T.apply(d.xipos[b]) for b in bodies}
    com: Vector = np.array(sum(m.body_mass[b] * centres[b] for b in bodies)) / mass
    inertia = np.zeros((3, 3))
    for b in bodies:
        R = T.rotation().as_matrix() @ d.ximat[b].reshape(3, 3)
        r = centres[b] - com
        inertia += R @ np.diag(m.body_inertia[b]) @ R.T
        inertia += m.body_mass[b] * (float(r @ r) * np.eye(3) - np.outer(r, r))
    return mass, com, inertia


def _below(parents: NDArray[np.int32], body: int, ancestor: int) -> bool:
    while body > 0:
        body = int(parents[body])
        if body == ancestor:
            return True
    return False
