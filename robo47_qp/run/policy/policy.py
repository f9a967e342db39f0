"""Check of what a policy answers: every number from outside passes here before anything moves."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol, TypeAlias

import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Vector, checked_vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import JOINT_MARGIN, Arm
from robo47_qp.model.gripper import Grip, Gripper
from robo47_qp.model.robot import Robot


@dataclass(frozen=True, kw_only=True, eq=False)
class Observation:
    """What a policy may know: plain numbers, copies of its own.

    A pose is a vector (7,): position x, y, z [m], then the quaternion qw, qx, qy, qz, in the
    world, whose origin is the robot's base; `pose_of` makes an SE3 of it.
    """

    time: float
    """Since the start of the episode [s]."""
    q: Vector
    """Measured joint positions (n,) [rad]."""
    v: Vector
    """Measured joint velocities (n,) [rad/s]."""
    tool: Vector
    """Pose of the tool by the measured joint positions (7,)."""
    width: float | None
    """Opening width of the gripper [m]; None where the robot has none."""
    force: Vector
    """Net contact force on the tool as a sensor at the wrist feels it, in the world (3,) [N]."""
    objects: Mapping[str, Vector]
    """Poses of the movable objects as the camera sees them, each (7,)."""
    markers: Mapping[str, Vector]
    """Poses of goals and other marks, each (7,); one that is done with has gone out of sight, to
    a metre below the base."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _WithGrip:
    width: float | None = None
    """Opening width for the fingers to move to [m]; None leaves them at what they do."""
    grip_force: float | None = None
    """Force of a finger at most [N]; None for half of what the gripper can."""


@dataclass(frozen=True, kw_only=True, eq=False)
class JointTarget(_WithGrip):
    """Joint positions to go to, by the fastest motion with bounded jerk."""

    q: Vector
    """(n,), inside the joint limits [rad]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ToolTarget(_WithGrip):
    """A pose for the tool to go to, by differential inverse kinematics: straight, no planning."""

    pose: Vector
    """T_world_tcp as in `Observation` (7,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Torques(_WithGrip):
    """Torques for the motors, without a controller: what holds the arm against gravity, too."""

    tau: Vector
    """(n,), within the motors' limits; reached as fast as the motors can [N·m]."""


Action: TypeAlias = JointTarget | ToolTarget | Torques


class Policy(Protocol):
    """Decides at a fixed rate. A class that needs no arguments and has these two methods."""

    def reset(self, observation: Observation) -> None:
        """An episode begins; what was learned of the last one is over."""
        ...

    def act(self, observation: Observation) -> Action | None:
        """What to do until the next time; None where all is done."""
        ...


def pose_of(vector: Vector) -> SE3:
    """The pose that a vector (7,) of an observation stands for."""
    return SE3.from_rotation_and_translation(SO3(vector[3:].copy()), vector[:3])


def vector_of(pose: SE3) -> Vector:
    """A pose as observations and actions have it (7,)."""
    return np.concatenate([pose.translation(), pose.rotation().wxyz])


_SINGLE = 1e-6
"""A number beyond a bound by this part of it is the bound: networks compute in single precision."""
_UNIT = 1e-3
"""How far the length of a quaternion may be from 1; it is made 1."""


def checked_action(action: object, arm: Arm) -> Action:
    """An action of the same kind whose numbers are new arrays, finite and within all bounds.

    Raises:
        InvalidValueError: It is no action, a number is not finite or out of range, or a shape is
            wrong.
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
            room = JOINT_MARGIN * (arm.q_max - arm.q_min)
            return replace(action, q=np.clip(q, arm.q_min + room, arm.q_max - room))
        case ToolTarget():
            return replace(action, pose=_checked_pose(action.pose))
        case Torques():
            tau = _within("tau of the action", action.tau, -robot.tau_max, robot.tau_max)
            return replace(action, tau=tau)


def grip_of(action: Action, gripper: Gripper) -> Grip | None:
    """What a checked action asks of the gripper; None where it asks nothing."""
    if action.width is None:
        return None
    force = 0.5 * gripper.force_max if action.grip_force is None else action.grip_force
    return Grip(width=action.width, force=force)


def _checked_grip(action: Action, robot: Robot) -> tuple[float | None, float | None]:
    """Width and force."""
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
    """A number from 0 to `most`; an array of one number, as networks answer, is one, too."""
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
