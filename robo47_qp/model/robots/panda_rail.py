"""Franka Panda with its hand on a rail of 4 m along y: eight joints.

Limits of the arm are those of the Panda alone (see module `panda`). Speed, acceleration, jerk and
force of the rail are choices, of the order of a belt-driven robot track for a small arm.
"""

from pathlib import Path

import numpy as np

from robo47_qp.model.carrier import Carrier
from robo47_qp.model.robot import MotionProfile, Robot
from robo47_qp.model.robots.panda import PANDA

_MJCF = Path(__file__).parent / "models" / "panda_rail.xml"


def rail() -> Carrier:
    """The rail, for the file of a Panda."""
    return Carrier(
        name="panda_rail",
        mjcf=_MJCF,
        prefix="panda_",
        joints=("rail",),
        slides=("rail",),
        rated=MotionProfile.uniform(1, v=1.5, a=4.0, j=100.0),
        profile=MotionProfile.uniform(1, v=1.0, a=2.0, j=8.0),
        tau_max=np.array([400.0]),
        tau_rate_max=np.array([4_000.0]),
        stiffness=np.array([20_000.0]),
    )


def panda_rail() -> Robot:
    """The arm on its rail; it stands at the middle, looking along x."""
    return rail().carrying(PANDA)
