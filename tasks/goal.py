"""Goal: the pose at which an item is to stand on the table, shown by a marker without contacts."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.run.failure import Cause, Failure
from robo47_qp.run.steps import StepLike
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.handling.pose_estimate import estimate_pose
from robo47_qp.tasks.heading import upright
from robo47_qp.tasks.item import Item
from robo47_qp.tasks.table import TABLE_TOP

GREEN, YELLOW = (0.15, 0.55, 0.30, 1.0), (0.95, 0.75, 0.20, 1.0)
_NAME = "goal"
_RIM = 0.005
"""Width of the marker's rim around the item [m]."""
_STILL = 1e-3
"""Speed below which an item counts as at rest [m/s]."""


def add_goal(
    spec: mujoco.MjSpec, item: Item, rgba: tuple[float, float, float, float] = GREEN
) -> None:
    """Add the marker of an item's goal to a scene."""
    body = spec.worldbody.add_body(name=_NAME, mocap=True)
    x, y, _ = item.size
    body.add_geom(
        name=_NAME,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[0.5 * x + _RIM, 0.5 * y + _RIM, 0.0005],
        rgba=rgba,
        contype=0,
        conaffinity=0,
    )


def place_goal(simulation: Simulation, where: Sequence[float] | np.ndarray, turn: float) -> None:
    """Put the marker at a position on the table, x and y [m], with a heading [rad]."""
    simulation.place_marker(_NAME, upright([*where, TABLE_TOP], turn))


def marked_goal(simulation: Simulation) -> SE3:
    """Return T_world_goal of the marker, on the table."""
    return simulation.marker_pose(_NAME)


def estimate_goal(simulation: Simulation, marker: str = _NAME) -> Generator[StepLike, None, SE3]:
    """Estimate T_world_goal of a marker on the table, at whose height it is, by the camera."""
    seen = yield from estimate_pose(simulation, marker)
    x, y, _ = seen.translation()
    return SE3.from_rotation_and_translation(seen.rotation(), np.array([x, y, TABLE_TOP]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Goal:
    """Goal of one item in a simulation."""

    simulation: Simulation
    item: Item

    def pose(self) -> SE3:
        """Return T_world_item of the item when it stands on the marker."""
        return self._on(marked_goal(self.simulation))

    def estimate(self) -> Generator[StepLike, None, SE3]:
        """Estimate the same pose by the camera."""
        T_world_goal = yield from estimate_goal(self.simulation)
        return self._on(T_world_goal)

    def _on(self, T_world_goal: SE3) -> SE3:
        up = np.array([0.0, 0.0, 0.5 * self.item.height])
        return SE3.from_translation(up) @ T_world_goal

    def error(self) -> float:
        """Return the distance of the item's centre from its goal, in 3-D [m]."""
        item = self.simulation.object_pose(self.item.name).translation()
        return float(np.linalg.norm(item - self.pose().translation()))

    def missed(self, tolerance: float) -> Failure | None:
        """Return why the item is not at rest at its goal; None if it is.

        Args:
            tolerance: Largest distance of the item from its goal [m].
        """
        error = self.error()
        speed = float(np.linalg.norm(self.simulation.object_twist(self.item.name)[:3]))
        if error <= tolerance and speed <= _STILL:
            return None
        evidence = (
            f"the {self.item.name} is {1e3 * error:.1f} mm from its goal and moves at "
            f"{1e3 * speed:.1f} mm/s; allowed are {1e3 * tolerance:.1f} mm, 1 mm/s"
        )
        return Failure(cause=Cause.PLACE, evidence=evidence)
