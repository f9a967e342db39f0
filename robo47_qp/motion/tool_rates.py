"""Speeds, accelerations and jerks of the tool by differences of its poses."""

from typing import NamedTuple

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from robo47_qp.arm import Arm
from robo47_qp.arrays import Matrix, Vector


class ToolRates(NamedTuple):
    """Sizes of the first three derivatives, moving and turning; each (N, 2).

    Means over one, two and three steps: each is bounded by what bounds the derivative.
    """

    v: Matrix
    a: Matrix
    j: Matrix


def tool_rates(arm: Arm, q: Matrix, dt: float) -> ToolRates:
    """Of configurations (N, n) that are dt apart, at rest before the first and after the last."""
    positions, quats = tool_places(arm, q)
    rotations = Rotation.from_quat(quats, scalar_first=True)
    turns = rotations[:-1].apply((rotations[:-1].inv() * rotations[1:]).as_rotvec())
    steps = np.stack([np.diff(positions, axis=0), turns], axis=1)
    still = np.zeros((2, 2, 3))
    v = np.concatenate([still, steps, still]) / dt
    a = np.diff(v, axis=0) / dt
    return ToolRates(*(_sizes(x) for x in (v[2:-2], a, np.diff(a, axis=0) / dt)))


def tool_places(arm: Arm, q: Matrix) -> tuple[Matrix, Matrix]:
    """Positions (N, 3) [m] and quaternions wxyz (N, 4) of the tool at configurations (N, n)."""
    positions, quats = np.empty((len(q), 3)), np.empty((len(q), 4))
    m, d = arm.model, arm.scratch
    joints, position, quat = d.qpos, d.site_xpos[arm.tool_site], d.site_xquat[arm.tool_site]
    for k, row in enumerate(q):
        joints[:] = row
        mujoco.mj_kinematics(m, d)
        positions[k], quats[k] = position, quat
    return positions, quats


def _sizes(values: Matrix) -> Matrix:
    sizes: Vector = np.linalg.norm(values, axis=2)
    return sizes
