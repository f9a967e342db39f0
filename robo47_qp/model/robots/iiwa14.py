"""KUKA LBR iiwa 14 R820 with a parallel gripper; the arm is taken from MuJoCo Menagerie.

Speeds, ranges and torques are the manufacturer's (KUKA Roboter GmbH, "LBR iiwa 7 R800, LBR iiwa
14 R820, Specification", Spez LBR iiwa V5, basic data and axis data). KUKA publishes neither
accelerations and jerks of the axes nor torque rates: those here, and the stiffness, are choices
that the simulated arm keeps. The spheres of Menagerie's links are larger than the links: those of
neighbours overlap in a third of KUKA's range of a joint.
"""

from math import pi, radians

import numpy as np

from robo47_qp.model.hands import TCP, hand
from robo47_qp.model.menagerie import menagerie_file
from robo47_qp.model.robot import MotionProfile, Robot

_N = 7
_MODEL = "kuka_iiwa_14/iiwa14"


def iiwa14() -> Robot:
    """The arm; its tool frame is between the fingers.

    Raises:
        MenagerieError, MissingExtraError: See `menagerie_file`.
    """
    v_max = np.array([radians(v) for v in (85.0, 85.0, 100.0, 75.0, 130.0, 135.0, 135.0)])
    gripper = hand("parallel_gripper", "attachment_site", turn=pi)
    tau_max = np.array([320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0])
    return Robot(
        name="iiwa14",
        mjcf=menagerie_file(_MODEL),
        joints=tuple(f"joint{i}" for i in range(1, _N + 1)),
        motors=tuple(f"joint{i}_torque" for i in range(1, _N + 1)),
        has_motors=False,
        hand=gripper,
        gripper=gripper.gripper.prefixed(gripper.PREFIX),
        tcp=TCP,
        home=np.array([0.0, 0.3, 0.0, -1.6, 0.0, pi - 1.9, 0.0]),
        rated=MotionProfile(v_max=v_max, a_max=5.0 * v_max, j_max=100.0 * v_max),
        # Less than rated: a joint that follows it may be a little faster for a moment.
        profile=MotionProfile(v_max=0.9 * v_max, a_max=2.0 * v_max, j_max=8.0 * v_max),
        tau_max=tau_max,
        tau_rate_max=tau_max / 0.05,
        stiffness=np.array([150.0, 800.0, 75.0, 400.0, 60.0, 60.0, 15.0]),
        neighbours_apart=True,
        menagerie=_MODEL,
    )
