"""Obstacle: a static body that the arm must not touch."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import Enum

import mujoco
from mink import SE3

from robo47_qp.arrays import check_pose, checked_vector
from robo47_qp.errors import InvalidValueError


class Shape(Enum):
    """Shapes of obstacles, with sizes as in MuJoCo."""

    BOX = "box"
    """Size: half lengths along x, y and z [m]."""
    SPHERE = "sphere"
    """Size: radius [m]."""
    CYLINDER = "cylinder"
    """Size: radius and half length along z [m]."""
    CAPSULE = "capsule"
    """Size: radius and half length, without the caps, along z [m]."""
    PLANE = "plane"
    """No size: infinite, solid below its own z = 0."""


SIZES = {Shape.BOX: 3, Shape.SPHERE: 1, Shape.CYLINDER: 2, Shape.CAPSULE: 2, Shape.PLANE: 0}
"""Number of lengths in the size of each shape."""
_ALL_BITS = 2**31 - 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Obstacle:
    """A body that is fixed in the world; equal to one of the same name, shape, size and pose."""

    name: str
    """Name, unique among the obstacles and the geoms of the robot."""
    shape: Shape
    size: tuple[float, ...] = ()
    """Lengths, see `Shape` [m]."""
    T_world_obstacle: SE3 = field(default_factory=SE3.identity)
    """Pose of the centre; for a plane, of a point on it, with z out of the solid."""

    def __post_init__(self) -> None:
        """Check name, size and pose.

        Raises:
            InvalidValueError: No name, lengths that do not fit the shape, or no pose.
        """
        if not self.name:
            raise InvalidValueError("name of an obstacle", repr(self.name), "a non-empty text")
        title = f"obstacle {self.name!r}"
        if not isinstance(self.shape, Shape):
            raise InvalidValueError(f"shape of {title}", repr(self.shape), "one of Shape")
        size = checked_vector(f"size of {title}", self.size, SIZES[self.shape])
        if (size <= 0.0).any():
            raise InvalidValueError(f"size of {title}", size.tolist(), "positive lengths [m]")
        object.__setattr__(self, "size", tuple(size.tolist()))
        if not isinstance(self.T_world_obstacle, SE3):
            found = type(self.T_world_obstacle).__name__
            raise InvalidValueError(f"pose of {title}", f"a {found}", "a mink.SE3")
        check_pose(f"pose of {title}", self.T_world_obstacle)

    def __eq__(self, other: object) -> bool:
        """Return whether all fields are equal, to the bit."""
        return self._fields == other._fields if isinstance(other, Obstacle) else NotImplemented

    def __hash__(self) -> int:
        """Return the hash of all fields."""
        return hash(self._fields)

    @property
    def _fields(self) -> tuple[object, ...]:
        return self.name, self.shape, self.size, self.T_world_obstacle.wxyz_xyz.tobytes()


def checked_obstacles(obstacles: Iterable[Obstacle]) -> tuple[Obstacle, ...]:
    """Return obstacles, checked to be some.

    Raises:
        InvalidValueError: One is not.
    """
    found = tuple(obstacles)
    for one in found:
        if not isinstance(one, Obstacle):
            raise InvalidValueError("obstacles", repr(one), "a sequence of Obstacle")
    return found


def add_obstacle(spec: mujoco.MjSpec, obstacle: Obstacle) -> mujoco.MjsGeom:
    """Add the obstacle to the world of a spec, and return its geom.

    Raises:
        InvalidValueError: A geom has its name already.
    """
    taken = [geom.name for geom in spec.geoms]
    if obstacle.name in taken:
        raise InvalidValueError("name of an obstacle", repr(obstacle.name), f"none of {taken}")
    pose = obstacle.T_world_obstacle
    geom: mujoco.MjsGeom = spec.worldbody.add_geom(
        name=obstacle.name,
        type=getattr(mujoco.mjtGeom, f"mjGEOM_{obstacle.shape.name}"),
        size=[*obstacle.size, *(3 - len(obstacle.size)) * [1.0]],
        pos=pose.translation(),
        quat=pose.rotation().wxyz,
        # All bits, so that every collision geom collides with an obstacle.
        contype=_ALL_BITS,
        conaffinity=_ALL_BITS,
        margin=0.0,
        gap=0.0,
    )
    return geom
