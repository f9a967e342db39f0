"""Franka Panda with its hand.

Limits are the manufacturer's for the Panda ("Robot and interface specifications",
https://frankarobotics.github.io/docs/control_parameters.html): velocity, acceleration and
jerk of the joints, torque, and torque rate. The stiffness is that of libfranka's joint
impedance example (https://github.com/frankaemika/libfranka).
"""

from math import pi
from pathlib import Path

import numpy as np

from robo47_qp.model.gripper import Gripper
from robo47_qp.model.robot import MotionProfile, Robot

_N = 7

PANDA = Robot(
    name="panda",
    mjcf=Path(__file__).parent / "models" / "panda.xml",
    joints=tuple(f"joint{i}" for i in range(1, _N + 1)),
    motors=tuple(f"joint{i}_torque" for i in range(1, _N + 1)),
    tcp="tcp",
    home=np.array([0.0, -pi / 4, 0.0, -3 * pi / 4, 0.0, pi / 2, pi / 4]),
    rated=MotionProfile(
        v_max=np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61]),
        a_max=np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]),
        j_max=np.array([7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0]),
    ),
    profile=MotionProfile.uniform(_N, v=2.0, a=3.0, j=10.0),
    tau_max=np.array([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0]),
    tau_rate_max=np.full(_N, 1000.0),
    stiffness=np.array([600.0, 600.0, 600.0, 600.0, 250.0, 150.0, 50.0]),
    gripper=Gripper(
        joints=("finger_joint1", "finger_joint2"),
        fingers=("left_finger", "right_finger"),
        actuator="gripper",
        width_max=0.08,
        speed_max=0.1,
        force_max=70.0,
        force_gain=1.0,
    ),
    menagerie="franka_emika_panda/panda",
)
