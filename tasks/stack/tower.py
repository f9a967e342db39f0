"""Tower: cubes of one edge length on top of each other at a goal."""

from dataclasses import dataclass

import numpy as np
from mink import SE3

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
    """Pose of the tower's base, on the table with z up."""

    def level(self, number: int) -> SE3:
        """Return the pose of a cube in the tower, counted from 0."""
        x, y, _ = self.T_world_goal.translation()
        return upright([x, y, self.height(number)], heading(self.T_world_goal))

    def height(self, storey: int) -> float:
        """Return the height of the centre of a cube with so many below it, in the world [m]."""
        return TABLE_TOP + (storey + 0.5) * self.edge

    def storey(self, T_world_cube: SE3) -> int:
        """Return how many cubes are below one, wherever it is."""
        return round((float(T_world_cube.translation()[2]) - TABLE_TOP) / self.edge - 0.5)

    def standing(self, seen: dict[str, SE3]) -> list[str]:
        """Return the names of the cubes that stand in the tower, from below.

        Args:
            seen: Poses of the cubes by name.
        """
        tower: list[str] = []
        for number in range(len(seen)):
            at = self.level(number).translation()
            away = {n: float(np.linalg.norm(T.translation() - at)) for n, T in seen.items()}
            nearest = min(away, key=lambda name: away[name])
            if away[nearest] > _IN_PLACE * self.edge:
                break
            tower.append(nearest)
        return tower

    def taken(self, seen: dict[str, SE3], name: str) -> bool:
        """Return whether a loose cube other than the named one is where the tower is to grow."""
        x, y, _ = self.T_world_goal.translation()

        def off(cube: str) -> float:
            at = seen[cube].translation()
            return float(np.hypot(at[0] - x, at[1] - y))

        others = (cube for cube in self.loose(seen) if cube != name)
        return any(off(cube) < _IN_THE_WAY * self.edge for cube in others)

    def loose(self, seen: dict[str, SE3]) -> list[str]:
        """Return the other cubes in picking order: those on top first, then those in the way."""
        tower = self.standing(seen)
        goal = self.T_world_goal.translation()

        def turn(name: str) -> tuple[float, float]:
            T = seen[name]
            return -self.storey(T), float(np.linalg.norm(T.translation() - goal))

        return sorted((name for name in seen if name not in tower), key=turn)
