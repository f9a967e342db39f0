"""Lift and Stack: blocks on a table."""

import numpy as np

from scenarios.judges.suite.cell import Cell, Ticks, moved
from scenarios.judges.suite.grasping import ABOVE, block_grasp, pick

LOWER = 0.02
"""Half edge of the red block of Stack, and of Lift's [m] (lift.py, stack.py)."""
UPPER = 0.025
"""Half edge of the green block of Stack [m] (stack.py)."""
GAP = 0.003
"""Height above the block below at which a block is let go [m]."""


def lift(cell: Cell) -> Ticks:
    """Lift a block by 8 cm; 4 cm count."""
    yield from pick(cell, lambda: block_grasp(cell.pose("cube")))


def stack(cell: Cell) -> Ticks:
    """Put one block on the other, and go away."""
    yield from pick(cell, lambda: block_grasp(cell.pose("cubeA")), up=0.1)
    held = cell.tool.translation() - cell.place("cubeA")
    top = cell.place("cubeB") + np.array([0.0, 0.0, UPPER + LOWER + GAP])
    place = moved(cell.tool, top + held - cell.tool.translation())
    yield from cell.to(moved(place, [0.0, 0.0, ABOVE]), then=(place,))
    yield from cell.to(place, line=True, pace=0.5)
    yield from cell.wait(0.2)
    yield from cell.open()
    yield from cell.by([0.0, 0.0, ABOVE])
