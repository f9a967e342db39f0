"""Cell: how a robot stands in the workspace of the tasks."""

from dataclasses import dataclass, field, replace

import numpy as np
from mink import SE3, SO3

from robo47_qp.model.robot import Robot


@dataclass(frozen=True, kw_only=True, eq=False)
class Cell:
    """A mount beside the table of the tasks, which belongs to neither robot nor task.

    The places of the tasks fit an arm with the reach of a Panda at the origin of the world; a cell
    moves the base of another arm, on a pedestal if need be, so that they are in its reach.
    """

    T_world_base: SE3 = field(default_factory=SE3.identity)
    """Pose of the origin of the robot's file."""

    @classmethod
    def at(cls, x: float, y: float, z: float = 0.0, yaw: float = 0.0) -> "Cell":
        """Return the cell with the base at a position [m], turned about the vertical [rad]."""
        rotation = SO3.from_z_radians(yaw)
        return cls(T_world_base=SE3.from_rotation_and_translation(rotation, np.array([x, y, z])))

    def with_robot(self, robot: Robot) -> Robot:
        """Return the robot as it stands in the cell."""
        return replace(robot, T_world_base=self.T_world_base)


CELLS: dict[tuple[str, str | None], Cell] = {
    # Its wrist is aside of its base: at home the hand is before the middle of the table.
    ("ur5e", None): Cell.at(-0.05, -0.133),
    # Its elbow bends by 120° at most: what is close to its base it does not reach from above, nor
    # level except from a pedestal, from which the far places of other tasks are out of reach.
    ("iiwa14", None): Cell.at(-0.1, 0.0),
    ("iiwa14", "obstacle_reach"): Cell.at(-0.03, 0.0, 0.46),
}
"""Cells by the names of a robot and of a task, None for all others; robots that have none stand at
the origin of the world."""


def in_cell(robot: Robot, task: str | None = None) -> Robot:
    """Return a robot as it stands in its cell for a task, unless it already has a place.

    Args:
        robot: The robot.
        task: Name of the task; None for the cell of most tasks.
    """
    cell = CELLS.get((robot.name, task)) or CELLS.get((robot.name, None))
    if cell is None or robot.T_world_base is not None or robot.mounts:
        return robot
    return cell.with_robot(robot)
