"""The robot's MJCF, prepared for `Arm` and `Simulation`."""

from collections.abc import Mapping
from copy import copy
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

import mujoco
import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import ModelError, UnknownNameError
from robo47_qp.model.obstacle import Obstacle, add_obstacle
from robo47_qp.model.payload import Payload
from robo47_qp.model.robot import Hand, Robot, Tool
from robo47_qp.model.ties import check_untied

_ON_JOINTS = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)

_IMPLICIT = 0.05
"""Damping in a period, relative to the inertia, above which it is not neglected [-]."""
_PEDESTAL = 0.1
"""Radius of the pedestal under an upright base above the table [m]."""
_UPRIGHT = 0.999
"""Least cosine of the tilt of a base that stands on one, rather than hangs or is on a wall."""


def compiled(spec: mujoco.MjSpec, mjcf: Path) -> mujoco.MjModel:
    """Return the model of a spec that was read from a file.

    Raises:
        ModelError: MuJoCo cannot compile it.
    """
    try:
        return spec.compile()
    except ValueError as error:
        message = f"MuJoCo cannot compile {mjcf}: {error}. Give it a whole model."
        raise ModelError(message) from error


def read_spec(mjcf: Path) -> mujoco.MjSpec:
    """Read a file into a spec, and name the joints that have no name.

    Raises:
        ModelError: MuJoCo cannot read the file.
    """
    try:
        spec = mujoco.MjSpec.from_file(str(mjcf))
    except ValueError as error:
        raise ModelError(f"MuJoCo cannot read {mjcf}: {error}. Give it an MJCF file.") from error
    for body in spec.bodies:
        for i, joint in enumerate(body.joints):
            joint.name = joint.name or f"{body.name}_joint{i}"
    return spec


def spec_with_hand(mjcf: Path, hand: Hand | None) -> mujoco.MjSpec:
    """Read the file of an arm, and add a hand to it where one is given.

    Raises:
        ModelError: MuJoCo cannot read a file.
        UnknownNameError: The file lacks the site for the hand.
    """
    spec = read_spec(mjcf)
    if hand is None:
        return spec
    site = spec.site(hand.site)
    if site is None:
        raise UnknownNameError("site", hand.site, [site.name for site in spec.sites])
    # The keyframes of the arm would have too few numbers for the whole.
    _delete(spec, spec.keys)
    added = read_spec(hand.mjcf)
    turn = SE3.from_rotation(SO3.from_z_radians(hand.turn))
    for body in list(added.worldbody.bodies):
        placed = turn @ SE3(np.concatenate([body.quat, body.pos]))
        body.pos, body.quat = placed.translation(), placed.rotation().wxyz
    spec.attach(added, prefix=hand.PREFIX, site=site)
    return spec


def robot_spec(robot: Robot, *, drawn: bool = True) -> mujoco.MjSpec:
    """Return the robot with its tool frame and its torque motors as the only drives of the arm.

    Args:
        robot: The description.
        drawn: Whether to keep the geoms that are there to be seen only, which cost time.

    Raises:
        UnknownNameError: The file lacks a joint, the tool's body, or the tool frame.
        ModelError: MuJoCo cannot read the file.
    """
    return _prepared(robot, drawn).copy()


def forget_files() -> None:
    """Have the files of robots read anew: they are kept as they were read first."""
    for kept in (_prepared, _bare_model, _bare_arm):
        kept.cache_clear()


@lru_cache(maxsize=16)
def _prepared(robot: Robot, drawn: bool) -> mujoco.MjSpec:
    """Return the spec of `robot_spec`; callers copy it, as reading takes long."""
    if not drawn:
        bare = robot_spec(robot)
        remove_visuals(bare)
        return bare
    spec = _mounted(robot) if robot.mounts else spec_with_hand(robot.mjcf, robot.hand)
    _place(robot, spec)
    known = [joint.name for joint in spec.joints]
    for name in robot.joints:
        if name not in known:
            raise UnknownNameError("joint", name, known)
    # The keyframes have as many numbers as the file has joints, but a scene has more or fewer.
    _delete(spec, spec.keys)
    check_untied(robot, spec)
    if not robot.grippers:
        _weld_others(robot, spec)
    if not robot.has_motors:
        _replace_drives(robot, spec)
    _correct(robot, spec)
    if robot.tool is not None:
        body = spec.body(robot.tool.body)
        if body is None:
            raise UnknownNameError("body", robot.tool.body, [body.name for body in spec.bodies])
        pose = robot.tool.T_body_tcp.wxyz_xyz
        body.add_site(name=robot.tcp, pos=pose[4:], quat=pose[:4])
    for each in robot.tools:
        if spec.site(each.tcp) is None:
            raise UnknownNameError("site", each.tcp, [site.name for site in spec.sites])
    return spec


def _place(robot: Robot, spec: mujoco.MjSpec) -> None:
    """Put all that stands in the world where the robot stands; upright and high, on a pedestal."""
    if robot.T_world_base is not None:
        pose = robot.T_world_base.wxyz_xyz
        base = spec.worldbody.add_frame(pos=pose[4:], quat=pose[:4])
        world = spec.worldbody
        placed: list[Any] = [*world.bodies, *world.geoms, *world.sites]
        for element in placed:
            # What is in a frame of its own moves with that.
            (element if element.frame is None else element.frame).set_frame(base)
        x, y, height = pose[4:].tolist()
        if height > 0.0 and robot.T_world_base.rotation().as_matrix()[2, 2] > _UPRIGHT:
            spec.worldbody.add_geom(
                name="pedestal",
                type=mujoco.mjtGeom.mjGEOM_CYLINDER,
                size=[_PEDESTAL, 0.5 * height, 0.0],
                pos=[x, y, 0.5 * height],
                rgba=[0.35, 0.36, 0.38, 1.0],
            )


def _correct(robot: Robot, spec: mujoco.MjSpec) -> None:
    """Set what the description knows better than the file."""
    if robot.neighbours_apart:
        for name in robot.joints:
            link = cast(mujoco.MjsJoint, spec.joint(name)).parent
            before = None if link is None else link.parent
            if link is not None and before is not None and before != spec.worldbody:
                spec.add_exclude(bodyname1=before.name, bodyname2=link.name)
    for i, name in enumerate(robot.joints):
        joint = cast(mujoco.MjsJoint, spec.joint(name))
        if robot.armature is not None:
            joint.armature = robot.armature[i]
        if robot.damping is not None:
            joint.damping = [robot.damping[i], 0.0, 0.0]


def _mounted(robot: Robot) -> mujoco.MjSpec:
    """Return a spec of the copies of the robot's file."""
    spec = mujoco.MjSpec()
    spec.modelname = robot.name
    for mount in robot.mounts:
        pose = mount.T_world_base.wxyz_xyz
        frame = spec.worldbody.add_frame(pos=pose[4:], quat=pose[:4])
        part = spec_with_hand(robot.mjcf, robot.hand)
        # The keyframes of a part would have too few numbers for the whole.
        _delete(part, part.keys)
        spec.attach(part, prefix=mount.prefix, frame=frame)
    return spec


def remove_visuals(spec: mujoco.MjSpec) -> None:
    """Delete geoms without contacts and mass, and unused meshes."""
    for geom in list(spec.geoms):
        drawn_only = geom.contype == 0 and geom.conaffinity == 0
        if drawn_only and geom.parent.explicitinertial:
            spec.delete(geom)
    used = {geom.meshname for geom in spec.geoms}
    # A mesh without a name goes by that of its file.
    _delete(spec, [mesh for mesh in spec.meshes if (mesh.name or Path(mesh.file).stem) not in used])


def add_payload(
    spec: mujoco.MjSpec, model: mujoco.MjModel, tool: Tool, payload: Payload, name: str
) -> None:
    """Fix a body to a tool of a robot that `robot_spec` made; `model` is the spec, compiled."""
    # Compiling resolves all ways in which a site's orientation can be written.
    site, tcp = model.site(tool.tcp), cast(mujoco.MjsSite, spec.site(tool.tcp))
    T_body_com = SE3(np.concatenate([site.quat, site.pos])) @ payload.T_tcp_com
    tcp.parent.add_body(
        name=name,
        pos=T_body_com.translation(),
        quat=T_body_com.rotation().wxyz,
        mass=payload.mass,
        ipos=np.zeros(3),
        inertia=np.asarray(payload.inertia),
        explicitinertial=True,
    )


def _weld_others(robot: Robot, spec: mujoco.MjSpec) -> None:
    """Weld all joints except the arm's and those of free bodies; delete what drives them."""
    others = [
        joint
        for joint in spec.joints
        if joint.name not in robot.joints and joint.type != mujoco.mjtJoint.mjJNT_FREE
    ]
    if not others:
        return
    _delete(spec, [drive for drive in spec.actuators if drive.name not in robot.motors])
    for elements in (spec.sensors, spec.tendons, spec.equalities, others):
        _delete(spec, elements)


def _replace_drives(robot: Robot, spec: mujoco.MjSpec) -> None:
    """Replace the actuators of the arm's joints, as servos resist any torque, by motors."""
    for element in spec.joints:
        if element.name in robot.joints:
            # The limits of the motors, from the description, take their place.
            element.actfrclimited = False
    drives = [drive for drive in spec.actuators if drive.trntype in _ON_JOINTS]
    _delete(spec, [drive for drive in drives if drive.target in robot.joints])
    limits = robot.tau_max.tolist()
    for joint, motor, limit in zip(robot.joints, robot.motors, limits, strict=True):
        drive = spec.add_actuator(
            name=motor,
            target=joint,
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            gear=[1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            ctrllimited=True,
            ctrlrange=[-limit, limit],
            forcelimited=True,
            forcerange=[-limit, limit],
        )
        drive.set_to_motor()


def _delete(spec: mujoco.MjSpec, elements: Any) -> None:
    for element in list(elements):
        spec.delete(element)


def compile_arm(
    robot: Robot, payloads: Mapping[str, Payload], obstacles: tuple[Obstacle, ...]
) -> mujoco.MjModel:
    """Compile a model of exactly the robot's joints, without contacts and limit forces.

    Args:
        robot: The description.
        payloads: What tools hold, by their names.
        obstacles: Obstacles, which exert no forces.

    Raises:
        UnknownNameError: See `robot_spec`; no tool has the name that a payload goes by.
        InvalidValueError: The name of an obstacle is taken.
        ModelError: The MJCF does not compile to the joints of the robot, or a joint slides
            without a range.
    """
    bare = _bare_model(robot, obstacles)
    if not payloads:
        return copy(bare)
    spec = _arm_spec(robot, obstacles)
    for name, payload in payloads.items():
        i = robot.tool_index(name)
        add_payload(spec, bare, robot.tools[i], payload, f"{name}_payload" if i else "payload")
    return _checked(robot, spec.compile())


@lru_cache(maxsize=16)
def _bare_model(robot: Robot, obstacles: tuple[Obstacle, ...]) -> mujoco.MjModel:
    """Return the model without payloads; callers copy it, as compiling takes long."""
    return _checked(robot, _arm_spec(robot, obstacles).compile())


def _arm_spec(robot: Robot, obstacles: tuple[Obstacle, ...]) -> mujoco.MjSpec:
    spec = _bare_arm(robot).copy()
    for obstacle in obstacles:
        add_obstacle(spec, obstacle)
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    # Accelerations are those of the joints, not differences of a simulation.
    spec.option.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_INVDISCRETE)
    return spec


def _checked(robot: Robot, model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a model of the arm, its limits as `Arm` expects them; see `compile_arm`."""
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
    free = ~model.jnt_limited.astype(bool)
    endless = [order[i] for i in sliding if free[i]]
    if endless:
        raise ModelError(
            f"Robot {robot.name!r} has joints that slide without a range: {endless}. "
            "Give them one; only joints that turn may have none."
        )
    model.jnt_range[free] = 0.0
    model.dof_armature += implicit_inertia(model)
    return model


def implicit_inertia(model: mujoco.MjModel) -> Vector:
    """Return what damping adds to the inertias in an arm's model (n,) [kg·m²]; zeros if little.

    MuJoCo integrates damping B implicitly: over a period dt it resists like the inertia dt B. That
    is more than the links have where a file gives light wrists without rotors.
    """
    implicit: Vector = TIMESTEP * model.dof_damping
    return implicit if (implicit > _IMPLICIT * model.dof_M0).any() else np.zeros(model.nv)


@lru_cache(maxsize=16)
def _bare_arm(robot: Robot) -> mujoco.MjSpec:
    """Return the robot's joints and links alone; callers copy it, as deleting takes long."""
    spec = robot_spec(robot)
    others = [joint for joint in spec.joints if joint.name not in robot.joints]
    for elements in (spec.actuators, spec.sensors, spec.tendons, spec.equalities, others):
        _delete(spec, elements)
    remove_visuals(spec)
    return spec
