"""Heading: the rotation about the vertical of an object on a table."""

from collections.abc import Sequence

import numpy as np
from mink import SE3, SO3


def upright(position: Sequence[float], heading: float) -> SE3:
    return SE3.from_rotation_and_translation(SO3.from_z_radians(heading), np.array(position))


def heading(T_world_body: SE3) -> float:
    """Return the rotation angle of a pose about the world's vertical [rad]."""
    R = T_world_body.rotation().as_matrix()
    return float(np.arctan2(R[1, 0], R[0, 0]))


def quarter(angle: float) -> float:
    """Return the angle modulo quarter turns, within an eighth of a turn from zero [rad]."""
    return (angle + np.pi / 4) % (np.pi / 2) - np.pi / 4


def level(T_world_body: SE3) -> SE3:
    """Return a pose with the same position and heading and no tilt."""
    x, y, z = T_world_body.translation()
    return upright([x, y, z], heading(T_world_body))


def tilt(T_world_body: SE3) -> float:
    """Return the angle between the z axis of a pose and the vertical [rad]."""
    up = T_world_body.rotation().as_matrix()[2]
    return float(np.arctan2(np.hypot(up[0], up[1]), up[2]))


def end_tilt(T_world_body: SE3) -> float:
    """Return the angle between the vertical and the z axis of a pose, whichever end is up [rad]."""
    angle = tilt(T_world_body)
    return min(angle, np.pi - angle)


def raised(T_world_body: SE3, height: float) -> SE3:
    """Return a pose that is higher by so much [m]."""
    return SE3.from_translation(np.array([0.0, 0.0, height])) @ T_world_body
