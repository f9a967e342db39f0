"""Which signals a run records, and those computed from others."""

from collections.abc import Sequence

import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.model.robot import Robot
from robo47_qp.run.recording import Rows, Signal

_POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
_POSE_UNIT = "m, quaternion wxyz"


def reference(robot: Robot) -> tuple[Signal, ...]:
    """What the planner asks for at t_k; `tau_ref` is the arm's inverse dynamics of it."""
    joints, unit = robot.joints, robot.unit
    return (
        Signal(name="joints/q_ref", labels=joints, unit=unit("rad", "m")),
        Signal(name="joints/v_ref", labels=joints, unit=unit("rad/s", "m/s")),
        Signal(name="joints/a_ref", labels=joints, unit=unit("rad/s²", "m/s²")),
        Signal(name="joints/tau_ref", labels=joints, unit=unit("N·m", "N")),
        Signal(name="tool/pose_ref", labels=_POSE, unit=_POSE_UNIT),
    )


def now(robot: Robot, objects: Sequence[str]) -> tuple[Signal, ...]:
    """What the simulation is at t_k, in the order of `Simulation.write_now`."""
    gripper: tuple[Signal, ...] = ()
    if robot.gripper is not None:
        gripper = (
            Signal(name="gripper/fingers", labels=robot.gripper.joints, unit="m"),
            Signal(name="gripper/width_command", labels=("width",), unit="m"),
        )
    return (
        Signal(name="joints/q", labels=robot.joints, unit=robot.unit("rad", "m")),
        Signal(name="joints/v", labels=robot.joints, unit=robot.unit("rad/s", "m/s")),
        Signal(name="tool/pose", labels=_POSE, unit=_POSE_UNIT),
        *gripper,
        *(Signal(name=f"objects/{name}", labels=_POSE, unit=_POSE_UNIT) for name in objects),
    )


def command(robot: Robot) -> tuple[Signal, ...]:
    """What the controller asks for at t_k."""
    unit = robot.unit("N·m", "N")
    return (Signal(name="joints/tau_command", labels=robot.joints, unit=unit),)


def last(robot: Robot) -> tuple[Signal, ...]:
    """What happened from t_k to t_k+1, in the order of `Simulation.write_last`."""
    return (
        Signal(name="joints/a", labels=robot.joints, unit=robot.unit("rad/s²", "m/s²")),
        Signal(name="joints/tau", labels=robot.joints, unit=robot.unit("N·m", "N")),
        Signal(name="contact/tool", labels=("x", "y", "z"), unit="N"),
        Signal(name="contact/links", labels=("sum",), unit="N"),
        *(
            Signal(name=f"gripper/{finger}_contact", labels=("x", "y", "z"), unit="N")
            for finger in _fingers(robot)
        ),
    )


def derived(robot: Robot) -> tuple[Signal, ...]:
    """What follows from the others, filled by `derive`."""
    gripper: tuple[Signal, ...] = ()
    if robot.gripper is not None:
        gripper = (
            Signal(name="gripper/width", labels=("width",), unit="m"),
            Signal(name="gripper/force", labels=robot.gripper.fingers, unit="N"),
        )
    return (
        Signal(name="errors/q", labels=robot.joints, unit=robot.unit("rad", "m")),
        Signal(name="errors/tool_position", labels=("distance",), unit="m"),
        Signal(name="errors/tool_angle", labels=("angle",), unit="rad"),
        Signal(name="joints/saturated", labels=("motors",), unit="count"),
        *gripper,
    )


def all_signals(robot: Robot, objects: Sequence[str]) -> tuple[Signal, ...]:
    """Every signal of a run, in the order of its columns."""
    return (
        Signal(name="time", labels=("t",), unit="s"),
        Signal(name="phase", labels=("index",), unit="count"),
        *reference(robot),
        *now(robot, objects),
        *command(robot),
        *last(robot),
        *derived(robot),
    )


def derive(rows: Rows, fingers: Sequence[str]) -> None:
    """Fill the derived columns of rows whose other columns are filled.

    Args:
        rows: Rows of `all_signals`.
        fingers: The gripper's fingers; none where there is no gripper.
    """
    np.subtract(rows["joints/q_ref"], rows["joints/q"], out=rows["errors/q"])
    pose, asked = rows["tool/pose"], rows["tool/pose_ref"]
    rows["errors/tool_position"][:, 0] = np.linalg.norm(asked[:, :3] - pose[:, :3], axis=1)
    rows["errors/tool_angle"][:, 0] = _angle_between(asked[:, 3:], pose[:, 3:])
    off = rows["joints/tau"] != rows["joints/tau_command"]
    rows["joints/saturated"][:, 0] = off.sum(axis=1)
    if fingers:
        rows["gripper/width"][:, 0] = rows["gripper/fingers"].sum(axis=1)
    for i, finger in enumerate(fingers):
        rows["gripper/force"][:, i] = np.linalg.norm(rows[f"gripper/{finger}_contact"], axis=1)


def _fingers(robot: Robot) -> tuple[str, ...]:
    return () if robot.gripper is None else robot.gripper.fingers


def _angle_between(a: Matrix, b: Matrix) -> Vector:
    """Angle of the rotation between unit quaternions (N, 4), accurate near zero [rad]."""
    # |a ∓ b| = 2 sin(angle/4): unlike arccos of the dot product, exact for small angles.
    chord = np.minimum(np.linalg.norm(a - b, axis=1), np.linalg.norm(a + b, axis=1))
    angle: Vector = 4.0 * np.arcsin(np.clip(chord / 2.0, 0.0, 1.0))
    return angle
