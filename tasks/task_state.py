"""Task state: numbers that a task keeps in the simulation during an episode."""

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.sim.sensed import HIDDEN_BELOW
from robo47_qp.sim.simulation import Simulation

_HIDDEN = SE3.from_translation(np.array([0.0, 0.0, -1.0]))
"""Pose of hidden markers, below the floor."""


def add_task_state(spec: mujoco.MjSpec, count: int) -> None:
    """Reserve numbers for a task in MuJoCo's user data; they are 0 after every reset."""
    spec.nuserdata = count + 1


def task_state(simulation: Simulation) -> np.ndarray:
    """Return the numbers of the task (count,), which may be written to."""
    return simulation.data.userdata[:-1]


def moved_last(simulation: Simulation) -> np.ndarray:
    """Return the time at which an object that is judged moved last (1,) [s]; see `PlaceCriterion`.

    It may be written to; 0 stands for the start of the episode.
    """
    return simulation.data.userdata[-1:]


def hide_marker(simulation: Simulation, marker: str) -> None:
    """Hide a completed marker for the rest of the episode."""
    simulation.place_marker(marker, _HIDDEN)


def is_visible(simulation: Simulation, marker: str) -> bool:
    """Return True until the marker is hidden."""
    return bool(simulation.marker_pose(marker).translation()[2] > HIDDEN_BELOW)
