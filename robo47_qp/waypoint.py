"""Waypoint: a tool pose to visit, how to get there, and what the gripper does there."""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from mink import SE3, SO3
from numpy.typing import ArrayLike

from robo47_qp.arrays import checked_vector
from robo47_qp.errors import InvalidValueError


class Motion(Enum):
    """How the tool gets to a waypoint."""

    PTP = "ptp"
    """All joints together, as fast as the joint limits allow; the path is not a line."""
    LIN = "lin"
    """The tool on a straight line, turning at a steady rate."""


class Place(Enum):
    """A target that only the robot knows."""

    HOME = "home"


@dataclass(frozen=True, kw_only=True)
class Grip:
    """Bring the fingers to an opening width, pushing no harder than a force."""

    width: float
    """Opening width to move to [m]; a smaller one than the object's squeezes it."""
    force: float
    """Force of one finger at most [N]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Payload:
    """A rigid body held by the tool, as the controller believes it."""

    mass: float
    """[kg]"""
    inertia: tuple[float, float, float]
    """Principal moments about the centre of mass, along the axes of T_tcp_com [kg·m²]."""
    T_tcp_com: SE3
    """Pose of the principal axes, at the centre of mass, in the tool frame."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: The mass is not positive, the inertia not that of a body, or the
                pose none.
        """
        if not (np.isfinite(self.mass) and self.mass > 0.0):
            raise InvalidValueError("payload mass", self.mass, "positive and finite [kg]")
        _check_pose("payload T_tcp_com", self.T_tcp_com)
        moments = checked_vector("payload inertia", self.inertia, 3)
        if (moments <= 0.0).any() or 2 * moments.max() > moments.sum() * (1 + 1e-9):
            raise InvalidValueError(
                "payload inertia",
                moments.tolist(),
                "three positive moments, none above the sum of the others",
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class Waypoint:
    """A tool pose to come to rest at."""

    name: str
    """What the robot is doing on the way here; shown in recordings and messages."""
    target: SE3 | Place
    """T_world_tcp to reach, or a place of the robot's own."""
    motion: Motion = Motion.PTP
    speed: float = 1.0
    """Pace on the way here, relative to the profile, in (0, 1]."""
    grip: Grip | None = None
    """What the gripper does on arrival; None leaves it as it is."""
    carried: Payload | None = None
    """What the tool holds on the way here."""
    onward: "tuple[Waypoint, ...]" = ()
    """Straight motions that are to follow. They are not visited for that; the configuration
    at a PTP waypoint is chosen so that they can be."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: The pose has NaN, no unit quaternion, the speed is out of range,
                or what follows is not straight.
        """
        bent = [waypoint.name for waypoint in self.onward if waypoint.motion is not Motion.LIN]
        if bent:
            raise InvalidValueError(
                f"what follows waypoint {self.name!r}", bent, "waypoints reached by LIN"
            )
        if isinstance(self.target, SE3):
            _check_pose(f"target of waypoint {self.name!r}", self.target)
        if not 0.0 < self.speed <= 1.0:
            raise InvalidValueError(
                f"speed of waypoint {self.name!r}", self.speed, "above 0 and at most 1"
            )


def _check_pose(name: str, pose: SE3) -> None:
    numbers = checked_vector(name, pose.wxyz_xyz, 7)
    if abs(np.linalg.norm(numbers[:4]) - 1.0) > 1e-6:
        raise InvalidValueError(name, numbers[:4].tolist(), "a pose with a unit quaternion")


def tool_down(position: ArrayLike, yaw: float = 0.0) -> SE3:
    """Pose of a tool that points straight down (tool z along -z of the world).

    Args:
        position: Tool point in the world, shape (3,) [m].
        yaw: Turn about the world's z axis [rad]; at 0 the tool's x is the world's x.

    Raises:
        InvalidValueError: `position` is not three finite numbers, or `yaw` is not finite.
    """
    if not np.isfinite(yaw):
        raise InvalidValueError("yaw", yaw, "finite [rad]")
    rotation = SO3.from_z_radians(yaw) @ SO3.from_x_radians(np.pi)
    return SE3.from_rotation_and_translation(rotation, checked_vector("position", position, 3))
