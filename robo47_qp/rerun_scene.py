"""Static geometry of a MuJoCo model, and where its bodies are, for Rerun."""

from collections import defaultdict
from collections.abc import Iterator
from typing import TypeAlias

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.recording import Rows
from robo47_qp.robot import Robot
from robo47_qp.scene import free_bodies

Shape: TypeAlias = rr.Boxes3D | rr.Capsules3D | rr.Cylinders3D | rr.Ellipsoids3D | rr.Mesh3D
Indices: TypeAlias = NDArray[np.int32]

_TYPE = mujoco.mjtGeom
_VISIBLE_GROUPS = (0, 1, 2)
"""Groups that MuJoCo's own viewer shows at first; robots keep collision geoms in others."""
_NO_COLOUR = (0.5, 0.5, 0.5, 1.0)
"""A geom of this colour takes that of its material, as in MuJoCo's renderer."""
_INFINITE, _THICKNESS = 2.0, 0.01
"""Half size at which an infinite plane is drawn, and how thick planes are [m]."""


class BodyPoses:
    """Poses of the bodies that move, from what a recording holds of the robot and objects."""

    def __init__(self, model: mujoco.MjModel, robot: Robot) -> None:
        """Look up addresses.

        Raises:
            KeyError: The model lacks a joint of the robot or of its gripper.
        """
        self._model, self._data = model, mujoco.MjData(model)
        self._objects = free_bodies(model)
        self._sources = (
            ("joints/q", [model.joint(name).qposadr[0] for name in robot.joints]),
            ("gripper/fingers", [model.joint(name).qposadr[0] for name in robot.gripper.joints]),
            *(
                (f"objects/{name}", model.joint(model.body(name).jntadr[0]).qposadr[0] + _SEVEN)
                for name in self._objects
            ),
        )
        moving = np.flatnonzero(model.body_weldid != 0)
        self.bodies = tuple(int(body) for body in moving)
        """Ids of the bodies that are not fixed to the world."""

    def at(self, rows: Rows, picked: NDArray[np.intp]) -> tuple[Matrix, Matrix]:
        """Positions (bodies, rows, 3) [m] and quaternions xyzw (bodies, rows, 4)."""
        d, bodies = self._data, list(self.bodies)
        qpos = np.tile(self._model.qpos0, (len(picked), 1))
        for signal, address in self._sources:
            qpos[:, address] = rows[signal][picked]
        positions = np.empty((len(bodies), len(picked), 3))
        quaternions = np.empty((len(bodies), len(picked), 4))
        for k, q in enumerate(qpos):
            d.qpos[:] = q
            mujoco.mj_kinematics(self._model, d)
            positions[:, k] = d.xpos[bodies]
            quaternions[:, k] = xyzw(d.xquat[bodies])
        return positions, quaternions


def xyzw(wxyz: Matrix) -> Matrix:
    """Quaternions in Rerun's order."""
    return np.roll(wxyz, -1, axis=-1)


def body_name(model: mujoco.MjModel, body: int) -> str:
    """Name of a body, made up where it has none."""
    return model.body(body).name or f"body{body}"


def fixed_bodies(model: mujoco.MjModel) -> Iterator[tuple[int, Vector, Vector]]:
    """Bodies fixed to the world: id, position [m] and quaternion xyzw."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for body in np.flatnonzero(model.body_weldid == 0):
        yield int(body), data.xpos[body].copy(), xyzw(data.xquat[body])


def undrawn(model: mujoco.MjModel) -> list[str]:
    """Names of the visible geoms that have no picture in Rerun: height fields and SDFs."""
    return [
        model.geom(geom).name or f"geom{geom}"
        for geom in np.flatnonzero(_visible(model))
        if model.geom_type[geom] not in (*_DRAW, _TYPE.mjGEOM_MESH)
    ]


def body_shapes(model: mujoco.MjModel, body: int) -> Iterator[tuple[str, Shape]]:
    """The visible geoms of a body in its frame, one archetype per kind of geom."""
    kinds: dict[int, list[int]] = defaultdict(list)
    for geom in np.flatnonzero(_visible(model) & (model.geom_bodyid == body)):
        kinds[int(model.geom_type[geom])].append(int(geom))
    spheres = kinds.pop(_TYPE.mjGEOM_SPHERE, [])
    if spheres:
        kinds[int(_TYPE.mjGEOM_ELLIPSOID)] += spheres
    for kind, geoms in kinds.items():
        if kind == _TYPE.mjGEOM_MESH:
            yield "meshes", _mesh(model, geoms)
        elif kind in _DRAW:
            name, draw = _DRAW[kind]
            yield name, draw(model, np.array(geoms, dtype=np.int32))


def _visible(model: mujoco.MjModel) -> NDArray[np.bool_]:
    opaque = np.array([_colour(model, geom)[3] > 0.0 for geom in range(model.ngeom)], dtype=bool)
    return np.isin(model.geom_group, _VISIBLE_GROUPS) & opaque


def _colour(model: mujoco.MjModel, geom: int) -> Vector:
    rgba, material = model.geom_rgba[geom], int(model.geom_matid[geom])
    plain = np.allclose(rgba, _NO_COLOUR)
    return np.array(model.mat_rgba[material] if plain and material >= 0 else rgba, dtype=np.float64)


def _colours(model: mujoco.MjModel, geoms: Indices) -> Matrix:
    return np.array([_colour(model, int(geom)) for geom in geoms])
