"""Tower: cubes of one edge length on top of each other at a goal."""

from dataclasses import dataclass

import numpy as np
from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.tasks.heading import heading, upright
from robo47_qp.tasks.table import TABLE_TOP

_IN_PLACE = 0.2
"""Largest error of a cube's position in the tower, relative to its edge [-]."""
_IN_THE_WAY = 1.5
"""Distance from the goal's vertical within which a loose cube is in the way, relative to its edge
[-]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Tower:
    """Position of a tower, in which any cube may be at any level."""

    edge: float
    """Edge length of a cube [m]."""
    T_world_goal: SE3
    """Pose of the tower's base on the table, as the camera sees it, with all that its calibration
    errs. Cubes are seen with the same error: what counts is where they are in the base's frame."""

    def level(self, number: int) -> SE3:
        """Return the pose of a cube in the tower, counted from 0, upright.

        Its x and y are those at which the camera would see it, its height is the data sheet's.
        """
        seen = self.T_world_goal @ SE3.from_translation(self._centre(number))
        x, y, _ = seen.translation()
        return upright([x, y, self.height(number)], heading(self.T_world_goal))

    def _centre(self, storey: float) -> Vector:
        """Return the centre of a cube in the tower, in the frame of its base (3,) [m]."""
        return np.array([0.0, 0.0, (storey + 0.5) * self.edge])

    def _at(self, T_world_cube: SE3) -> Vector:
        """Return where a cube is in the frame of the base (3,) [m]."""
        at: Vector = (self.T_world_goal.inverse() @ T_world_cube).translation()
        return at

    def height(self, storey: int) -> float:
        """Return the height of the centre of a cube with so many below it, in the world [m]."""
        return TABLE_TOP + (storey + 0.5) * self.edge

    def storey(self, T_world_cube: SE3) -> int:
        """Return how many cubes are below one, wherever it is."""
        return round(float(self._at(T_world_cube)[2]) / self.edge - 0.5)

    def standing(self, seen: dict[str, SE3]) -> list[str]:
        """Return the names of the cubes that stand in the tower, from below.

        Args:
            seen: Poses of the cubes by name.
        """
        tower: list[str] = []
        for number in range(len(seen)):
            centre = self._centre(number)
            away = {n: float(np.linalg.norm(self._at(T) - centre)) for n, T in seen.items()}
            nearest = min(away, key=lambda name: away[name])
            if away[nearest] > _IN_PLACE * self.edge:
                break
            tower.append(nearest)
        return tower

    def taken(self, seen: dict[str, SE3], name: str) -> bool:
        """Return whether a loose cube other than the named one is where the tower is to grow."""
        others = (self._at(seen[cube])[:2] for cube in self.loose(seen) if cube != name)
        return any(np.linalg.norm(at) < _IN_THE_WAY * self.edge for at in others)

    def loose(self, seen: dict[str, SE3]) -> list[str]:
        """Return the other cubes in picking order: those on top first, then those in the way."""
        tower = self.standing(seen)

        def turn(name: str) -> tuple[float, float]:
            T = seen[name]
            return -self.storey(T), float(np.linalg.norm(self._at(T)))

        return sorted((name for name in seen if name not in tower), key=turn)
