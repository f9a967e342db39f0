"""Compliant grasp of an item whose position is uncertain."""

from collections.abc import Generator
from dataclasses import replace

import numpy as np
from mink import SE3

from robo47_qp.run.compliance import Compliance
from robo47_qp.run.steps import Grasp, StepLike
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.item import Item

_AROUND = 4e-3
"""Distance of each finger from the item up to which the gripper closes fast: four times the
standard deviation of the item's position [m]."""
_GENTLY = 0.01
"""Rate of the opening width when one finger touches before the other [m/s]. At the gripper's full
speed, the impact exceeds the rated acceleration of the joints."""
_YIELDING = np.array([800.0, 50.0, 800.0, 40.0, 40.0, 40.0])
"""Stiffness of the tool, in its own frame [N/m, N·m/rad]. Along y, where the fingers
close, 2 mm take 0.1 N: a slender peg tips over at 0.3 N."""


def compliant_grasp(
    simulation: Simulation, item: Item, T_world_item: SE3, grasp: Grasp
) -> Generator[StepLike, None, None]:
    """Close the fingers on an item; slowly and with a compliant arm if the camera is noisy.

    Fingers that are not centred on the item push it and the arm aside. The compliant arm lets
    them centre.

    Args:
        simulation: The simulated world.
        item: The item between the fingers.
        T_world_item: Its estimated pose.
        grasp: The grasp to use if the pose is known.
    """
    if simulation.camera_noise:
        near = item.width(simulation.tool_pose(), T_world_item) + 2.0 * _AROUND
        if near < simulation.width():
            yield Grasp(name="close around", force=grasp.force, width=near)
        springs = Compliance(stiffness=_YIELDING, frame="tool")
        grasp = replace(grasp, speed=_GENTLY, compliance=springs)
    yield grasp
