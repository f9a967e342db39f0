"""What a Franka Research 3 takes of a client in a period, and libfranka's names of all else.

Limits are Franka's ("Robot and interface specifications",
https://frankarobotics.github.io/docs/control_parameters.html); offsets and decelerations of the
velocities near the ends of the joints are those of its description of the robot
(https://github.com/frankaemika/franka_description, robots/fr3).
"""

from dataclasses import dataclass

import numpy as np
from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.constants import TIMESTEP

Q_MIN = np.array([-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196])
Q_MAX = np.array([2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196])
V_MAX = np.array([2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26])
V_OFFSET = np.array([0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35])
DECELERATION = np.array([6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0])
TAU_MAX = np.array([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0])
TAU_RATE, JOINT_A, JOINT_J = 1000.0, 10.0, 5000.0
LINEAR, ANGULAR = (3.0, 9.0, 4500.0), (2.5, 17.0, 8500.0)
"""Velocity, acceleration and jerk of the tool: [m/s], [rad/s] and so on."""
LOST_MAX = 20
"""Commands lost in a row at which a motion ends."""
_ROUNDING = 1e-6
"""Relative tolerance for derivatives of rounded numbers [-]."""
_START = 1e-3
"""Largest distance of the first commanded joint position from where the arm is [rad]."""
_START_POSE = (5e-3, 2e-2)
"""The same of the pose of the tool [m], [rad]."""


def velocity_range(q: Vector) -> tuple[Vector, Vector]:
    """Return the least and the largest velocity (7,), (7,) at joint positions q (7,) [rad/s]."""
    up = np.sqrt(np.maximum(0.0, 2.0 * DECELERATION * (Q_MAX - q))) - V_OFFSET
    down = np.sqrt(np.maximum(0.0, 2.0 * DECELERATION * (q - Q_MIN))) - V_OFFSET
    return -np.clip(down, 0.0, V_MAX), np.clip(up, 0.0, V_MAX)


def torque_error(tau: Vector, last: Vector, gravity: Vector) -> str | None:
    """Return what is wrong with a torque (7,) after the last one, both without gravity [N·m]."""
    if (np.abs(tau + gravity) > TAU_MAX * (1.0 + _ROUNDING)).any():
        return "tau_J_range_violation"
    if (np.abs(tau - last) > TAU_RATE * TIMESTEP * (1.0 + _ROUNDING)).any():
        return "controller_torque_discontinuity"
    return None


def measured_error(q: Vector, v: Vector) -> str | None:
    """Return what is wrong with how the joints move: q, v (7,) [rad], [rad/s]."""
    if ((q < Q_MIN) | (q > Q_MAX)).any():
        return "joint_position_limits_violation"
    if (np.abs(v) > V_MAX * (1.0 + _ROUNDING)).any():
        return "joint_velocity_violation"
    return None


@dataclass(eq=False)
class Followed:
    """A commanded quantity with its derivatives, from one period to the next."""

    v: Vector
    a: Vector

    def follow(self, v: Vector) -> tuple[Vector, Vector]:
        """Take the next velocity; return acceleration and jerk."""
        a = (v - self.v) / TIMESTEP
        jerk = (a - self.a) / TIMESTEP
        self.v, self.a = v, a
        return a, jerk


class JointCommands:
    """Checks joint positions or velocities that a client commands, one after the other."""

    def __init__(self, q: Vector) -> None:
        """Start at rest at q (7,) [rad]."""
        self.q, self._followed, self._first = q.copy(), Followed(np.zeros(7), np.zeros(7)), True

    @property
    def v(self) -> Vector:
        """The commanded velocity (7,) [rad/s]."""
        return self._followed.v

    @property
    def a(self) -> Vector:
        """The commanded acceleration (7,) [rad/s²]."""
        return self._followed.a

    def position(self, q: Vector, kind: str = "joint_motion_generator_") -> str | None:
        """Take a position (7,) [rad]; return the error, or None."""
        if self._first and (np.abs(q - self.q) > _START).any():
            return "joint_position_motion_generator_start_pose_invalid"
        self._first = False
        error = self._checked((q - self.q) / TIMESTEP, q, kind, of_position=True)
        self.q = q.copy()
        return error

    def velocity(self, v: Vector) -> str | None:
        """Take a velocity (7,) [rad/s]; return the error, or None."""
        q = self.q + TIMESTEP * v
        error = self._checked(v, q, "joint_motion_generator_", of_position=False)
        self.q = q
        return error

    def of_tool(self, q: Vector) -> str | None:
        """Take the position (7,) [rad] that inverse kinematics finds; return the error, or None."""
        kind = "cartesian_motion_generator_joint_"
        error = self._checked((q - self.q) / TIMESTEP, q, kind, of_position=True)
        self.q = q.copy()
        return error

    def _checked(self, v: Vector, q: Vector, kind: str, *, of_position: bool) -> str | None:
        a, jerk = self._followed.follow(v)
        low, high = velocity_range(q)
        slack = _ROUNDING + TIMESTEP * JOINT_A
        if ((q < Q_MIN) | (q > Q_MAX)).any():
            return kind + "position_limits_violation"
        if ((v < low - slack) | (v > high + slack)).any():
            return kind + "velocity_limits_violation"
        fast, sudden = (
            (np.abs(a) > JOINT_A * (1.0 + _ROUNDING)).any(),
            (np.abs(jerk) > JOINT_J * (1.0 + _ROUNDING)).any(),
        )
        if fast and of_position:
            return kind + "velocity_discontinuity"
        return kind + "acceleration_discontinuity" if fast or sudden else None


class ToolCommands:
    """Checks poses or twists of the tool that a client commands, one after the other."""

    def __init__(self, T_base_tool: SE3) -> None:
        """Start at rest at a pose."""
        self.pose, self._first = T_base_tool, True
        self._parts = [Followed(np.zeros(3), np.zeros(3)) for _ in range(2)]

    def target(self, T_base_tool: SE3) -> str | None:
        """Take a pose; return the error, or None."""
        step = self.pose.inverse() @ T_base_tool
        linear = T_base_tool.translation() - self.pose.translation()
        turn = self.pose.rotation().apply(step.rotation().log())
        most, widest = _START_POSE
        if self._first and (np.linalg.norm(linear) > most or np.linalg.norm(turn) > widest):
            return "cartesian_position_motion_generator_start_pose_invalid"
        self._first = False
        self.pose = T_base_tool
        return self._checked(linear / TIMESTEP, turn / TIMESTEP, of_position=True)

    def twist(self, twist: Vector) -> str | None:
        """Take a twist (6,), linear part first, in the frame of the base; return the error."""
        error = self._checked(twist[:3].copy(), twist[3:].copy(), of_position=False)
        turned = type(self.pose.rotation()).exp(twist[3:] * TIMESTEP) @ self.pose.rotation()
        there = self.pose.translation() + TIMESTEP * twist[:3]
        self.pose = SE3.from_rotation_and_translation(turned, there)
        return error

    def _checked(self, linear: Vector, angular: Vector, *, of_position: bool) -> str | None:
        kind = "cartesian_motion_generator_"
        for followed, v, (v_max, a_max, j_max) in zip(
            self._parts, (linear, angular), (LINEAR, ANGULAR), strict=True
        ):
            a, jerk = followed.follow(v)
            sizes = [float(np.linalg.norm(x)) for x in (v, a, jerk)]
            if sizes[0] > v_max * (1.0 + _ROUNDING):
                return kind + "velocity_limits_violation"
            if sizes[1] > a_max * (1.0 + _ROUNDING) and of_position:
                return kind + "velocity_discontinuity"
            if sizes[1] > a_max * (1.0 + _ROUNDING) or sizes[2] > j_max * (1.0 + _ROUNDING):
                return kind + "acceleration_discontinuity"
        return None
