"""The visible geoms of a MuJoCo model as Rerun archetypes."""

from collections import defaultdict
from collections.abc import Callable, Iterator
from typing import Any, TypeAlias

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.report.rerun.columns import xyzw

Shape: TypeAlias = rr.Boxes3D | rr.Capsules3D | rr.Cylinders3D | rr.Ellipsoids3D | rr.Mesh3D

_Ids: TypeAlias = NDArray[np.intp]
_Kind = mujoco.mjtGeom
_VISIBLE_GROUPS = (0, 1, 2)
"""Groups that MuJoCo's viewer shows by default; collision geoms are in others."""
_NO_COLOUR = (0.5, 0.5, 0.5, 1.0)
"""A geom of this colour has the colour of its material, as in MuJoCo's renderer."""
_ENDLESS, _THICKNESS = 2.0, 0.01
"""Half size of infinite planes, and thickness of planes, as drawn [m]."""


def body_name(model: mujoco.MjModel, body: int) -> str:
    """Return the name of a body, or one made of its id."""
    return model.body(body).name or f"body{body}"


def body_shapes(model: mujoco.MjModel, body: int) -> Iterator[tuple[str, Shape]]:
    """Yield the visible geoms of a body, in its frame: one named archetype per geom type."""
    geoms: dict[str, list[int]] = defaultdict(list)
    for geom in np.flatnonzero(_visible(model) & (model.geom_bodyid == body)):
        kind = _Kind(int(model.geom_type[geom]))
        if kind in _NAMES:
            geoms[_NAMES[kind]].append(int(geom))
    for name, ids in geoms.items():
        yield name, _DRAW[name](model, np.array(ids))


def undrawn(model: mujoco.MjModel) -> tuple[str, ...]:
    """Return the names of visible geoms whose type is not drawn: height fields and SDFs."""
    return tuple(
        model.geom(geom).name or f"geom{geom}"
        for geom in np.flatnonzero(_visible(model))
        if _Kind(int(model.geom_type[geom])) not in _NAMES
    )


def _visible(model: mujoco.MjModel) -> NDArray[np.bool_]:
    drawn: NDArray[np.bool_] = np.isin(model.geom_group, _VISIBLE_GROUPS)
    return drawn & (_colours(model, np.arange(model.ngeom))[:, 3] > 0.0)


def _colours(model: mujoco.MjModel, geoms: _Ids) -> Matrix:
    """Return colours (N, 4) in 0..1."""
    rgba, material = model.geom_rgba[geoms], model.geom_matid[geoms]
    plain = (material >= 0) & np.isclose(rgba, _NO_COLOUR).all(axis=1)
    colours = rgba.astype(np.float64)
    colours[plain] = model.mat_rgba[material[plain]]
    return colours


def _placed(model: mujoco.MjModel, geoms: _Ids) -> dict[str, Any]:
    """Return the arguments that archetypes of solids share."""
    return {
        "centers": model.geom_pos[geoms],
        "quaternions": xyzw(model.geom_quat[geoms]),
        "colors": _colours(model, geoms),
        "fill_mode": "solid",
    }


def _z_axes(model: mujoco.MjModel, geoms: _Ids) -> Matrix:
    """Return the z axes of geoms in the frames of their bodies (N, 3)."""
    w, x, y, z = model.geom_quat[geoms].T
    return np.column_stack((2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)))


def _boxes(model: mujoco.MjModel, geoms: _Ids) -> Shape:
    return rr.Boxes3D(half_sizes=model.geom_size[geoms], **_placed(model, geoms))


def _planes(model: mujoco.MjModel, geoms: _Ids) -> Shape:
    """Return planes as thin boxes below them."""
    half_sizes = model.geom_size[geoms].astype(np.float64)
    half_sizes[half_sizes == 0.0] = _ENDLESS
    half_sizes[:, 2] = _THICKNESS / 2
    below = model.geom_pos[geoms] - _z_axes(model, geoms) * _THICKNESS / 2
    return rr.Boxes3D(half_sizes=half_sizes, **{**_placed(model, geoms), "centers": below})


def _ellipsoids(model: mujoco.MjModel, geoms: _Ids) -> Shape:
    half_sizes = model.geom_size[geoms].astype(np.float64)
    spheres = model.geom_type[geoms] == _Kind.mjGEOM_SPHERE
    half_sizes[spheres] = half_sizes[spheres, :1]
    return rr.Ellipsoids3D(half_sizes=half_sizes, **_placed(model, geoms))


def _cylinders(model: mujoco.MjModel, geoms: _Ids) -> Shape:
    radii, lengths = model.geom_size[geoms, 0], 2 * model.geom_size[geoms, 1]
    return rr.Cylinders3D(lengths=lengths, radii=radii, **_placed(model, geoms))


def _capsules(model: mujoco.MjModel, geoms: _Ids) -> Shape:
    # Rerun's capsule starts at its origin and runs along z; MuJoCo's is centred.
    half = model.geom_size[geoms, 1:2]
    return rr.Capsules3D(
        lengths=2 * half[:, 0],
        radii=model.geom_size[geoms, 0],
        translations=model.geom_pos[geoms] - _z_axes(model, geoms) * half,
        quaternions=xyzw(model.geom_quat[geoms]),
        colors=_colours(model, geoms),
        fill_mode="solid",
    )


def _meshes(model: mujoco.MjModel, geoms: _Ids) -> Shape:
    """Return all meshes of a body as one, in its frame, with a normal per vertex."""
    points, normals, triangles, colours, count = [], [], [], [], 0
    for geom, colour in zip(geoms, _colours(model, geoms), strict=True):
        vertices, directions, corners = _mesh(model, int(model.geom_dataid[geom]))
        R = np.empty(9)
        mujoco.mju_quat2Mat(R, model.geom_quat[geom])
        points.append(vertices @ R.reshape(3, 3).T + model.geom_pos[geom])
        normals.append(directions @ R.reshape(3, 3).T)
        triangles.append(corners + count)
        colours.append(np.tile(colour, (len(vertices), 1)))
        count += len(vertices)
    return rr.Mesh3D(
        vertex_positions=np.concatenate(points),
        vertex_normals=np.concatenate(normals),
        triangle_indices=np.concatenate(triangles),
        vertex_colors=np.concatenate(colours),
    )


def _mesh(model: mujoco.MjModel, mesh: int) -> tuple[Vector, Vector, NDArray[np.int64]]:
    """Return vertices (V, 3), normals (V, 3) and triangles (T, 3) of a mesh."""
    face = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
    # MuJoCo keeps normals apart from vertices: a vertex on an edge has one per side.
    corners = np.column_stack((model.mesh_face[face].ravel(), model.mesh_facenormal[face].ravel()))
    pairs, index = np.unique(corners, axis=0, return_inverse=True)
    vertices = model.mesh_vert[model.mesh_vertadr[mesh] + pairs[:, 0]]
    normals = model.mesh_normal[model.mesh_normaladr[mesh] + pairs[:, 1]]
    return vertices, normals, index.reshape(-1, 3)


_NAMES = {
    _Kind.mjGEOM_PLANE: "planes",
    _Kind.mjGEOM_SPHERE: "ellipsoids",
    _Kind.mjGEOM_ELLIPSOID: "ellipsoids",
    _Kind.mjGEOM_CAPSULE: "capsules",
    _Kind.mjGEOM_CYLINDER: "cylinders",
    _Kind.mjGEOM_BOX: "boxes",
    _Kind.mjGEOM_MESH: "meshes",
}
_DRAW: dict[str, Callable[[mujoco.MjModel, _Ids], Shape]] = {
    "planes": _planes,
    "ellipsoids": _ellipsoids,
    "cylinders": _cylinders,
    "capsules": _capsules,
    "boxes": _boxes,
    "meshes": _meshes,
}
