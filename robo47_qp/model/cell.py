"""Cell: how a robot stands in the workspace of the tasks."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from mink import SE3, SO3

from robo47_qp.model.robot import Robot
from robo47_qp.model.tool_poses import check_se3


@dataclass(frozen=True, kw_only=True, eq=False)
class Cell:
    """A mount beside the table of the tasks, which belongs to neither robot nor task.

    The places of the tasks fit an arm with the reach of a Panda at the origin of the world; a cell
    moves the base of another arm, on a pedestal if need be, so that they are in its reach, and
    where that is not enough, it moves places, as a bench is laid out for the arm at it.
    """

    T_world_base: SE3 = field(default_factory=SE3.identity)
    """Pose of the origin of the robot's file."""
    places: Mapping[str, object] = field(default_factory=dict)
    """Fields of the task that say where its places are, as they are in this cell."""

    def __post_init__(self) -> None:
        """Check the pose.

        Raises:
            InvalidValueError: It is none.
        """
        check_se3("T_world_base of a cell", self.T_world_base)

    @classmethod
    def at(cls, x: float, y: float, z: float = 0.0, yaw: float = 0.0, **places: object) -> "Cell":
        """Return the cell with the base at a position [m], turned about the vertical [rad]."""
        T_world_base = SE3.from_rotation_and_translation(
            SO3.from_z_radians(yaw), np.array([x, y, z])
        )
        return cls(T_world_base=T_world_base, places=places)

    def with_robot(self, robot: Robot) -> Robot:
        """Return the robot as it stands in the cell."""
        return replace(robot, T_world_base=self.T_world_base)


CELLS: dict[tuple[str, str | None], Cell] = {
    # Its wrist is aside of its base: at home the hand is before the middle of the table.
    ("ur5e", None): Cell.at(-0.05, -0.133),
    # Its elbow bends by 120° at most: what is close to its base it does not reach from above, nor
    # level except from a pedestal, from which the far places of other tasks are out of reach. From
    # there it lacks up to 0.06 rad of the elbow at the nearest shelf and 5 mm behind the farthest
    # post.
    ("iiwa14", None): Cell.at(-0.1, 0.0),
    ("iiwa14", "obstacle_reach"): Cell.at(
        -0.03, 0.0, 0.46, post_distance=(0.33, 0.39), shelf_distance=(0.58, 0.63)
    ),
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


def places_in_cell(robot: Robot, task: str) -> Mapping[str, object]:
    """Return the places of a task, by its fields, that the cell which a robot stands in moves.

    Args:
        robot: The robot, as `in_cell` returns it; elsewhere than in its cell, nothing is moved.
        task: Name of the task.
    """
    cell, base = CELLS.get((robot.name, task)), robot.T_world_base
    if cell is None or base is None:
        return {}
    return cell.places if np.array_equal(base.wxyz_xyz, cell.T_world_base.wxyz_xyz) else {}
