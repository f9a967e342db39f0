"""The check of every action of a policy before the arm moves, and the grip that it asks for."""

from dataclasses import replace

import numpy as np

from robo47_qp.arrays import Vector, checked_vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import JOINT_MARGIN, Arm
from robo47_qp.model.gripper import Grip, Gripper
from robo47_qp.model.robot import Robot
from robo47_qp.run.policy.policy import Action, JointTarget, ToolTarget, Torques

_SINGLE = 1e-6
"""Share of a range by which a number may exceed it, to be clipped: rounding in single precision."""
_UNIT = 1e-3
"""Tolerance of the length of a quaternion, which is normalised."""


def checked_action(action: object, arm: Arm) -> Action:
    """Return a copy of an action, with all numbers finite and within their bounds.

    Raises:
        InvalidValueError: It is not an action, a number is not finite or out of range, or a shape
            is wrong.
    """
    robot = arm.robot
    if not isinstance(action, JointTarget | ToolTarget | Torques):
        expected = "a JointTarget, a ToolTarget, Torques, or None"
        raise InvalidValueError("the action", f"a {type(action).__name__}", expected)
    width, grip_force = _checked_grip(action, robot)
    action = replace(action, width=width, grip_force=grip_force)
    match action:
        case JointTarget():
            q = _within("q of the action", action.q, arm.q_min, arm.q_max)
            room = JOINT_MARGIN * (arm.q_high - arm.q_low)
            return replace(action, q=np.clip(q, arm.q_min + room, arm.q_max - room))
        case ToolTarget():
            return replace(action, pose=_checked_pose(action.pose))
        case Torques():
            tau = _within("tau of the action", action.tau, -robot.tau_max, robot.tau_max)
            return replace(action, tau=tau)


def grip_of(action: Action, gripper: Gripper) -> Grip | None:
    """Return the grip command of a checked action; None without one."""
    if action.width is None:
        return None
    force = 0.5 * gripper.force_max if action.grip_force is None else action.grip_force
    return Grip(width=action.width, force=force)


def _checked_grip(action: Action, robot: Robot) -> tuple[float | None, float | None]:
    """Return width and force."""
    gripper = robot.gripper
    if gripper is None:
        if action.width is not None or action.grip_force is not None:
            found, expected = action.width, f"None: the robot {robot.name!r} has no gripper"
            raise InvalidValueError("width of the action", found, expected)
        return None, None
    width = _number("width of the action", action.width, gripper.width_max)
    force = _number("grip_force of the action", action.grip_force, gripper.force_max)
    if force == 0.0:
        raise InvalidValueError("grip_force of the action", 0.0, "above 0 [N]")
    return width, force


def _number(name: str, value: object, most: float) -> float | None:
    """Return a number from 0 to `most`; it may come as an array of one number."""
    if value is None:
        return None
    one = np.reshape(value, -1)  # type: ignore[call-overload]
    return float(_within(name, one, np.zeros(1), np.array([most]))[0])


def _within(name: str, value: object, low: Vector, high: Vector) -> Vector:
    vector = checked_vector(name, value, len(low))  # type: ignore[arg-type]
    slack = _SINGLE * (high - low)
    if (vector < low - slack).any() or (vector > high + slack).any():
        i = int(np.argmax(np.maximum(low - vector, vector - high)))
        which = name.replace(" of", f"[{i}] of", 1) if len(low) > 1 else name
        raise InvalidValueError(which, f"{vector[i]:.6g}", f"from {low[i]:.6g} to {high[i]:.6g}")
    inside: Vector = np.clip(vector, low, high)
    return inside


def _checked_pose(value: object) -> Vector:
    pose = checked_vector("pose of the action", value, 7)  # type: ignore[arg-type]
    length = float(np.linalg.norm(pose[3:]))
    if abs(length - 1.0) > _UNIT:
        expected = "x, y, z [m], then a unit quaternion qw, qx, qy, qz"
        raise InvalidValueError("pose of the action", pose.tolist(), expected)
    pose[3:] /= length
    return pose
