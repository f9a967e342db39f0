"""ToolHang: a frame is put into a stand, and a tool hung onto the frame's hook.

Poses of the frame are those of its corner, from which its rod leads down (z is up) and its hook
away (against x). Sizes are those of robosuite 1.5.2 (tool_hang.py, hook_frame.py,
stand_with_mount.py, ratcheting_wrench.py).
"""

import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Vector
from robo47_qp.run.failure import Cause
from scenarios.judges.suite.cell import Axis, Cell, Failed, Ticks, moved
from scenarios.judges.suite.grasping import pick

MOUNT = np.array([0.0, 0.045, 0.005])
"""Floor of the stand's tube, from the middle of its plate [m]."""
TUBE = 0.15
"""Depth of the tube, which is 10 mm wide inside; the rod has 7.5 mm [m]."""
ROD = 0.2207
"""From the frame's corner down to the rod's tip [m]."""
TIP = np.array([0.0, 0.0, -ROD])
"""The rod's tip, from the frame's corner [m]."""
IN = 0.01
"""Largest distance of the tip of a rod in its stand from the middle of the stand's floor [m]."""
GRIP = np.array([0.0, 0.0, -0.034])
"""Middle of the frame's grip, which is 25 mm thick and 64 mm long [m]."""
PRONG = np.array([-0.0875, 0.0, 0.0037])
"""Foot of the prong at the hook's end, on the bar; it is 12 mm high [m]."""
RING = np.array([-0.0935, 0.0, 0.0])
"""Middle of the tool's ring, which is 19.4 mm wide and 7 mm thick, from its grip's middle [m]."""
THICK = 0.007
"""Thickness of the ring [m]."""
LEAN = np.deg2rad(25.0)
"""How far the hand leans over the ring, so that it can turn the tool down [rad]."""
T_FRAME_GRIP = SE3.from_rotation_and_translation(
    SO3.from_matrix(np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])), GRIP
)
"""How the hand holds the frame: it comes along y, and the fingers close along the hook."""
T_TOOL_GRIP = SE3.from_rotation(SO3.from_x_radians(np.pi) @ SO3.from_y_radians(LEAN))
"""How it holds the tool."""
LIFT, HIGH = 0.25, 0.33
"""Heights by which the frame is lifted, and the tool, which goes across the frame [m]."""
OVER, FAR = 0.03, 0.08
"""Heights above a place from which the frame and the tool are led down to it [m]."""
GAP = 0.002
"""Height above where things will rest at which they are let go [m]."""
PIVOT = np.array([0.0109, 0.0, 0.0024])
"""About what the tool is turned down, from the prong's foot: the ring slips around the corner
between prong and bar without touching either [m]."""
DOWN = np.deg2rad(45.0)
"""How far the tool is turned down before it is let go [rad]."""
SLOW = 0.5
"""Pace of what needs to be exact."""
AWAY = 0.12
"""How far the hand goes back from what it has let go [m]."""
SWING = 1.5
"""Time in which the tool comes to rest [s]."""


def tool_hang(cell: Cell) -> Ticks:
    """Put the frame into the stand, and hang the tool onto its hook."""
    yield from insert(cell)
    yield from hang(cell)


def insert(cell: Cell) -> Ticks:
    """Take the frame, set it upright above the stand's tube, and lead it down."""
    yield from pick(cell, lambda: cell.pose("frame") @ T_FRAME_GRIP, up=LIFT)
    T_frame_grip = cell.pose("frame").inverse() @ cell.measured_tool
    foot = cell.pose("base").apply(MOUNT)
    over, low = (
        standing(cell, foot + np.array([0.0, 0.0, up + ROD])) @ T_frame_grip
        for up in (TUBE + OVER, GAP)
    )
    # The rod turns down where it was taken up: on a way across, it would hit the stand.
    x, y, _ = cell.tool.translation() - over.translation()
    yield from cell.to(moved(over, [x, y, 0.0]), then=(over, low))
    yield from cell.to(over, line=True)
    yield from cell.to(low, line=True, pace=SLOW)
    yield from cell.open()
    yield from back(cell)
    off = np.linalg.norm(cell.pose("frame").apply(TIP) - foot)
    if off > IN:
        raise Failed(Cause.PLACE, f"the rod's tip is {1e3 * off:.0f} mm off the floor of the stand")


def standing(cell: Cell, corner: Vector) -> SE3:
    """The frame upright, its hook away from the robot and its y to the right."""
    forward, left, up = cell.pose("base").rotation().as_matrix().T
    turn = SO3.from_matrix(np.stack([-forward, -left, up], axis=1))
    return SE3.from_rotation_and_translation(turn, corner)


def back(cell: Cell) -> Ticks:
    """Draw the open hand back."""
    yield from cell.by(-AWAY * cell.tool.rotation().as_matrix()[:, 2])


def hang(cell: Cell) -> Ticks:
    """Put the tool's ring over the prong, turn it down, and let it go."""
    above = moved(cell.pose("tool") @ T_TOOL_GRIP, [0.0, 0.0, HIGH])
    yield from cell.by([0.0, 0.0, AWAY])
    # The hand turns where it is, beside the frame, and goes across it on a line.
    x, y, _ = cell.tool.translation() - above.translation()
    yield from cell.to(moved(above, [x, y, 0.0]), then=(above,))
    yield from cell.to(above, line=True)
    yield from pick(cell, lambda: cell.pose("tool") @ T_TOOL_GRIP, up=HIGH)
    T_tool_grip = cell.pose("tool").inverse() @ cell.measured_tool
    frame = cell.pose("frame")
    out = -frame.rotation().as_matrix()[:, 0]
    foot = frame.apply(PRONG)
    low = around(foot, out, 0.5 * THICK + GAP) @ T_tool_grip
    over = moved(low, [0.0, 0.0, FAR])
    yield from cell.to(over, then=(low,))
    yield from cell.to(low, line=True, pace=SLOW)
    sideways = np.cross([0.0, 0.0, 1.0], out)
    yield from cell.around(Axis(frame.apply(PRONG + PIVOT), sideways), DOWN, pace=SLOW)
    yield from cell.open()
    yield from back(cell)
    yield from cell.wait(SWING)
    if cell.place("tool")[2] > foot[2] + 0.5 * RING[0]:
        raise Failed(Cause.PLACE, "the tool does not hang")


def around(foot: Vector, out: Vector, up: float) -> SE3:
    """The pose of a level tool whose ring is around the prong, its grip outside the hook."""
    across = np.cross([0.0, 0.0, 1.0], out)
    turn = SO3.from_matrix(np.stack([out, across, np.cross(out, across)], axis=1))
    ring = foot + np.array([0.0, 0.0, up])
    return SE3.from_rotation_and_translation(turn, ring - turn.apply(RING))
