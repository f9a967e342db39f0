"""NutAssemblySquare and NutAssemblyRound: nuts onto pegs, held by their handles."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Vector
from robo47_qp.motion.waypoint import tool_down
from robo47_qp.run.failure import Cause
from scenarios.judges.suite.cell import Cell, Failed, Ticks, moved
from scenarios.judges.suite.grasping import ATTEMPTS, pick, yaw_of

TOP, ON = 0.95, 0.87
"""Height of the pegs' tops, and below which a nut is on its peg (pegs_arena.xml) [m]."""
ABOVE = 0.025
"""Height above the pegs at which a nut is brought there [m]."""
LOW = 0.885
"""Height at which a nut is let go around its peg [m]."""
ROOM = 0.02
"""How much further than it is to go the arm must reach [m]."""
LIFT = 0.16
"""Height by which a nut is lifted: above the pegs' tops [m]."""
WRIST = 2.6
"""How far joint 7 may be turned, of 2.89 [rad]."""
RAISED = 0.003
"""Height of the grip site above the middle of a handle: fingertips stand below it [m]."""


@dataclass(frozen=True)
class Nut:
    """The data sheet of a nut and its peg (square-nut.xml, round-nut.xml, pegs_arena.xml)."""

    name: str
    grip: float
    """Where it is held, from its middle along the handle [m]."""
    peg: tuple[float, float]
    """Where its peg stands in robosuite's world [m]."""
    fold: int
    """Number of turns that are tried; the square one fits in four."""


SQUARE = Nut("SquareNut", 0.062, (0.23, 0.1), 4)
ROUND = Nut("RoundNut", 0.068, (0.23, -0.1), 8)


def flat(position: Vector, yaw: float) -> SE3:
    """The pose of a nut that lies flat."""
    return SE3.from_rotation_and_translation(SO3.from_z_radians(yaw), position)


def held(nut: Nut, pose: SE3, turn: float) -> SE3:
    """The grip for a nut that lies flat; `turn` is 0, or a half turn of the hand."""
    yaw = yaw_of(pose)
    handle = nut.grip * np.array([np.cos(yaw), np.sin(yaw), 0.0])
    return tool_down(pose.translation() + handle + [0.0, 0.0, RAISED], yaw + turn)


def choice(cell: Cell, nut: Nut) -> tuple[float, float]:
    """Which half turn of the hand to hold a nut with, and its heading around the peg [rad].

    The wrist is to turn as little as it can on the way to the nut and to the peg.

    Raises:
        Failed: The arm reaches none.
    """
    now, home = cell.pose(nut.name), cell.arm.home[6]
    turns = np.arange(nut.fold) * 2.0 * np.pi / nut.fold
    found = []
    for turn, yaw in product((0.0, np.pi), turns):
        grasp, place = held(nut, now, turn), held(nut, around_peg(cell, nut, LOW, yaw), turn)
        first, last = wrist(cell, grasp), wrist(cell, place)
        if max(abs(first), abs(last)) < WRIST:
            found.append((abs(first - home) + abs(last - first), turn, yaw, grasp, place))
    for _, turn, yaw, *poses in sorted(found, key=lambda one: one[0]):
        if all(cell.reaches(pose) for pose in spread(poses)):
            return turn, yaw
    raise Failed(Cause.IK, f"no way to hold {nut.name} is reached, here and at its peg")


def wrist(cell: Cell, grip: SE3) -> float:
    """Where joint 7 is for a hand that points down, if the elbow is up [rad]."""
    x, y, _ = grip.translation()
    turn = cell.arm.home[6] - (heading(grip) - np.arctan2(y, x))
    return float((turn + np.pi) % (2.0 * np.pi) - np.pi)


def spread(poses: Sequence[SE3]) -> Iterator[SE3]:
    """Poses around some: above, and further away, as a nut may be held otherwise than meant."""
    for pose in poses:
        x, y, _ = pose.translation()
        away = ROOM * np.array([x, y, 0.0]) / np.hypot(x, y)
        for up in (0.0, TOP + ABOVE - LOW):
            yield moved(pose, away + np.array([0.0, 0.0, up]))


def heading(grip: SE3) -> float:
    """The turn of a hand that points down, from that at home [rad]."""
    x = grip.rotation().as_matrix()[:, 0]
    return float(np.arctan2(x[1], x[0]))


def around_peg(cell: Cell, nut: Nut, height: float, yaw: float) -> SE3:
    """The pose of a nut around its peg, at a height in robosuite's world [m]."""
    return flat(cell.here(np.array([*nut.peg, height])), yaw)


def assemble(nut: Nut, cell: Cell) -> Ticks:
    """Bring a nut over its peg and let it go around it; where it is not, begin again."""
    for _ in range(ATTEMPTS):
        turn, yaw = choice(cell, nut)
        yield from pick(cell, partial(grasp_of, cell, nut, turn), up=LIFT)
        # As it is held: where the nut's middle is from the hand, and how it is turned.
        T_grip_nut = cell.measured_tool.inverse() @ cell.pose(nut.name)
        over, low = (
            upright(T_grip_nut, around_peg(cell, nut, height, yaw)) for height in (TOP + ABOVE, LOW)
        )
        yield from cell.to(over, then=(low,))
        yield from cell.wait(0.2)
        yield from cell.to(low, line=True)
        yield from cell.open()
        yield from cell.by([0.0, 0.0, ABOVE + TOP - LOW])
        on = cell.here(np.array([*nut.peg, ON]))
        if cell.place(nut.name)[2] < on[2]:
            return
    raise Failed(Cause.PLACE, f"{nut.name} is not around its peg")


def grasp_of(cell: Cell, nut: Nut, turn: float) -> SE3:
    """Where to hold a nut as it is seen now."""
    return held(nut, cell.pose(nut.name), turn)


def upright(T_grip_nut: SE3, goal: SE3) -> SE3:
    """A grip that points down, with a nut as it is held at a goal; a tilt of the nut stays."""
    down = tool_down(np.zeros(3), heading(goal @ T_grip_nut.inverse()))
    return moved(down, goal.translation() - (down @ T_grip_nut).translation())


square_nut = partial(assemble, SQUARE)
round_nut = partial(assemble, ROUND)
