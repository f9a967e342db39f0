"""The model of an arm: the robot alone, with what it holds and what stands around it."""

from functools import lru_cache
from typing import Any

import mujoco
import numpy as np

from robo47_qp.errors import ModelError
from robo47_qp.obstacle import Obstacle, add_obstacle
from robo47_qp.robot import Robot
from robo47_qp.robot_model import add_payload, robot_spec, without_looks
from robo47_qp.waypoint import Payload


def compile_arm(
    robot: Robot, payload: Payload | None, obstacles: tuple[Obstacle, ...]
) -> mujoco.MjModel:
    """Compile a model of exactly the robot's joints, without contacts and joint stops.

    Raises:
        UnknownNameError: See `robot_spec`.
        InvalidValueError: The name of an obstacle is taken.
        ModelError: The MJCF does not compile to the joints of the robot, or a joint has no
            position limits.
    """
    spec = _bare(robot).copy()
    if payload is not None:
        add_payload(spec, robot, payload, "payload")
    for obstacle in obstacles:
        add_obstacle(spec, obstacle)
    # No contacts and no joint stops: inverse dynamics of the free arm.
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    model = spec.compile()
    order = tuple(model.joint(i).name for i in range(model.njnt))
    if order != robot.joints or model.nq != model.nv:
        raise ModelError(
            f"Robot {robot.name!r} names the joints {robot.joints}; its model has {order} "
            "in that order once all others are welded. List them from base to tip."
        )
    sliding = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE)
    slides = tuple(order[i] for i in sliding)
    if set(slides) != set(robot.slides):
        raise ModelError(
            f"Robot {robot.name!r} says that of its joints {robot.slides} slide; in its model "
            f"{slides} do. List those as `slides`."
        )
    if not model.jnt_limited.all():
        free = [model.joint(i).name for i in np.flatnonzero(~model.jnt_limited.astype(bool))]
        raise ModelError(f"Robot {robot.name!r} has joints without a range: {free}.")
    return model


@lru_cache(maxsize=16)
def _bare(robot: Robot) -> mujoco.MjSpec:
    """The robot's joints and what they carry; to be copied, because striking out takes long."""
    spec = robot_spec(robot)
    drives: list[Any] = [
        *spec.actuators,
        *spec.sensors,
        *spec.tendons,
        *spec.equalities,
    ]
    for element in drives:
        spec.delete(element)
    for joint in list(spec.joints):
        if joint.name not in robot.joints:
            spec.delete(joint)
    without_looks(spec)
    return spec
