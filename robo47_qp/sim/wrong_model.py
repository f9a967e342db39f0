"""Errors of inertias and friction, put into a spec before it is compiled.

A compiled model keeps more than is written in its fields, such as which inertial frames are
those of their bodies, so that changing them later gives another body than was asked for.
"""

from collections.abc import Sequence
from typing import cast

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from robo47_qp.arrays import Matrix
from robo47_qp.errors import InvalidValueError

_WRIST = 5
"""The wrist begins with the fifth joint of a chain."""


def numbers(name: str, given: ArrayLike, count: int, width: int = 1) -> Matrix:
    """Return one row of numbers for each of several things (count, width).

    Args:
        name: What messages call the numbers.
        given: One row for all of them, or a row for each; further rows are left out.
        count: How many there are.
        width: Numbers in a row.

    Raises:
        InvalidValueError: There is more than one row, but fewer than things.
    """
    rows = np.reshape(np.asarray(given, dtype=np.float64), (-1, width))
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
        change: A row for each (n, 3): dry friction beyond that of the model [N·m], factor of the
            viscous friction [-], factor of the armature [-].
        wrist: Share of the dry friction that joints from the fifth of a chain on have [-].
    """
    dofs = {name: int(model.joint(name).dofadr[0]) for name in joints}
    for name, (dry, damping, armature) in zip(joints, change.tolist(), strict=True):
        joint = cast(mujoco.MjsJoint, spec.joint(name))
        place, dof = 1, int(model.dof_parentid[dofs[name]])
        while dof >= 0:
            place += dof in dofs.values()
            dof = int(model.dof_parentid[dof])
        joint.frictionloss += dry * (wrist if place >= _WRIST else 1.0)
        joint.damping = damping * np.asarray(joint.damping)
        joint.armature *= armature
