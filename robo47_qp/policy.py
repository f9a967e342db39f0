"""Policy: code from elsewhere that decides what the robot does, from observations alone."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Vector


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
