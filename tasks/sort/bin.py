"""Bin: four low walls around a part of a table."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.arrays import Checked, Numbers, Positive, Range
from robo47_qp.errors import InvalidValueError
from robo47_qp.tasks.item import Item
from robo47_qp.tasks.table import SURFACE_FRICTION, TABLE_TOP

_WALL = 0.008
"""Thickness of the walls [m]."""
_SQUEEZE = 1e-3
"""How far an item that touches a wall may be inside it: contacts are not rigid [m]."""


@dataclass(frozen=True, kw_only=True)
class Bin(Checked):
    """A bin on the table, aligned with the axes of the world."""

    name: str
    """Name of its body."""
    centre: tuple[float, float]
    """Position of its centre, x and y [m]."""
    size: Annotated[tuple[float, float], Numbers(2, Range(above=0.0))] = (0.21, 0.15)
    """Inner lengths along x and y [m]."""
    height: Positive = 0.04
    """Height of the rim above the table [m]."""
    pitch: Positive = 0.065
    """Distance of neighbouring slots, which are in a row along x [m]."""
    rgba: tuple[float, float, float, float]
    """Colour of the bin and of the items that belong into it."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: A length is not positive, or no slot fits in.
        """
        super().__post_init__()
        if self.pitch > self.size[0]:
            raise InvalidValueError(f"pitch of {self.name!r}", self.pitch, "at most its length")

    def _label(self, field: str) -> str:
        return field if field == "name" else f"{field} of {self.name!r}"

    @property
    def slots(self) -> tuple[tuple[float, float], ...]:
        """Positions at which items are released, x and y [m]."""
        count = int(self.size[0] / self.pitch)
        x, y = self.centre
        return tuple((x + self.pitch * (i - 0.5 * (count - 1)), y) for i in range(count))

    @property
    def room(self) -> str:
        """The inner volume, in words."""
        (x, y), (a, b) = self.centre, (0.5 * length for length in self.size)
        return (
            f"x {x - a:.3f} to {x + a:.3f} m, y {y - b:.3f} to {y + b:.3f} m, "
            f"z {TABLE_TOP:.3f} to {TABLE_TOP + self.height:.3f} m"
        )

    def add(self, spec: mujoco.MjSpec) -> None:
        """Add walls with contacts, and a floor without."""
        (a, b), half = (0.5 * length for length in self.size), 0.5 * self.height
        body = spec.worldbody.add_body(name=self.name, pos=[*self.centre, TABLE_TOP])
        box, thin = mujoco.mjtGeom.mjGEOM_BOX, 0.5 * _WALL
        for i, sign in enumerate((-1.0, 1.0)):
            for side, where, size in (
                ("x", [sign * (a + thin), 0.0, half], [thin, b + _WALL, half]),
                ("y", [0.0, sign * (b + thin), half], [a, thin, half]),
            ):
                name = f"{self.name} {side}{i}"
                body.add_geom(
                    name=name,
                    type=box,
                    pos=where,
                    size=size,
                    rgba=self.rgba,
                    friction=SURFACE_FRICTION,
                )
        ground = [*self.rgba[:3], 0.4]
        body.add_geom(
            name=self.name, type=box, size=[a, b, 5e-4], rgba=ground, contype=0, conaffinity=0
        )

    def holds(self, position: np.ndarray) -> bool:
        """Return True if a point is within the walls, above the ground and below the rim."""
        x, y, z = position - np.array([*self.centre, TABLE_TOP])
        within = abs(x) < 0.5 * self.size[0] and abs(y) < 0.5 * self.size[1]
        return bool(within and 0.0 < z < self.height)

    def holds_all(self, item: Item, T_world_item: SE3) -> bool:
        """Return True if all of an item is between the walls, and its centre below the rim."""
        p, R = T_world_item.translation(), T_world_item.rotation().as_matrix()
        half = np.abs(R) @ (0.5 * np.array(item.size))
        if item.round:
            # A cylinder reaches r |sin| beside its axis and h/2 |cos| along it, per direction.
            radius, axis = 0.5 * item.size[0], R[:, 2]
            half = radius * np.sqrt(np.maximum(0.0, 1.0 - axis**2)) + 0.5 * item.height * abs(axis)
        room = 0.5 * np.array(self.size) + _SQUEEZE
        return self.holds(p) and bool((np.abs(p[:2] - self.centre) + half[:2] <= room).all())

    def free_slot(self, others: Sequence[tuple[float, float]]) -> tuple[float, float]:
        """Return the slot that is furthest from all other items.

        Args:
            others: Positions of other items, x and y [m].
        """

        def room(slot: tuple[float, float]) -> float:
            away = [float(np.hypot(slot[0] - x, slot[1] - y)) for x, y in others]
            return min([self.pitch, *away])

        return max(self.slots, key=room)
