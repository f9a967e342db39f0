"""Universal Robots UR5e with a parallel gripper; its model comes with the package.

Joint speeds are those of the UR5e user manual (180°/s), torques those of Universal Robots, "Max.
joint torques". Universal Robots publishes neither accelerations and jerks of the joints nor torque
rates: those here, and the stiffness, are choices that the simulated arm keeps.
"""

from math import pi
from pathlib import Path

import numpy as np

from robo47_qp.model.hands import PARALLEL_GRIPPER, TCP
from robo47_qp.model.robot import Hand, MotionProfile, Robot

_JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
_N = len(_JOINTS)
_TAU_MAX = np.array([150.0, 150.0, 150.0, 28.0, 28.0, 28.0])

UR5E = Robot(
    name="ur5e",
    mjcf=Path(__file__).parent / "models" / "ur5e.xml",
    joints=_JOINTS,
    motors=tuple(f"{joint}_torque" for joint in _JOINTS),
    tcp=TCP,
    home=np.array([0.0, -2.0, 2.0, -pi / 2, -pi / 2, 0.0]),
    rated=MotionProfile.uniform(_N, v=pi, a=14.0, j=700.0),
    profile=MotionProfile.uniform(_N, v=2.0, a=3.0, j=10.0),
    tau_max=_TAU_MAX,
    tau_rate_max=_TAU_MAX / 0.05,
    stiffness=np.array([600.0, 600.0, 400.0, 100.0, 100.0, 50.0]),
    gripper=PARALLEL_GRIPPER.prefixed(Hand.PREFIX),
)
