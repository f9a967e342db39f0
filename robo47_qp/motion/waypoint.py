"""Waypoint: a tool pose to visit, how to get there, and what the gripper does there."""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from mink import SE3, SO3
from numpy.typing import ArrayLike

from robo47_qp.arrays import Vector, check_pose, checked_vector, frozen_vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.gripper import Grip
from robo47_qp.model.payload import Payload


class Motion(Enum):
    """How the tool gets to a waypoint."""

    PTP = "ptp"
    """All joints together, as fast as the joint limits allow; the path is not a line."""
    LIN = "lin"
    """The tool on a straight line, turning at a steady rate."""
    CIRC = "circ"
    """The tool on an arc of a circle, turning at a steady rate from start to goal."""


class Place(Enum):
    """A target that only the robot knows."""

    HOME = "home"


@dataclass(frozen=True, kw_only=True, eq=False)
class Waypoint:
    """A tool pose to visit; at rest unless it is blended or passed."""

    name: str
    """What the robot is doing on the way here; shown in recordings and messages."""
    target: SE3 | Place
    """T_world_tcp to reach, or a place of the robot's own."""
    motion: Motion = Motion.PTP
    through: Vector | None = None
    """CIRC: a point on the arc between start and target (3,) [m]."""
    centre: Vector | None = None
    """CIRC, in place of `through`: centre of the arc (3,) [m]; the shorter way is taken."""
    blend: float = 0.0
    """How far from here the tool may leave the way here for the way to the next waypoint, so as
    not to stop [m]; with 0 it comes to rest, or passes exactly through where `stop` is False."""
    stop: bool = True
    """False: pass exactly through without stopping, on a smooth curve through this waypoint and
    its neighbours; in joint space for PTP, of the tool for LIN."""
    pace: float = 1.0
    """Pace on the way here, relative to the profile, in (0, 1]."""
    grip: Grip | None = None
    """What the gripper does on arrival; None leaves it as it is."""
    carried: Payload | None = None
    """What the tool holds on the way here."""
    onward: "tuple[Waypoint, ...]" = ()
    """Motions of the tool, straight or on arcs, that are to follow. They are not visited for
    that; the configuration at a PTP waypoint is chosen so that they can be."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: The pose has NaN, no unit quaternion, the pace is out of range,
                what follows is no motion of the tool, or what shapes the way is amiss.
        """
        bent = [waypoint.name for waypoint in self.onward if waypoint.motion is Motion.PTP]
        if bent:
            raise InvalidValueError(
                f"what follows waypoint {self.name!r}", bent, "waypoints reached by LIN or CIRC"
            )
        self._check_shape()
        if isinstance(self.target, SE3):
            check_pose(f"target of waypoint {self.name!r}", self.target)
        if not 0.0 < self.pace <= 1.0:
            raise InvalidValueError(
                f"pace of waypoint {self.name!r}", self.pace, "above 0 and at most 1"
            )

    @property
    def rests(self) -> bool:
        """True where the tool comes to rest here."""
        return self.stop and self.blend == 0.0

    def _check_shape(self) -> None:
        points = [name for name in ("through", "centre") if getattr(self, name) is not None]
        if len(points) != (1 if self.motion is Motion.CIRC else 0):
            raise InvalidValueError(
                f"shape of the way to waypoint {self.name!r}",
                f"{self.motion.name} with {points or 'neither through nor centre'}",
                "CIRC with one of through and centre, any other motion with neither",
            )
        for name in points:
            point = frozen_vector(f"{name} of waypoint {self.name!r}", getattr(self, name), 3)
            object.__setattr__(self, name, point)
        if not (np.isfinite(self.blend) and self.blend >= 0.0):
            raise InvalidValueError(
                f"blend of waypoint {self.name!r}", self.blend, "finite and 0 or more [m]"
            )
        if not self.stop and (self.blend > 0.0 or self.motion is Motion.CIRC):
            raise InvalidValueError(
                f"waypoint {self.name!r} that is not to be stopped at",
                f"{self.motion.name} with a blend of {self.blend} m",
                "PTP or LIN without a blend; an arc goes on without stopping by a blend",
            )
        if self.grip is not None and not self.rests:
            raise InvalidValueError(
                f"grip at waypoint {self.name!r}", self.grip, "None where the tool does not stop"
            )


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
