"""Policy: what it observes, and the actions that it answers with.

Neither mink nor MuJoCo is imported before a pose is made: a policy starts in a process of its own.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, TypeAlias

import numpy as np

from robo47_qp.arrays import Vector
from robo47_qp.sim.cell_sheet import CellSheet

if TYPE_CHECKING:
    from mink import SE3


@dataclass(frozen=True, kw_only=True, eq=False)
class Observation:
    """Sensor readings for a policy, as copies.

    A pose is a vector (7,): position x, y, z [m], then the quaternion qw, qx, qy, qz, in the
    world, in which the base stands at `Robot.T_world_base` (at the origin, but for robots with a
    cell, such as `ur5e`); `pose_of` makes an SE3 of it.
    """

    time: float
    """Since the start of the episode [s]."""
    q: Vector
    """Measured joint positions (n,) [rad]."""
    v: Vector
    """Measured joint velocities (n,) [rad/s]."""
    tool: Vector
    """Pose of the tool from the measured joint positions (7,)."""
    width: float | None
    """Opening width of the gripper [m]; None without a gripper."""
    force: Vector
    """Net force on the tool from outside, as a wrist sensor measures it, in the world (3,) [N]."""
    objects: Mapping[str, Vector]
    """Measured poses of the movable objects from the camera, each (7,)."""
    markers: Mapping[str, Vector]
    """Poses of goals and other markers from the camera, each (7,); completed ones are hidden 1 m
    below the base, and poses that are asked for are as asked for."""
    fingers: Vector | None = None
    """Force on each finger of the gripper (2,) [N]; None without a gripper."""
    frames: Mapping[str, float] = field(default_factory=dict)
    """When the last frame with each object and marker in it was taken [s]."""
    sheet: CellSheet = CellSheet()
    """What data sheets say of the cell: sizes, masses, obstacles, figures of the sensors."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _WithGrip:
    width: float | None = None
    """Opening width to move the fingers to [m]; None keeps the last command."""
    grip_force: float | None = None
    """Largest force of a finger [N]; None for half the gripper's largest."""


@dataclass(frozen=True, kw_only=True, eq=False)
class JointTarget(_WithGrip):
    """Joint positions to go to, by the fastest motion with bounded jerk."""

    q: Vector
    """(n,), inside the joint limits [rad]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ToolTarget(_WithGrip):
    """A tool pose to go to directly, by differential inverse kinematics without planning."""

    pose: Vector
    """T_world_tcp as in `Observation` (7,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Torques(_WithGrip):
    """Motor torques without a controller; they include gravity compensation."""

    tau: Vector
    """(n,), within the motors' limits, and reached at their torque rate [N·m]."""


Action: TypeAlias = JointTarget | ToolTarget | Torques


class Policy(Protocol):
    """Chooses actions at a fixed rate. Its class is constructed without arguments."""

    def reset(self, observation: Observation) -> None:
        """Start an episode, and discard the state of the last one."""
        ...

    def act(self, observation: Observation) -> Action | None:
        """Return the action until the next call; None ends the episode."""
        ...


def pose_of(vector: Vector) -> "SE3":
    """Return a pose (7,) of an observation as SE3."""
    from mink import SE3, SO3

    return SE3.from_rotation_and_translation(SO3(vector[3:].copy()), vector[:3])


def vector_of(pose: "SE3") -> Vector:
    """Return a pose as in observations and actions (7,)."""
    return np.concatenate([pose.translation(), pose.rotation().wxyz])
