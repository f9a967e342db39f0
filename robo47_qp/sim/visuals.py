"""Visual meshes of MuJoCo Menagerie in place of a robot's primitive shapes."""

from pathlib import Path

import mujoco

from robo47_qp.errors import UnknownNameError
from robo47_qp.model.menagerie import menagerie_file
from robo47_qp.model.mjcf import read_spec
from robo47_qp.model.robot import Robot
from robo47_qp.sim.scene import BuildScene

_VISUAL_GROUP = 2


def with_menagerie_looks(robot: Robot, build_scene: BuildScene) -> BuildScene:
    """Return a scene in which meshes replace the robot's visual geoms; its dynamics stay.

    Raises:
        UnknownNameError: The robot has no model in Menagerie.
        MissingExtraError, ModelError: See `menagerie_file`.
    """
    if robot.menagerie is None:
        raise UnknownNameError("Menagerie model", robot.name, ())
    file = menagerie_file(robot.menagerie)
    if robot.mjcf == file:
        return build_scene
    looks = read_spec(file)

    def build(spec: mujoco.MjSpec) -> None:
        _replace_visuals(spec, looks, file.parent / looks.meshdir)
        build_scene(spec)

    return build


def _replace_visuals(spec: mujoco.MjSpec, looks: mujoco.MjSpec, directory: Path) -> None:
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
