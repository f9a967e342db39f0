"""Door: a lever is turned down, and the door pulled open by it."""

import numpy as np
from mink import SE3, SO3

from scenarios.judges.suite.cell import Axis, Cell, Ticks, moved

LATCH = np.array([-0.175, 0.0, -0.025])
"""A point on the lever's axis, the door's y, in the door's frame [m] (door_lock.xml)."""
HANDLE = np.array([0.125, -0.10, 0.0])
"""From there to what is seen of the lever."""
HOLD = np.array([0.105, -0.10, 0.0])
"""From there to where the lever is held."""
HINGE = np.array([0.255, 0.0, 0.0])
"""A point on the axis of the hinge, which is vertical, in the door's frame [m]."""
TURN, SWING = 1.3, 0.36
"""How far the lever is turned, and the door opened; 0.3 count [rad]."""
AWAY = 0.1
"""Distance from the lever from which it is approached [m]."""
PACE = 0.5


def door(cell: Cell) -> Ticks:
    """Hold the lever from the front, turn it by turning the hand, and pull."""
    at, lever = cell.place("door"), cell.place("handle")
    told = (LATCH + HANDLE)[:2]
    seen = (lever - at)[:2]
    yaw = np.arctan2(seen[1], seen[0]) - np.arctan2(told[1], told[0])
    # The lever is what is held: the door's middle only tells the heading.
    turn = SO3.from_z_radians(yaw)
    T_base_door = SE3.from_rotation_and_translation(turn, lever - turn.apply(LATCH + HANDLE))
    latch = Axis(T_base_door.apply(LATCH), turn.apply(np.array([0.0, 1.0, 0.0])))
    hinge = Axis(T_base_door.apply(HINGE), np.array([0.0, 0.0, 1.0]))
    hold, ahead = T_base_door.apply(LATCH + HOLD), turn.apply(np.array([0.0, 1.0, 0.0]))
    # The fingers close from above and below: between them and the door the hand has no room.
    across = np.array([0.0, 0.0, -1.0])
    axes = np.stack([np.cross(across, ahead), across, ahead], axis=1)
    grasp = SE3.from_rotation_and_translation(SO3.from_matrix(axes), hold)
    yield from cell.to(moved(grasp, -AWAY * ahead), then=(grasp,))
    yield from cell.to(grasp, line=True)
    yield from cell.close()
    yield from cell.around(latch, TURN, pace=PACE)
    yield from cell.around(hinge, SWING, pace=PACE)
    yield from cell.wait(0.2)
