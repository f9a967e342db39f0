"""Scene: robot, task objects and physics options compiled into one MuJoCo model."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np
from mink import SE3, SO3

from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import ModelError, UnknownNameError
from robo47_qp.model.mjcf import robot_spec
from robo47_qp.model.obstacle import SIZES, Obstacle, Shape
from robo47_qp.model.robot import Robot
from robo47_qp.sim.contact import add_contact_sensors

_STIFF_FRICTION = [2.0 * TIMESTEP, 1.0], [0.99, 0.99, 1e-3, 0.5, 2.0]
"""`solref` and `solimp` of the dry friction of joints, as stiff as the integrator allows."""
MOUNT_GEOMS = "geoms of the robot's mount"
"""Custom number of a model: how many geoms of the world, the first ones, are the robot's own."""
BuildScene = Callable[[mujoco.MjSpec], None]
"""Adds bodies to a spec that holds the robot, with its base at the world's origin."""


def compile_scene(robot: Robot, build_scene: BuildScene, *, drawn: bool = True) -> mujoco.MjModel:
    """Compile a robot with a scene.

    Args:
        robot: The description.
        build_scene: Adds the scene.
        drawn: See `robot_spec`.

    Raises:
        UnknownNameError: The robot's model lacks a name of its description.
        ModelError: The ids of the robot's joints or motors are not consecutive.
    """
    spec = robot_spec(robot, drawn=drawn)
    _check_names(robot, spec)
    option = spec.option
    option.timestep = TIMESTEP
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    # Grasps creep under MuJoCo's soft friction (github.com/google-deepmind/mujoco/issues/3328):
    # 0.5 kg between pads of µ 0.25 at 30 N by 1.7 mm/s with pyramids at impratio 100, 67 µm/s with
    # elliptic cones at 10, 13 µm/s at 100, and no less at 1000, where it jitters. MuJoCo's solver
    # without slip (noslip) is no part of real contacts: what slips is to slip.
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = 100.0
    for joint in spec.joints:
        # By default a loaded joint creeps under its dry friction, and slow motions hardly feel it.
        joint.solref_friction, joint.solimp_friction = _STIFF_FRICTION
    # At MuJoCo's 1e-8, contacts of light items are left unsolved by up to 9 mN (0.2 mm/s in a
    # period): the cost that has to fall is that of the whole scene, where the arm outweighs them.
    option.tolerance = 1e-12
    # At MuJoCo's 1e-6, the normal of a cylinder that touches a box by less than 0.3 µm points into
    # the box in up to half of the cases: fingers that leave it pull the arm along for a period.
    option.ccd_tolerance = 1e-10
    own = {body.name for body in spec.bodies}
    spec.add_numeric(name=MOUNT_GEOMS, size=1, data=[len(spec.worldbody.geoms)])
    build_scene(spec)
    if not drawn:
        unseen: list[Any] = [*spec.lights, *spec.cameras]
        for element in unseen:
            spec.delete(element)
    add_contact_sensors(spec, robot, _fixed(spec, own))
    model = spec.compile()
    for name, ids in (
        ("joints", [model.joint(joint).id for joint in robot.joints]),
        ("motors", [model.actuator(motor).id for motor in robot.motors]),
    ):
        gaps = {b - a for a, b in pairwise(ids)} - {1}
        # Between the joints of two arms are those of the first one's gripper.
        if gaps and (len(robot.tools) == 1 or min(gaps) < 1):
            raise ModelError(
                f"The {name} of robot {robot.name!r} have the ids {ids} in its model; "
                "they must follow each other, base to tip."
            )
    return model


def _fixed(spec: mujoco.MjSpec, own: set[str]) -> list[str]:
    """Return the names of the bodies that the robot can touch and that stand fixed.

    These are the world, and what the scene adds to it with no joint on the way there, with geoms
    that collide. Unnamed ones get names.
    """
    found = [spec.worldbody.name]
    for i, body in enumerate(list(spec.worldbody.bodies)):
        if body.name in own:
            continue
        for k, part in enumerate(_standing(body)):
            if any(geom.contype or geom.conaffinity for geom in part.geoms):
                part.name = part.name or f"fixed body {i} {k}"
                found.append(part.name)
    return found


def _standing(body: mujoco.MjsBody) -> list[mujoco.MjsBody]:
    """Return a body and those on it that no joint lets move."""
    if body.joints:
        return []
    return [body, *(part for child in body.bodies for part in _standing(child))]


def fixed_obstacle(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Obstacle:
    """Return a geom that stands fixed as an obstacle, where it is.

    Raises:
        ModelError: Its shape is none of `Shape`.
    """
    kind = mujoco.mjtGeom(int(model.geom_type[geom])).name.removeprefix("mjGEOM_")
    if kind not in Shape.__members__:
        raise ModelError(
            f"Geom {model.geom(geom).name!r} of the scene is a {kind.lower()}; what stands fixed "
            f"must be one of {', '.join(shape.value for shape in Shape)}."
        )
    shape = Shape[kind]
    pose = SE3.from_rotation_and_translation(
        SO3.from_matrix(data.geom_xmat[geom].reshape(3, 3)), data.geom_xpos[geom]
    )
    return Obstacle(
        name=model.geom(geom).name or f"geom {geom}",
        shape=shape,
        size=tuple(model.geom_size[geom, : SIZES[shape]].tolist()),
        T_world_obstacle=pose,
    )


def free_bodies(model: mujoco.MjModel) -> tuple[str, ...]:
    """Return the names of the free bodies, in the order of the model."""
    free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    return tuple(model.body(model.jnt_bodyid[i]).name for i in free)


def mocap_bodies(model: mujoco.MjModel) -> tuple[str, ...]:
    """Return the names of the mocap bodies, in the order of their mocap ids."""
    count = int(model.body_mocapid.max()) + 1
    bodies = [int(np.flatnonzero(model.body_mocapid == i)[0]) for i in range(count)]
    return tuple(model.body(body).name for body in bodies)


def _check_names(robot: Robot, spec: mujoco.MjSpec) -> None:
    """Check the names that `robot_spec` does not: motors and gripper."""
    wanted: list[tuple[str, tuple[str, ...], Any]] = [("motor", robot.motors, spec.actuators)]
    for gripper in robot.grippers:
        wanted += [
            ("joint", gripper.joints, spec.joints),
            ("motor", (gripper.actuator,), spec.actuators),
            ("body", gripper.fingers, spec.bodies),
        ]
    for kind, names, elements in wanted:
        known = [element.name for element in elements]
        for name in names:
            if name not in known:
                raise UnknownNameError(kind, name, known)
