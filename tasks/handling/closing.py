"""Closing: the fingers on an item that is not quite where it seems to be."""

from collections.abc import Generator
from dataclasses import replace

import numpy as np
from mink import SE3

from robo47_qp.run.steps import Compliance, Grasp, StepLike
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.item import Item

_AROUND = 4e-3
"""Room that each finger keeps from an item while it closes fast: four times the standard
deviation of where the item is [m]."""
_GENTLY = 0.01
"""Rate of the opening width at which an item is met by one finger before the other [m/s]. The
blow goes with the speed: at the gripper's own, joints exceed their rated acceleration."""
_YIELDING = np.array([800.0, 50.0, 800.0, 40.0, 40.0, 40.0])
"""Stiffness of the tool meanwhile, in its own frame [N/m, N·m/rad]. Along y, where the fingers
close, 2 mm take 0.1 N: a slender peg tips over at 0.3 N."""


def close(
    simulation: Simulation, item: Item, T_world_item: SE3, grasp: Grasp
) -> Generator[StepLike, None, None]:
    """Close the fingers on an item; gently where the camera only nearly knows its place.

    Fingers that close beside the middle push the item and the arm aside. So the arm gives way,
    and finds the middle.

    Args:
        simulation: The world.
        item: What is between the fingers.
        T_world_item: Where it seems to be.
        grasp: How it is grasped where its place is known.
    """
    if simulation.camera_noise:
        near = item.width(simulation.tool_pose(), T_world_item) + 2.0 * _AROUND
        if near < simulation.width():
            yield Grasp(name="close around", force=grasp.force, width=near)
        springs = Compliance(stiffness=_YIELDING, frame="tool")
        grasp = replace(grasp, speed=_GENTLY, compliance=springs)
    yield grasp
