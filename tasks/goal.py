"""Goal: the pose at which an item is to stand on the table, shown by a marker without contacts."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.run.failure import Cause, Failure
from robo47_qp.run.steps import StepLike
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.handling.place_criterion import PlaceCriterion, miss
from robo47_qp.tasks.handling.pose_estimate import estimate_pose, estimate_poses
from robo47_qp.tasks.heading import upright
from robo47_qp.tasks.item import Item
from robo47_qp.tasks.table import TABLE_TOP

GREEN, YELLOW = (0.15, 0.55, 0.30, 1.0), (0.95, 0.75, 0.20, 1.0)
GOAL = "goal"
"""Name of the marker."""
_RIM = 0.005
"""Width of the marker's rim around the item [m]."""


def add_goal(
    spec: mujoco.MjSpec, item: Item, rgba: tuple[float, float, float, float] = GREEN
) -> None:
    """Add the marker of an item's goal to a scene."""
    body = spec.worldbody.add_body(name=GOAL, mocap=True)
    x, y, _ = item.size
    body.add_geom(
        name=GOAL,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[0.5 * x + _RIM, 0.5 * y + _RIM, 0.0005],
        rgba=rgba,
        contype=0,
        conaffinity=0,
    )


def place_goal(simulation: Simulation, where: Sequence[float] | np.ndarray, turn: float) -> None:
    """Put the marker at a position on the table, x and y [m], with a heading [rad]."""
    simulation.place_marker(GOAL, upright([*where, TABLE_TOP], turn))


def marked_goal(simulation: Simulation) -> SE3:
    """Return T_world_goal of the marker, on the table."""
    return simulation.marker_pose(GOAL)


def seen_goal(sensed: Sensed) -> SE3:
    """Return T_world_goal of the marker as the camera sees it now."""
    return sensed.seen_pose(GOAL)


def goal_pose(sensed: Sensed, item: Item) -> SE3:
    """Return T_world_item of an item that stands on the marker as the camera sees it now."""
    return _standing(item, seen_goal(sensed))


def estimate_goal(sensed: Sensed) -> Generator[StepLike, None, SE3]:
    """Estimate T_world_goal of the marker on the table, at whose height it is, by the camera."""
    return on_table((yield from estimate_pose(sensed, GOAL)))


def estimate_item_goal(sensed: Sensed, item: Item) -> Generator[StepLike, None, SE3]:
    """Estimate T_world_item of an item that stands on the marker, by the camera."""
    T_world_goal = yield from estimate_goal(sensed)
    return _standing(item, T_world_goal)


def estimate_goal_and_item(
    sensed: Sensed, item: Item
) -> Generator[StepLike, None, tuple[SE3, SE3]]:
    """Estimate the same, and T_world_item of the item as it is, from the same images."""
    seen = yield from estimate_poses(sensed, (GOAL, item.name))
    return _standing(item, on_table(seen[GOAL])), seen[item.name]


def on_table(seen: SE3) -> SE3:
    """Return the pose of a marker on the table, at whose height it is."""
    x, y, _ = seen.translation()
    return SE3.from_rotation_and_translation(seen.rotation(), np.array([x, y, TABLE_TOP]))


def _standing(item: Item, T_world_goal: SE3) -> SE3:
    up = np.array([0.0, 0.0, 0.5 * item.height])
    return SE3.from_translation(up) @ T_world_goal


@dataclass(frozen=True, kw_only=True, eq=False)
class Goal:
    """Goal of one item in a simulation."""

    simulation: Simulation
    item: Item

    def pose(self) -> SE3:
        """Return T_world_item of the item when it stands on the marker."""
        return _standing(self.item.as_in(self.simulation), marked_goal(self.simulation))

    def missed(self, criterion: PlaceCriterion) -> Failure | None:
        """Return why the item is not placed at its goal; None if it is."""
        against = criterion.against(self.simulation, self.item, self.pose())
        return None if against is None else Failure(cause=Cause.PLACE, evidence=against)

    def measures(self) -> dict[str, float]:
        """Return the errors of the item's position, in 3-D [m], heading and tilt [rad]."""
        off = miss(self.item, self.simulation.object_pose(self.item.name), self.pose())
        return {
            "place_error_m": off.distance,
            "place_turn_rad": off.turn,
            "place_tilt_rad": off.tilt,
        }
