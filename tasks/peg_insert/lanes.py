"""Lanes along which a peg is moved over a block to find the hole.

Each is along the tool's y: fingers close along y, and hold a peg that is dragged along it; about y
it turns between them.
"""

from dataclasses import replace

import numpy as np
from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.motion.waypoint import Motion, Waypoint

_BEYOND = 1e-4
"""Distance from a tool across lanes from which on a lane is not the one that it is on [m]."""


def across(T_world_tcp: SE3, axis: Vector) -> tuple[Vector, Vector]:
    """Return the directions next to a tool's x and y that are normal to the hole's axis (3,)."""
    x = np.cross(T_world_tcp.rotation().as_matrix()[:, 1], axis)
    x /= np.linalg.norm(x)
    return x, np.cross(axis, x)


def search_lanes(corner: SE3, axis: Vector, radius: float, pitch: float) -> tuple[Waypoint, ...]:
    """Return lanes, and short ones between them, from a corner of the square to search.

    Args:
        corner: Pose of the tool there.
        axis: Axis of the hole (3,) [-].
        radius: Half the side of the square [m].
        pitch: Distance between two lanes [m].
    """
    x, y = across(corner, axis)
    count, poses = int(np.ceil(2.0 * radius / pitch)), []
    for i in range(count + 1):
        for end in (i % 2, 1 - i % 2):
            at = i * pitch * x + 2.0 * radius * end * y
            poses.append(SE3.from_translation(at) @ corner)
    return tuple(
        Waypoint(name=f"search {i}", target=pose, motion=Motion.LIN)
        for i, pose in enumerate(poses[1:], start=1)
    )


def lanes_beyond(here: SE3, axis: Vector, lanes: tuple[Waypoint, ...]) -> tuple[Waypoint, ...]:
    """Return the lanes beyond the one of a tool pose; the next begins beside that pose.

    From there it is searched to the end from which the tool came, and then as a whole.
    """
    x, y = across(here, axis)
    off = [end_of(lane).translation() - here.translation() for lane in lanes]
    left = [i for i, by in enumerate(off) if by.dot(x) > _BEYOND]
    if not left:
        return ()
    beside = SE3.from_translation(-off[left[0]].dot(y) * y) @ end_of(lanes[left[0]])
    ahead = tuple(lanes[i] for i in left)
    return (replace(ahead[0], name="search beside", target=beside), *ahead[1:2], *ahead)


def end_of(lane: Waypoint) -> SE3:
    """Return the pose of the tool at the end of a lane."""
    if not isinstance(lane.target, SE3):
        raise InvalidValueError(f"the end of {lane.name!r}", lane.target, "a pose")
    return lane.target
