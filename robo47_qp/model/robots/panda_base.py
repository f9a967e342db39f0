"""Franka Panda with its hand on a mobile base that drives in all directions: ten joints.

Limits of the arm are those of the Panda alone (see module `panda`). Speed and acceleration of the
base are those of Clearpath's Ridgeback (linear speed 1 m/s and acceleration 1 m/s², turning speed
4 rad/s: `ridgeback_control/config/control.yaml` of https://github.com/ridgeback/ridgeback); that
file lets it turn faster than its wheels can take it with an arm. Its mass, turning acceleration,
jerks, forces and stiffness are choices.
"""

from pathlib import Path

import numpy as np

from robo47_qp.model.carrier import Carrier
from robo47_qp.model.robot import MotionProfile, Robot
from robo47_qp.model.robots.panda import PANDA

_MJCF = Path(__file__).parent / "models" / "panda_base.xml"


def panda_base() -> Robot:
    """The arm on its base, which is at the origin of the world and looks along x."""
    return Carrier(
        name="panda_base",
        mjcf=_MJCF,
        prefix="panda_",
        joints=("base_x", "base_y", "base_yaw"),
        slides=("base_x", "base_y"),
        rated=MotionProfile(
            v_max=np.array([1.0, 1.0, 4.0]),
            a_max=np.array([1.0, 1.0, 4.0]),
            j_max=np.array([50.0, 50.0, 200.0]),
        ),
        profile=MotionProfile(
            v_max=np.array([0.9, 0.9, 1.5]),
            a_max=np.array([0.8, 0.8, 1.5]),
            j_max=np.array([4.0, 4.0, 6.0]),
        ),
        tau_max=np.array([400.0, 400.0, 250.0]),
        tau_rate_max=np.array([4_000.0, 4_000.0, 2_500.0]),
        stiffness=np.array([50_000.0, 50_000.0, 10_000.0]),
    ).carrying(PANDA)
