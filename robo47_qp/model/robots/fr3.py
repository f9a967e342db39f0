"""Franka Research 3 with its hand; its model comes with the package.

Limits are Franka's for the FR3 ("Robot and interface specifications",
https://frankarobotics.github.io/docs/control_parameters.html): velocity, acceleration and jerk of
the joints, torque, and torque rate. The stiffness is that of libfranka's joint impedance example
(https://github.com/frankaemika/libfranka).
"""

from math import pi
from pathlib import Path

import numpy as np

from robo47_qp.model.hands import FRANKA_HAND, TCP
from robo47_qp.model.robot import Hand, MotionProfile, Robot

_N = 7

FR3 = Robot(
    name="fr3",
    mjcf=Path(__file__).parent / "models" / "fr3.xml",
    joints=tuple(f"joint{i}" for i in range(1, _N + 1)),
    motors=tuple(f"joint{i}_torque" for i in range(1, _N + 1)),
    tcp=TCP,
    home=np.array([0.0, -pi / 4, 0.0, -3 * pi / 4, 0.0, pi / 2, pi / 4]),
    rated=MotionProfile(
        v_max=np.array([2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26]),
        a_max=np.full(_N, 10.0),
        j_max=np.full(_N, 5000.0),
    ),
    profile=MotionProfile.uniform(_N, v=2.0, a=3.0, j=10.0),
    tau_max=np.array([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0]),
    tau_rate_max=np.full(_N, 1000.0),
    stiffness=np.array([600.0, 600.0, 600.0, 600.0, 250.0, 150.0, 50.0]),
    gripper=FRANKA_HAND.prefixed(Hand.PREFIX),
)
