"""Two Franka Pandas side by side at one table, their model made of the Panda's.

Limits, stiffness and grippers are those of the single arm (see module `panda`).
"""

from dataclasses import replace

import numpy as np
from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.model.robot import Mount, Robot, Tool
from robo47_qp.model.robots.panda import PANDA

SIDES = ("left", "right")
"""Names of the tools, and with an underscore the prefixes of all names of an arm."""
APART = 0.7
"""Distance of the bases, which stand at y = ± half of it and look along x [m]."""


def panda_pair() -> Robot:
    """The pair; its main tool is that of the left arm, on the side of positive y."""
    (gripper,) = PANDA.grippers
    left, right = (gripper.prefixed(f"{side}_") for side in SIDES)
    return replace(
        PANDA,
        name="panda_pair",
        mounts=tuple(
            Mount(prefix=f"{side}_", T_world_base=SE3.from_translation(np.array([0.0, y, 0.0])))
            for side, y in zip(SIDES, (0.5 * APART, -0.5 * APART), strict=True)
        ),
        joints=tuple(f"{side}_{joint}" for side in SIDES for joint in PANDA.joints),
        motors=tuple(f"{side}_{motor}" for side in SIDES for motor in PANDA.motors),
        tcp="left_tcp",
        tool_name="left",
        gripper=left,
        more_tools=(Tool(name="right", tcp="right_tcp", gripper=right),),
        home=_twice(PANDA.home),
        rated=PANDA.rated.followed_by(PANDA.rated),
        profile=PANDA.profile.followed_by(PANDA.profile),
        tau_max=_twice(PANDA.tau_max),
        tau_rate_max=_twice(PANDA.tau_rate_max),
        stiffness=_twice(PANDA.stiffness),
        menagerie=None,
    )


def _twice(values: Vector) -> Vector:
    return np.concatenate([values, values])
