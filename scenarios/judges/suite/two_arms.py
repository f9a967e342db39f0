"""TwoArmLift and TwoArmPegInHole: tasks of two arms that face each other.

Sizes are those of robosuite 1.5.2 (pot_with_handles.py, two_arm_lift.py, plate-with-hole.xml,
two_arm_peg_in_hole.py).
"""

from collections.abc import Sequence

import mujoco
import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Vector
from robo47_qp.model.tool_poses import ToolPoses
from robo47_qp.motion.waypoint import tool_down
from scenarios.judges.suite.cell import Failed, Ticks, moved
from scenarios.judges.suite.grasping import ABOVE, ATTEMPTS, yaw_of
from scenarios.judges.suite.pair import FIRST, SECOND, Pair, Solid, at

TABLE = Solid(at(0.0, 0.0, 0.775), (0.4, 0.4, 0.025))
"""The table of TwoArmLift."""
POT = (0.07, 0.07, 0.07)
"""Half edges of the pot [m]."""
HANDLE = np.array([0.0, 0.16, 0.06])
"""Middle of the bar of the first hand's handle, from the pot's middle; that of the second hand is
opposite. The bars are 20 mm thick and lead along x [m]."""
BAR = (0.055, 0.01, 0.01)
"""Half edges of a bar [m]."""
LOWERED = 0.004
"""Depth of the grip sites below the middle of a bar, so that the pads are around it [m]."""
LIFT = 0.16
"""Height by which the pot is lifted; 0.10 count [m]."""
PEG = at(0.0, 0.0, 0.13)
"""Middle of the peg, from the first hand's flange; it is 0.26 m long, along the flange's z."""
PEG_SIZE = (0.03, 0.13, 0.0)
"""Largest radius of the peg, which is drawn from 15 to 30 mm, and half its length [m]."""
PLATE = SE3.from_rotation_and_translation(
    SO3(np.sqrt([0.0, 0.0, 0.5, 0.5])), np.array([0.11, 0.0, 0.17])
)
"""The plate, from the second hand's flange."""
PLATE_PARTS = (
    ((0.0, 0.0), (0.06, 0.17)),
    ((0.22, 0.0), (0.06, 0.17)),
    ((0.11, 0.11), (0.05, 0.06)),
    ((0.11, -0.11), (0.05, 0.06)),
)
"""Middles and half edges of the boxes around the hole, in the plate's x and y [m]."""
PLATE_THICK = 0.01
"""Half the thickness of the plate [m]."""
HOLE = np.array([0.11, 0.0, 0.0])
"""Middle of the hole, 0.1 m square, in the frame of the plate [m]."""
MEETING = np.array([0.0, 0.0, 1.2])
"""Where the hole is when the peg comes: between the arms, whose bases stand 0.912 m high [m]."""
LEAN = np.pi / 4
"""Angle from straight down to the peg's way: each hand points down and to the other arm [rad]."""
BACK = 0.08
"""How far the peg goes back from the plate before anything turns [m]."""
AWAY, BEFORE, THROUGH = 0.2, 0.06, 0.07
"""Distance of the peg's tip from the hole while the plate is turned, before the peg is led in, and
beyond the hole at the end [m]; the verdict wants any part of the peg beyond, up to its middle and
0.12 m more."""
PACE = 0.5


def two_arm_lift(pair: Pair) -> Ticks:
    """Both hands take a pot by its handles from above, and lift it level."""
    for attempt in range(ATTEMPTS):
        pot = level(pair.pose("pot"))
        pair.keep_clear(around=[TABLE, *pot_solids(pot)])
        grasps = ToolPoses(
            {
                name: pair.nearest(name, handle_grasps(pot, side))
                for name, side in ((FIRST, 1.0), (SECOND, -1.0))
            }
        )
        above = up(grasps, ABOVE)
        yield from pair.to(above, then=(grasps,))
        yield from pair.to(grasps, line=True, pace=PACE)
        try:
            yield from pair.close()
            yield from pair.carry(pot, moved(pot, [0.0, 0.0, LIFT]), pace=PACE)
            pair.check_held()
        except Failed:
            if attempt == ATTEMPTS - 1:
                raise
            yield from pair.open()
            yield from pair.to(up(pair.tools, ABOVE), line=True)
            continue
        return


def level(pose: SE3) -> SE3:
    """A pose without its tilt: what stands on a table has none."""
    turn = SO3.from_z_radians(yaw_of(pose))
    return SE3.from_rotation_and_translation(turn, pose.translation())


def up(poses: ToolPoses, height: float) -> ToolPoses:
    """Poses that are higher [m]."""
    return poses.each(lambda _, pose: moved(pose, [0.0, 0.0, height]))


def handle_grasps(pot: SE3, side: float) -> Sequence[SE3]:
    """The two ways to hold a handle from above, fingers on both sides of its bar.

    Args:
        pot: T_world_pot.
        side: 1 for the first hand's handle, -1 for the other.
    """
    bar = pot.apply(HANDLE * [1.0, side, 1.0]) - [0.0, 0.0, LOWERED]
    return [tool_down(bar, yaw_of(pot) + turn) for turn in (0.0, np.pi)]


def pot_solids(pot: SE3) -> list[Solid]:
    """The pot and the bars of its handles, for collision checks."""
    bars = [at(*(HANDLE * [1.0, side, 1.0])) for side in (1.0, -1.0)]
    return [Solid(pot, POT), *(Solid(pot @ bar, BAR) for bar in bars)]


def peg_in_hole(pair: Pair) -> Ticks:
    """Bring the plate between the arms and the peg before its hole, and lead the peg in."""
    # At first they may be closer than is kept: straight back from the plate, whatever the peg's
    # radius is.
    start = pair.tools[FIRST]
    yield from pair.to(ToolPoses({FIRST: moved(start, [0.0, -BACK, 0.0])}), line=True, pace=PACE)
    pair.keep_clear(first=[peg_solid()], second=plate_solids())
    way = np.array([0.0, np.sin(LEAN), -np.cos(LEAN)])
    plate = pair.nearest(SECOND, plate_hands(way))
    # One after the other: the plate's corners would sweep over the peg.
    yield from pair.to(ToolPoses({FIRST: peg_hand(MEETING, way, -AWAY)}))
    yield from pair.to(ToolPoses({SECOND: plate}))
    # The hole as it is seen now; where the peg is, the first arm's joints tell.
    seen = pair.pose("hole")
    hole, normal = seen.apply(HOLE), seen.rotation().as_matrix()[:, 2]
    way = normal * np.sign(normal @ way)
    for beyond in (-BEFORE, THROUGH):
        yield from pair.to(ToolPoses({FIRST: peg_hand(hole, way, beyond)}), line=True, pace=PACE)
    yield from pair.wait(0.2)


def peg_hand(hole: Vector, way: Vector, beyond: float) -> SE3:
    """The first hand's flange with the peg's tip beyond a hole, along its way [m]."""
    across = np.array([1.0, 0.0, 0.0])
    across = across - (across @ way) * way
    across /= np.linalg.norm(across)
    axes = np.stack([np.cross(across, way), across, way], axis=1)
    tip = 2.0 * PEG.translation()[2]
    return SE3.from_rotation_and_translation(SO3.from_matrix(axes), hole + (beyond - tip) * way)


def plate_hands(way: Vector) -> list[SE3]:
    """The second hand's flange with the hole at the meeting place, across the peg's way."""
    down = np.array([0.0, -way[2], way[1]]) * np.sign(way[2])
    found = []
    for sign in (1.0, -1.0):
        axes = np.stack([np.cross(sign * way, down), sign * way, down], axis=1)
        R = SO3.from_matrix(axes)
        found.append(SE3.from_rotation_and_translation(R, MEETING - R.apply(PLATE.apply(HOLE))))
    return found


def peg_solid() -> Solid:
    """The peg in the frame of its flange, as thick as it may be."""
    return Solid(PEG, PEG_SIZE, mujoco.mjtGeom.mjGEOM_CYLINDER)


def plate_solids() -> list[Solid]:
    """The plate in the frame of its flange."""
    return [Solid(PLATE @ at(*middle, 0.0), (*half, PLATE_THICK)) for middle, half in PLATE_PARTS]
