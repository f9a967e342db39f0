"""PickPlaceCan: a can out of one bin, into its quarter of another."""

import numpy as np

from robo47_qp.motion.waypoint import tool_down
from scenarios.judges.suite.cell import Cell, Ticks, moved
from scenarios.judges.suite.grasping import pick

GOAL = np.array([0.1 + 0.05, 0.28 + 0.05, 0.8])
"""Place on the floor of the can's quarter of the bin, which begins at (0.1, 0.28) and is reached
best there [m] (pick_place.py: bin2_pos, bin_size)."""
HEIGHT = 0.04
"""From the can's middle to its foot [m] (objects/can.xml)."""
HOLD = 0.015
"""Height of the grasp above the can's middle: the hand stays above the walls of the bin [m]."""
ABOVE = 0.15
"""Height at which the can is carried over the walls, which are 0.1 m [m]."""
DROP = 0.02
"""Height above the floor of the bin at which the can is let go [m]."""


def can(cell: Cell) -> Ticks:
    """Take the can by its sides, and put it down upright."""
    hold = np.array([0.0, 0.0, HOLD])
    yield from pick(cell, lambda: tool_down(cell.place("Can") + hold), up=ABOVE)
    place = tool_down(cell.here(GOAL) + hold + np.array([0.0, 0.0, HEIGHT + DROP]))
    yield from cell.to(moved(place, [0.0, 0.0, ABOVE - DROP]), then=(place,))
    yield from cell.to(place, line=True)
    yield from cell.open()
    yield from cell.by([0.0, 0.0, 0.1])
