"""Wipe: a wiper is drawn over the markers on a table, in strips."""

import numpy as np
from mink import SE3

from robo47_qp.arrays import Matrix
from robo47_qp.motion.waypoint import tool_down
from robo47_qp.run.failure import Cause
from scenarios.judges.suite.cell import Cell, Failed, Ticks, moved

STRIP = 0.09
"""Distance between strips, across which the wiper is 0.12 m wide [m] (wiping_gripper.xml)."""
BEYOND = 0.015
"""How far a strip goes beyond its first and last marker [m]."""
DEPTH = 0.008
"""Depth below the table's top at which the wiper is asked to be: it presses softly [m]."""
ABOVE = 0.05
"""Height at which the wiper goes from strip to strip [m]."""
ROUNDS = 4
"""Times that the table is looked at and what is left is wiped."""
PACE = 0.6


def wipe(cell: Cell) -> Ticks:
    """Wipe strip by strip, as long as markers are left."""
    for _ in range(ROUNDS):
        left = markers(cell)
        if not len(left):
            return
        across = np.arange(left[:, 1].min(), left[:, 1].max() + STRIP, STRIP)
        for k, y in enumerate(across):
            mine = left[np.abs(left[:, 1] - y) <= 0.5 * STRIP]
            if len(mine):
                yield from strip(cell, mine, y, backwards=k % 2 == 1)
    if len(markers(cell)):
        raise Failed(Cause.PLACE, f"{len(markers(cell))} markers are left")


def markers(cell: Cell) -> Matrix:
    """Where markers are left, in the frame of the robot's base (n, 3) [m]."""
    wiped = [name for name in cell.seen if name.startswith("marker") and name.endswith("_wiped")]
    names = [name.removesuffix("_wiped") for name in wiped if not np.any(cell.seen[name])]
    return np.array([cell.place(name) for name in names]).reshape(-1, 3)


def strip(cell: Cell, mine: Matrix, y: float, *, backwards: bool) -> Ticks:
    """Draw the wiper along x over markers."""
    first, last = mine[:, 0].min() - BEYOND, mine[:, 0].max() + BEYOND
    ends = [on_table(x, y, mine[0, 2]) for x in ((last, first) if backwards else (first, last))]
    yield from cell.to(moved(ends[0], [0.0, 0.0, ABOVE]), then=ends)
    yield from cell.to(ends[0], line=True, pace=PACE)
    yield from cell.to(ends[1], line=True, pace=PACE)
    yield from cell.by(np.array([0.0, 0.0, ABOVE]), pace=PACE)


def on_table(x: float, y: float, top: float) -> SE3:
    """The pose of the wiper that points down, pressed on the table."""
    return tool_down([x, y, top - DEPTH])
