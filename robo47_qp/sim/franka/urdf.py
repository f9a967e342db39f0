"""The description of the served arm that libfranka's clients ask for."""

import mujoco
import numpy as np
from mink import SO3

from robo47_qp.arrays import Vector
from robo47_qp.model.robot import Robot
from robo47_qp.sim.franka import limits


def urdf(robot: Robot, model: mujoco.MjModel) -> str:
    """Return the URDF of an arm without its hand, which a state tells of.

    Names are those that libfranka looks for: link0 to link8, the flange, and joint1 to joint7.

    Args:
        robot: The arm.
        model: A model with it.
    """
    bodies = [int(model.joint(name).bodyid[0]) for name in robot.joints]
    bodies = [int(model.body_parentid[bodies[0]]), *bodies]
    parts = [f'<robot name="{robot.name}">']
    parts += [_link(model, i, body) for i, body in enumerate(bodies)]
    parts.append('<link name="link8"/>')
    for i, body in enumerate(bodies[1:]):
        place = _origin(model.body_pos[body], model.body_quat[body])
        limit = (
            f'lower="{limits.Q_MIN[i]}" upper="{limits.Q_MAX[i]}" '
            f'velocity="{limits.V_MAX[i]}" effort="{limits.TAU_MAX[i]}"'
        )
        parts.append(
            f'<joint name="joint{i + 1}" type="revolute"><parent link="link{i}"/>'
            f'<child link="link{i + 1}"/>{place}<axis xyz="0 0 1"/><limit {limit}/>'
            f'<position_based_velocity_limits deceleration_limit="{limits.DECELERATION[i]}" '
            f'velocity_offset="{limits.V_OFFSET[i]}"/></joint>'
        )
    parts.append(
        '<joint name="joint8" type="fixed"><parent link="link7"/><child link="link8"/>'
        '<origin xyz="0 0 0.107" rpy="0 0 0"/></joint></robot>'
    )
    return "\n".join(parts)


def _link(model: mujoco.MjModel, i: int, body: int) -> str:
    x, y, z = model.body_inertia[body].tolist()
    return (
        f'<link name="link{i}"><inertial>'
        f"{_origin(model.body_ipos[body], model.body_iquat[body])}"
        f'<mass value="{float(model.body_mass[body])}"/>'
        f'<inertia ixx="{x!r}" iyy="{y!r}" izz="{z!r}" ixy="0" ixz="0" iyz="0"/>'
        "</inertial></link>"
    )


def _origin(position: Vector, quaternion: Vector) -> str:
    roll, pitch, yaw = map(float, SO3(np.array(quaternion)).as_rpy_radians())
    x, y, z = position.tolist()
    return f'<origin xyz="{x} {y} {z}" rpy="{roll} {pitch} {yaw}"/>'
