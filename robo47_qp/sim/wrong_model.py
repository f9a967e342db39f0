"""Errors of inertias and friction, put into a spec before it is compiled.

A compiled model keeps more than is written in its fields, such as which inertial frames are
those of their bodies, so that changing them later gives another body than was asked for.
"""

from collections.abc import Sequence
from itertools import product
from typing import cast

import mujoco
import numpy as np
from mink import SO3
from numpy.typing import ArrayLike

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import InvalidValueError

_WRIST = 5
"""The wrist begins with the fifth joint of a chain that turns."""
_INSIDE = 0.7
"""Largest share of the way from the middle of an object to its sides at which its centre of mass
is: further out, it falls over before anything has touched it."""


def numbers(name: str, given: ArrayLike, count: int, width: int = 1) -> Matrix:
    """Return one row of numbers for each of several things (count, width).

    Args:
        name: What messages call the numbers.
        given: One row for all of them, or a row for each; further rows are left out.
        count: How many there are.
        width: Numbers in a row.

    Raises:
        InvalidValueError: These are no rows of this width, or there is more than one, but fewer
            than things.
    """
    rows = np.asarray(given, dtype=np.float64)
    if rows.ndim > 1 if width == 1 else rows.ndim > 2 or rows.shape[-1:] != (width,):
        one = "a number" if width == 1 else f"{width} numbers"
        raise InvalidValueError(name, f"shape {rows.shape}", f"{one}, or {one} for each of {count}")
    rows = rows.reshape(-1, width)
    if len(rows) == 1:
        rows = np.repeat(rows, count, axis=0)
    if len(rows) < count:
        raise InvalidValueError(name, f"{len(rows)} of them", f"one for all, or {count} or more")
    return rows[:count]


def change_inertias(
    spec: mujoco.MjSpec, model: mujoco.MjModel, bodies: Sequence[int], change: Matrix
) -> None:
    """Change mass, moments and centre of mass of bodies.

    Args:
        spec: Changed in place.
        model: The same, compiled.
        bodies: Ids of the bodies.
        change: A row for each (k, 5): factor of the mass and the moments about the centre of
            mass [-], further factor of the moments [-], and shift of the centre of mass along
            the axes of the body [m].
    """
    rows = dict(zip(bodies, change, strict=True))
    for body in spec.bodies:
        row = rows.get(body.id)
        if row is None or not model.body_mass[body.id] or row.tolist() == [1, 1, 0, 0, 0]:
            continue
        body.explicitinertial = True
        body.fullinertia = np.full(6, np.nan)
        body.mass = row[0] * model.body_mass[body.id]
        body.inertia = row[0] * row[1] * model.body_inertia[body.id]
        body.ipos = model.body_ipos[body.id] + row[2:]
        body.iquat = model.body_iquat[body.id].copy()


def change_joints(
    spec: mujoco.MjSpec, model: mujoco.MjModel, joints: Sequence[str], change: Matrix, wrist: float
) -> None:
    """Change friction and armature of joints.

    Args:
        spec: Changed in place.
        model: The same, compiled.
        joints: Names of the joints of one robot.
        change: A row for each (n, 3): dry friction beyond that of the model [N·m], which joints
            that slide do not get, factor of the viscous friction [-], factor of the armature [-].
        wrist: Share of the dry friction that joints from the fifth of a chain that turns on
            have [-].
    """
    ours = {name: model.joint(name) for name in joints}
    turning = [
        int(joint.dofadr[0])
        for joint in ours.values()
        if joint.type[0] == mujoco.mjtJoint.mjJNT_HINGE
    ]
    for name, (dry, damping, armature) in zip(joints, change.tolist(), strict=True):
        joint = cast(mujoco.MjsJoint, spec.joint(name))
        place, dof = 0, int(ours[name].dofadr[0])
        if dof in turning:
            while dof >= 0:
                place += dof in turning
                dof = int(model.dof_parentid[dof])
            joint.frictionloss += dry * (wrist if place >= _WRIST else 1.0)
        joint.damping = damping * np.asarray(joint.damping)
        joint.armature *= armature


def change_object(spec: mujoco.MjSpec, model: mujoco.MjModel, name: str, row: Vector) -> None:
    """Change size, mass and centre of mass of a free body.

    Args:
        spec: Changed in place.
        model: The same, compiled.
        name: Name of the body.
        row: Factors of its lengths and of its mass [-], and shift of its centre of mass along
            its axes [m] (5,), which takes it no further than 0.7 of the way to its sides.

    Raises:
        InvalidValueError: A body that consists of meshes cannot have another size.
    """
    size, mass = row[:2]
    body = model.body(name)
    geoms = range(int(body.geomadr[0]), int(body.geomadr[0] + body.geomnum[0]))
    if size != 1.0:
        for geom in spec.geoms:
            if geom.id in geoms:
                _resize(geom, model, float(size))
        below = lowest(model, name, SO3(np.asarray(body.quat)).as_matrix())
        body_spec = cast(mujoco.MjsBody, spec.body(name))
        x, y, z = body_spec.pos
        body_spec.pos = [x, y, z + (1.0 - size) * below]
    corners = size * _corners(model, name)
    middle = 0.5 * (corners.max(axis=0) + corners.min(axis=0))
    inside = _INSIDE * (corners.max(axis=0) - middle)
    rim = float(inside[:2].min())
    nominal = size * model.body_ipos[body.id]
    most = np.maximum(inside, np.abs(nominal - middle))  # what its data sheet tells is kept
    away = np.clip(nominal + row[2:] - middle, -most, most)
    if any(model.geom_type[i] == mujoco.mjtGeom.mjGEOM_CYLINDER for i in geoms):
        # Cut along each axis, it could still be over the rim.
        rim = max(rim, float(np.hypot(*(nominal - middle)[:2])))
        away[:2] *= min(1.0, rim / max(float(np.hypot(*away[:2])), 1e-12))
    shift = middle + away - model.body_ipos[body.id]
    change_inertias(spec, model, [body.id], np.array([[mass, size**2, *shift]]))


def lowest(model: mujoco.MjModel, name: str, R_world_body: Matrix) -> float:
    """Return the height of the lowest point of a body above its origin [m]; negative, mostly."""
    return float((_corners(model, name) @ R_world_body[2]).min())


def _corners(model: mujoco.MjModel, name: str) -> Matrix:
    """Return the corners of the boxes around the geoms of a body, in its frame (k, 3) [m]."""
    body, signs = model.body(name), np.array(list(product((-1.0, 1.0), repeat=3)))
    points = []
    for i in range(int(body.geomadr[0]), int(body.geomadr[0] + body.geomnum[0])):
        R, box = SO3(model.geom_quat[i]).as_matrix(), model.geom_aabb[i]
        points.append(model.geom_pos[i] + (box[:3] + signs * box[3:]) @ R.T)
    return np.vstack(points)


def _resize(geom: mujoco.MjsGeom, model: mujoco.MjModel, size: float) -> None:
    if geom.type == mujoco.mjtGeom.mjGEOM_MESH:
        raise InvalidValueError(f"size of {geom.name!r}", size, "1 for a mesh")
    geom.fromto = np.full(6, np.nan)
    geom.size = size * model.geom_size[geom.id]
    geom.pos = size * model.geom_pos[geom.id]
    geom.quat = model.geom_quat[geom.id].copy()
