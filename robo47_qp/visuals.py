"""Looks: MuJoCo Menagerie's meshes in place of a robot's primitive shapes."""

from importlib import import_module
from pathlib import Path
from typing import Any

import mujoco

from robo47_qp.errors import MissingExtraError, ModelError, UnknownNameError
from robo47_qp.robot import Robot
from robo47_qp.scene import BuildScene

_VISUAL_GROUP = 2


def with_menagerie_looks(robot: Robot, build_scene: BuildScene) -> BuildScene:
    """Scene with the robot's visual shapes replaced; masses and contacts stay as they are.

    Args:
        robot: Its description names the model in Menagerie.
        build_scene: Adds everything else.

    Raises:
        UnknownNameError: The robot has no model in Menagerie.
        MissingExtraError: The package that provides Menagerie is not installed.
        ModelError: Menagerie's files cannot be fetched.
    """
    if robot.menagerie is None:
        raise UnknownNameError("Menagerie model", robot.name, ())
    directory, entry = robot.menagerie.split("/")
    try:
        menagerie: Any = import_module("mujoco_menagerie")
    except ImportError as error:
        raise MissingExtraError("--visuals menagerie", "mujoco-menagerie", "visuals") from error
    try:
        meshes = Path(menagerie.get(directory).path())
        looks = mujoco.MjSpec.from_file(str(meshes / f"{entry}.xml"))
    except (menagerie.MenagerieError, OSError, ValueError) as error:
        raise ModelError(
            f"Menagerie's {directory} cannot be loaded: {error}. It is fetched at first use; "
            "without network, set MENAGERIE_ROOT to a checkout of MuJoCo Menagerie."
        ) from error

    def build(spec: mujoco.MjSpec) -> None:
        _dress(spec, looks, meshes / looks.meshdir)
        build_scene(spec)

    return build


def _dress(spec: mujoco.MjSpec, looks: mujoco.MjSpec, directory: Path) -> None:
    for geom in list(spec.geoms):
        if geom.group == _VISUAL_GROUP:
            spec.delete(geom)
    colours = {material.name: material.rgba for material in looks.materials}
    files = {mesh.name or Path(mesh.file).stem: directory / mesh.file for mesh in looks.meshes}
    added = set()
    for geom in looks.geoms:
        body = spec.body(geom.parent.name)
        if geom.group != _VISUAL_GROUP or body is None:
            continue
        if geom.meshname not in added:
            spec.add_mesh(name=geom.meshname, file=str(files[geom.meshname].resolve()))
            added.add(geom.meshname)
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=geom.meshname,
            pos=geom.pos,
            quat=geom.quat,
            rgba=colours.get(geom.material, geom.rgba),
            group=_VISUAL_GROUP,
            contype=0,
            conaffinity=0,
            mass=0.0,
        )
