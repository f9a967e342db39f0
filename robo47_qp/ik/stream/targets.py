"""What a stream is told to follow, whatever it is told."""

from collections.abc import Mapping
from math import isfinite

import numpy as np
from mink import SE3

from robo47_qp.model.arm import Arm

_FARTHEST = 1e6
"""Where coordinates of targets end [m]: beyond it differences overflow."""


def pose_or_none(T_world_target: object) -> SE3 | None:
    """The target with its position held within 1000 km of the world's origin, if it is a pose."""
    if not isinstance(T_world_target, SE3):
        return None
    numbers = np.asarray(T_world_target.wxyz_xyz)
    if numbers.shape != (7,) or numbers.dtype.kind not in "fiu":
        return None
    pose = numbers.astype(np.float64)
    w, x, y, z, *position = pose.tolist()
    # Comparisons are false for NaN, and products of floats overflow to infinity.
    if not abs(w * w + x * x + y * y + z * z - 1.0) <= 2e-6 or not all(map(isfinite, position)):
        return None
    if max(map(abs, position)) > _FARTHEST:
        np.clip(pose[4:], -_FARTHEST, _FARTHEST, out=pose[4:])
    elif numbers.dtype == np.float64:
        return T_world_target
    return SE3(pose)


def targets_of(arm: Arm, T_world_target: object) -> Mapping[int, SE3 | None]:
    """Return what is wanted of which tools, whatever is given: None where it is no pose.

    A pose is for the main tool; a mapping, such as `ToolPoses`, has poses by names of tools.
    """
    if not isinstance(T_world_target, Mapping):
        return {0: pose_or_none(T_world_target)}
    names = [tool.name for tool in arm.robot.tools]
    found: dict[int, SE3 | None] = {}
    for name, pose in T_world_target.items():
        if name not in names:
            return {0: None}
        found[names.index(name)] = pose_or_none(pose)
    return found or {0: None}
