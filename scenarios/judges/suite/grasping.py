"""Grasps from above: what programs of several tasks share."""

from collections.abc import Callable

import numpy as np
from mink import SE3

from robo47_qp.motion.waypoint import tool_down
from scenarios.judges.suite.cell import OPEN, Cell, Failed, Ticks, moved

ABOVE = 0.08
"""Height above a grasp that is approached first [m]."""
ATTEMPTS = 3
"""Grasps that are tried."""


def yaw_of(pose: SE3) -> float:
    """The heading of a thing: of its x axis about the vertical [rad]."""
    R = pose.rotation().as_matrix()
    return float(np.arctan2(R[1, 0], R[0, 0]))


def quarter(angle: float) -> float:
    """The same up to quarter turns, within an eighth of a turn from zero [rad]."""
    return (angle + np.pi / 4) % (np.pi / 2) - np.pi / 4


def block_grasp(pose: SE3) -> SE3:
    """A grasp of a block from above, by the faces that turn the hand least."""
    return tool_down(pose.translation(), quarter(yaw_of(pose)))


def pick(cell: Cell, grasp: Callable[[], SE3], up: float = ABOVE) -> Ticks:
    """Grasp a thing from above and lift it; where it is lost, look and try again.

    Args:
        cell: The robot.
        grasp: Looks where the thing is, and returns where to grasp it.
        up: Height to lift it by [m].

    Raises:
        Failed: It was not held after the last attempt.
    """
    for attempt in range(ATTEMPTS):
        cell.grips[:] = OPEN
        target = grasp()
        lifted = moved(target, [0.0, 0.0, up])
        yield from cell.to(moved(target, [0.0, 0.0, ABOVE]), then=(target, lifted))
        yield from cell.to(target, line=True)
        try:
            yield from cell.close()
            yield from cell.by([0.0, 0.0, up])
            cell.check_held()
        except Failed:
            if attempt == ATTEMPTS - 1:
                raise
            yield from cell.open()
            yield from cell.to(moved(target, [0.0, 0.0, ABOVE]), line=True)
            continue
        return
