"""Memory: what a task remembers of an episode. It is in the world, and nowhere else."""

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.sim.simulation import Simulation

_GONE = SE3.from_translation(np.array([0.0, 0.0, -1.0]))
"""Where markers are that are done with: below the floor."""


def add_memory(spec: mujoco.MjSpec, count: int) -> None:
    """Let the world keep some numbers for its task: MuJoCo's user data, 0 after every reset."""
    spec.nuserdata = count


def memory(simulation: Simulation) -> np.ndarray:
    """These numbers (count,), to be read and written."""
    return simulation.data.userdata


def put_away(simulation: Simulation, marker: str) -> None:
    """Take a marker out of sight for the rest of the episode: what it marks is done."""
    simulation.place_marker(marker, _GONE)


def in_sight(simulation: Simulation, marker: str) -> bool:
    """True until a marker is put away."""
    return bool(simulation.marker_pose(marker).translation()[2] > -0.5)
