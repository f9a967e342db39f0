"""Item: a box or an upright cylinder that a parallel gripper can hold."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import mujoco
import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Checked, Numbers, Positive, Range
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.payload import Payload
from robo47_qp.motion.waypoint import tool_down
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.heading import heading, quarter

RED, GREEN, BLUE = (0.85, 0.22, 0.18, 1.0), (0.15, 0.55, 0.30, 1.0), (0.16, 0.36, 0.75, 1.0)
_FINGERTIP = 0.012
"""Least height of the tool point above the surface below the open fingers [m]."""
_ROOM, _TIGHT = 0.012, 1e-3
"""Room between item and open fingers that is wanted, and that is enough where there is no more
[m]."""
_GRAVITY, _LIFTED = 9.81, 2.0
"""Acceleration of gravity, and of an item that is lifted [m/s²]."""
_SAFETY, _SPREAD = 1.5, 7e-3
"""Factor on what the fingers have to bear [-], and mean distance of their contacts from the axis of
the fingers [m]."""
_GENTLEST = 10.0
"""Least force of a finger [N]."""
SPINNING = (0.003, 1e-4)
"""Coefficients of torsional and rolling friction of items [m]."""
_FEET, _FOOT, _GROUND = 6, 1.5e-3, 2e-4
"""Spheres on which a cylinder stands, their radius and the height of its bottom above what they
stand on [m]. MuJoCo finds the contacts of cylinder and box by search, from period to period at
other places of the rim: with its mass off the middle a cylinder never stood still, and rocked at up
to 0.35 rad/s. Contacts of a sphere and a box are exact."""
_DEPTH = 0.03
"""Largest depth of the tool point below the top of an item [m]."""


@dataclass(frozen=True, kw_only=True)
class Item(Checked):
    """A box or cylinder that stands on a table, its frame at its centre with z up."""

    name: str
    """Name of its body."""
    size: Annotated[tuple[float, float, float], Numbers(3, Range(above=0.0))]
    """Lengths along x, y and z; for a cylinder diameter, diameter and height [m]."""
    round: bool = False
    """True for a cylinder."""
    mass: Positive = 0.1
    """Mass [kg]."""
    rgba: tuple[float, float, float, float] = RED
    friction: Annotated[tuple[float, float], Numbers(2, Range(above=0.0))] = (0.25, 0.9)
    """What a data sheet tells of its coefficient of friction: least and largest [-]."""
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Centre of mass in its frame [m]."""
    on_feet: ClassVar[bool] = True
    """Whether a cylinder stands on feet, with exact contacts."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: A length, mass or friction is not positive, a cylinder is oval, or
                the centre of mass is outside.
        """
        super().__post_init__()
        if self.round and self.size[0] != self.size[1]:
            raise InvalidValueError(f"diameter of {self.name!r}", self.size[:2], "one number twice")
        least, largest = self.friction
        if least > largest:
            expected = "two positive numbers, the least first"
            raise InvalidValueError(f"friction of {self.name!r}", self.friction, expected)
        if any(abs(at) >= 0.5 * length for at, length in zip(self.com, self.size, strict=True)):
            raise InvalidValueError(f"centre of mass of {self.name!r}", self.com, "inside of it")

    def _label(self, field: str) -> str:
        return field if field == "name" else f"{field} of {self.name!r}"

    @property
    def height(self) -> float:
        """Height [m]."""
        return self.size[2]

    def add(self, spec: mujoco.MjSpec, position: tuple[float, float, float]) -> None:
        """Add the item to a scene as a free body."""
        x, y, z = (0.5 * length for length in self.size)
        body = spec.worldbody.add_body(name=self.name, pos=position)
        body.add_freejoint()
        shape = mujoco.mjtGeom.mjGEOM_CYLINDER if self.round else mujoco.mjtGeom.mjGEOM_BOX
        feet = _FEET if self.round and self.on_feet else 0
        # A cylinder on feet has its own bottom a little higher.
        lifted = 0.5 * _GROUND if feet else 0.0
        size = [x, z - lifted, 0.0] if self.round else [x, y, z]
        friction = [float(np.mean(self.friction)), *SPINNING]
        body.add_geom(
            name=self.name,
            type=shape,
            pos=[0.0, 0.0, lifted],
            size=size,
            mass=self.mass,
            rgba=self.rgba,
            friction=friction,
        )
        for angle in np.linspace(0.0, 2.0 * np.pi, feet, endpoint=False):
            out = x - _FOOT
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_SPHERE,
                pos=[out * np.cos(angle), out * np.sin(angle), _FOOT - z],
                size=[_FOOT, 0.0, 0.0],
                mass=0.0,
                rgba=[0.0] * 4,
                friction=friction,
            )
        if any(self.com) or feet:
            body.explicitinertial = True
            body.mass, body.ipos, body.inertia = self.mass, self.com, self._moments

    def draw_friction(self, simulation: Simulation, rng: np.random.Generator) -> None:
        """Give the item a friction of its range, which nobody is told."""
        simulation.set_friction(self.name, float(rng.uniform(*self.friction)))

    def grip_force(self, most: float, acceleration: float) -> float:
        """Return the force of one finger that holds the item, by its data sheet alone [N].

        Two fingers bear 2 µ F. They are to bear `_SAFETY` times the weight of the item as it is
        lifted and carried aside, at the least friction of the data sheet, and its moment about the
        fingers' axis where the centre of mass is off the middle, by contacts that are `_SPREAD`
        from it.

        Args:
            most: Largest force of a finger [N], also where the item would need more.
            acceleration: That of the tool, as it carries the item [m/s²].
        """
        weight = self.mass * float(np.hypot(_GRAVITY + _LIFTED, acceleration))
        moment = weight * float(np.hypot(*self.com[:2]))
        needed = _SAFETY * float(np.hypot(weight, moment / _SPREAD)) / (2.0 * self.friction[0])
        return min(max(needed, _GENTLEST), most)

    def grasp(self, T_world_item: SE3, width_max: float) -> SE3:
        """Return T_world_tcp that grasps the item from above, with the wrist turned least.

        Args:
            T_world_item: Pose of the item.
            width_max: Largest opening width of the gripper [m]; wider sides are not grasped.
        """
        x, y, z = T_world_item.translation()
        lowest = z - 0.5 * self.height + _FINGERTIP
        up = max(z, z + 0.5 * self.height - _DEPTH, lowest)
        return tool_down([x, y, up], self._turned(heading(T_world_item), width_max))

    def width(self, T_world_tcp: SE3, T_world_item: SE3) -> float:
        """Return the opening width at which fingers along the tool's y hold the item [m]."""
        if self.round:
            return self.size[0]
        y = (T_world_item.inverse() @ T_world_tcp).rotation().as_matrix()[:, 1]
        return self.size[0] if abs(y[0]) > abs(y[1]) else self.size[1]

    def fits(self, T_world_tcp: SE3, T_world_item: SE3, width_max: float) -> bool:
        """Return whether open fingers have room at both sides of the item."""
        return self.width(T_world_tcp, T_world_item) + _ROOM < width_max

    def as_in(self, simulation: Simulation) -> "Item":
        """Return the item with the lengths that it has in a simulation, by which it is judged."""
        scale = float(simulation.model.geom(self.name).size[0]) / (0.5 * self.size[0])
        if scale == 1.0:
            return self
        x, y, z = self.size
        return replace(self, size=(scale * x, scale * y, scale * z), com=(0.0, 0.0, 0.0))

    def same_heading(self, turn: float) -> float:
        """Return the smallest rotation about the vertical that looks the same [rad]."""
        if self.round:
            return 0.0
        if self.size[0] == self.size[1]:
            return quarter(turn)
        return (turn + np.pi / 2) % np.pi - np.pi / 2

    def payload(self, T_tcp_item: SE3) -> Payload:
        """Return the payload of a tool that holds the item."""
        T_tcp_com = T_tcp_item @ SE3.from_translation(np.array(self.com))
        return Payload(mass=self.mass, inertia=self._moments, T_tcp_com=T_tcp_com)

    @property
    def _moments(self) -> tuple[float, float, float]:
        """Moments of inertia about its axes, of a solid body [kg·m²]."""
        x, y, z = self.size
        if self.round:
            across = self.mass * (3 * (0.5 * x) ** 2 + z**2) / 12
            return across, across, self.mass * (0.5 * x) ** 2 / 2
        a, b, c = (self.mass * (u**2 + v**2) / 12 for u, v in ((y, z), (x, z), (x, y)))
        return a, b, c

    def _turned(self, turn: float, width_max: float) -> float:
        """Return the heading of a tool whose fingers close across one of the sides [rad]."""
        if self.round:
            return 0.0
        fits = [side + _ROOM < width_max for side in self.size[:2]]
        if not any(fits):
            fits = [side + _TIGHT < width_max for side in self.size[:2]]
        if fits[0] == fits[1]:
            return quarter(turn)
        # The fingers close along the tool's y axis: across the item's y at its own heading.
        turn = turn if fits[1] else turn + np.pi / 2
        return (turn + np.pi / 2) % np.pi - np.pi / 2


def opening_for(items: Iterable[Item], least: float | None) -> float | None:
    """Return how wide fingers must open to go around one side of each item, and at least [m]."""
    if least is None:
        return None
    return max(least, *(min(item.size[:2]) + _TIGHT for item in items))


def different(items: Sequence[Item]) -> None:
    """Check that items have names of their own, by which a scene knows them.

    Raises:
        InvalidValueError: Two have the same.
    """
    names = [item.name for item in items]
    if len(set(names)) < len(names):
        raise InvalidValueError("names of items", names, "each another one")


def upright_item(item: Item, T_world_item: SE3) -> tuple[Item, SE3]:
    """Return a tipped item as one that stands, with its axes renamed.

    Args:
        item: The item as it stood at the start.
        T_world_item: Its current pose.

    Returns:
        The item with the lengths along its new axes, and T_item_standing, the rotation that
        turns the axis closest to the vertical up. A cylinder on its side is treated as a box.
    """
    up = T_world_item.rotation().as_matrix()[2]
    axis = int(np.argmax(np.abs(up)))
    if axis == 2 and up[2] > 0.0:
        return item, SE3.identity()
    R = np.zeros((3, 3))
    R[axis, 2] = np.sign(up[axis])
    R[(axis + 1) % 3, 0] = 1.0
    R[:, 1] = np.cross(R[:, 2], R[:, 0])
    x, y, z = (item.size[int(np.argmax(np.abs(column)))] for column in R.T)
    turned = replace(item, size=(x, y, z), round=item.round and axis == 2)
    return turned, SE3.from_rotation(SO3.from_matrix(R))


def turned_about_vertical(T_world_body: SE3, turn: float, position: np.ndarray) -> SE3:
    """Return a pose rotated about the vertical and moved to a position."""
    rotation = SO3.from_z_radians(turn) @ T_world_body.rotation()
    return SE3.from_rotation_and_translation(rotation, position)
