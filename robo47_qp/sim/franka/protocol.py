"""The messages of libfranka, protocol 10 of the robot and 3 of the hand.

Layouts, numbers and names are those that Franka Robotics publishes in the headers of
https://github.com/frankarobotics/libfranka-common (`research_interface/robot/rbk_types.h`,
`service_types.h`, `error.h`, `research_interface/gripper/types.h`): little-endian, packed.
"""

from enum import IntEnum
from struct import Struct

import numpy as np

ROBOT_PORT, HAND_PORT = 1337, 1338
ROBOT_VERSION, HAND_VERSION = 10, 3
JOINTS = 7


class Command(IntEnum):
    """Requests to the robot."""

    CONNECT = 0
    MOVE = 1
    STOP_MOVE = 2
    SET_COLLISION_BEHAVIOR = 3
    SET_JOINT_IMPEDANCE = 4
    SET_CARTESIAN_IMPEDANCE = 5
    SET_GUIDING_MODE = 6
    SET_EE_TO_K = 7
    SET_NE_TO_EE = 8
    SET_LOAD = 9
    AUTOMATIC_ERROR_RECOVERY = 10
    GET_ROBOT_MODEL = 11


class HandCommand(IntEnum):
    """Requests to the hand."""

    CONNECT = 0
    HOMING = 1
    GRASP = 2
    MOVE = 3
    STOP = 4


class RobotMode(IntEnum):
    """What the robot is doing."""

    OTHER = 0
    IDLE = 1
    MOVE = 2
    GUIDING = 3
    REFLEX = 4
    USER_STOPPED = 5
    AUTOMATIC_ERROR_RECOVERY = 6


class Generator(IntEnum):
    """What generates the motion, as a state tells it; a request to move counts from 0."""

    IDLE = 0
    JOINT_POSITION = 1
    JOINT_VELOCITY = 2
    CARTESIAN_POSITION = 3
    CARTESIAN_VELOCITY = 4
    NONE = 5


class Controller(IntEnum):
    """What turns the motion into torques."""

    JOINT_IMPEDANCE = 0
    CARTESIAN_IMPEDANCE = 1
    EXTERNAL = 2
    OTHER = 3


class MoveStatus(IntEnum):
    """Answers to a request to move."""

    SUCCESS = 0
    STARTED = 1
    PREEMPTED = 2
    NOT_POSSIBLE = 5
    INVALID_ARGUMENT = 7
    REFLEX_ABORTED = 8
    ABORTED = 11


SUCCESS, REJECTED, INVALID_ARGUMENT, INCOMPATIBLE = 0, 1, 2, 1
"""Answers to other requests to the robot; the last one is to CONNECT."""


class HandStatus(IntEnum):
    """Answers to a request to the hand."""

    SUCCESS = 0
    FAIL = 1
    UNSUCCESSFUL = 2
    ABORTED = 3


ERRORS = (
    "joint_position_limits_violation",
    "cartesian_position_limits_violation",
    "self_collision_avoidance_violation",
    "joint_velocity_violation",
    "cartesian_velocity_violation",
    "force_control_safety_violation",
    "joint_reflex",
    "cartesian_reflex",
    "max_goal_pose_deviation_violation",
    "max_path_pose_deviation_violation",
    "cartesian_velocity_profile_safety_violation",
    "joint_position_motion_generator_start_pose_invalid",
    "joint_motion_generator_position_limits_violation",
    "joint_motion_generator_velocity_limits_violation",
    "joint_motion_generator_velocity_discontinuity",
    "joint_motion_generator_acceleration_discontinuity",
    "cartesian_position_motion_generator_start_pose_invalid",
    "cartesian_motion_generator_elbow_limit_violation",
    "cartesian_motion_generator_velocity_limits_violation",
    "cartesian_motion_generator_velocity_discontinuity",
    "cartesian_motion_generator_acceleration_discontinuity",
    "cartesian_motion_generator_elbow_sign_inconsistent",
    "cartesian_motion_generator_start_elbow_invalid",
    "force_controller_desired_force_tolerance_violation",
    "start_elbow_sign_inconsistent",
    "communication_constraints_violation",
    "power_limit_violation",
    "cartesian_motion_generator_joint_position_limits_violation",
    "cartesian_motion_generator_joint_velocity_limits_violation",
    "cartesian_motion_generator_joint_velocity_discontinuity",
    "cartesian_motion_generator_joint_acceleration_discontinuity",
    "cartesian_position_motion_generator_invalid_frame_flag",
    "controller_torque_discontinuity",
    "joint_p2p_insufficient_torque_for_planning",
    "tau_J_range_violation",
    "instability_detected",
    "joint_move_in_wrong_direction",
    "cartesian_spline_motion_generator_violation",
    "joint_via_motion_generator_planning_joint_limit_violation",
    "base_acceleration_initialization_timeout",
    "base_acceleration_invalid_reading",
)
"""Names of the errors, by the place of their flag in a state."""

HEADER = Struct("<III")
"""Command, id and size of a message to the robot or from it, the header included [bytes]."""
HAND_HEADER = Struct("<HII")
CONNECT = Struct("<HH")
"""Version of the client's protocol, and its UDP port."""
MOVE = Struct("<II3d3d?7d")
"""Controller, generator, two deviations, and what asks for asynchronous motion."""
LOAD = Struct("<d3d9d")
"""Mass [kg], its centre in the frame of the flange [m], its inertia by columns [kg m²]."""
GRASP = Struct("<5d")
"""Width [m], inner and outer tolerance [m], speed [m/s] and force [N]."""
HAND_MOVE = Struct("<2d")
"""Width [m] and speed [m/s]."""
HAND_STATE = Struct("<Idd?H")
"""Id, width and largest width [m], whether something is grasped, and temperature [°C]."""

REPLY = {
    "connect": Struct("<BH"),
    "status": Struct("<B"),
    "hand connect": Struct("<HH"),
    "hand status": Struct("<H"),
}
"""What follows the header of an answer: a status, to CONNECT with the server's version."""

COMMAND = np.dtype(
    [
        ("id", "<u8"),
        ("q", "<f8", 7),
        ("dq", "<f8", 7),
        ("O_T_EE", "<f8", 16),
        ("O_dP_EE", "<f8", 6),
        ("elbow", "<f8", 2),
        ("valid_elbow", "u1"),
        ("motion_finished", "u1"),
        ("tau", "<f8", 7),
        ("torque_finished", "u1"),
    ]
)
"""What a client sends in every period; matrices by columns."""
STATE = np.dtype(
    [
        ("id", "<u8"),
        *((name, "<f4", 16) for name in ("O_T_EE", "O_T_EE_d", "F_T_EE", "EE_T_K")),
        *((name, "<f4", 16) for name in ("F_T_NE", "NE_T_EE")),
        *((name, "<f4", size) for name, size in (("m_ee", 1), ("I_ee", 9), ("F_x_Cee", 3))),
        *((name, "<f4", size) for name, size in (("m_load", 1), ("I_load", 9), ("F_x_Cload", 3))),
        *((name, "<f4", 2) for name in ("elbow", "elbow_d")),
        *((name, "<f4", 7) for name in ("tau_J", "tau_J_d", "dtau_J", "q", "q_d")),
        *((name, "<f4", 7) for name in ("dq", "dq_d", "ddq_d")),
        *((name, "<f4", size) for name, size in (("joint_contact", 7), ("cartesian_contact", 6))),
        *((f"{kind}_collision", "<f4", n) for kind, n in (("joint", 7), ("cartesian", 6))),
        *((name, "<f4", size) for name, size in (("tau_ext", 7), ("O_F_ext", 6), ("K_F_ext", 6))),
        *((name, "<f4", size) for name, size in (("O_dP_EE_d", 6), ("O_ddP_O", 3))),
        *((name, "<f4", 2) for name in ("elbow_c", "delbow_c", "ddelbow_c")),
        *((name, "<f4", n) for name, n in (("O_T_EE_c", 16), ("O_dP_EE_c", 6), ("O_ddP_EE_c", 6))),
        *((name, "<f4", 7) for name in ("theta", "dtheta")),
        *((name, "<f4", 18) for name in ("accelerometer_top", "accelerometer_bottom")),
        *((name, "u1") for name in ("generator", "controller")),
        *((name, "u1", len(ERRORS)) for name in ("errors", "reflex_reason")),
        ("robot_mode", "u1"),
        ("success_rate", "<f4"),
    ]
)
"""What the robot sends in every period; matrices by columns."""
