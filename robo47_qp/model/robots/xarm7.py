"""UFACTORY xArm 7 with its gripper; the model of the arm is taken from MuJoCo Menagerie.

Ranges and the speed of the joints are the manufacturer's (UFACTORY xArm user manual, technical
specifications, https://github.com/xArm-Developer/ufactory_doc_usermanual). Torques are those of
its robot description (https://github.com/xArm-Developer/xarm_ros, effort limits), which the
model's actuators have too. Accelerations, jerks, torque rates and the stiffness are choices that
the simulated arm keeps.
"""

from math import pi

import numpy as np

from robo47_qp.model.hands import TCP, hand
from robo47_qp.model.menagerie import menagerie_file
from robo47_qp.model.robot import MotionProfile, Robot

_N = 7
_MODEL = "ufactory_xarm7/xarm7_nohand"


def xarm7() -> Robot:
    """The arm; its tool frame is between the fingers.

    Raises:
        MenagerieError, MissingExtraError: See `menagerie_file`.
    """
    gripper = hand("xarm_gripper", "attachment_site")
    tau_max = np.array([50.0, 50.0, 30.0, 30.0, 30.0, 20.0, 20.0])
    return Robot(
        name="xarm7",
        mjcf=menagerie_file(_MODEL),
        joints=tuple(f"joint{i}" for i in range(1, _N + 1)),
        motors=tuple(f"joint{i}_torque" for i in range(1, _N + 1)),
        has_motors=False,
        hand=gripper,
        gripper=gripper.gripper.prefixed(gripper.PREFIX),
        tcp=TCP,
        home=np.array([0.0, -0.247, 0.0, 0.909, 0.0, 1.15644, 0.0]),
        rated=MotionProfile.uniform(_N, v=pi, a=10.0, j=200.0),
        profile=MotionProfile.uniform(_N, v=1.5, a=3.0, j=12.0),
        tau_max=tau_max,
        tau_rate_max=tau_max / 0.02,
        stiffness=np.array([150.0, 300.0, 50.0, 200.0, 100.0, 100.0, 100.0]),
        armature=np.array([0.61, 0.61, 0.46, 0.46, 0.21, 0.21, 0.21]),
        menagerie=_MODEL,
    )
