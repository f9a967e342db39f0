"""Peg and hole: a cylinder, and a block with a hole for it."""

from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from mink import SE3, SO3

from robo47_qp.motion.waypoint import tool_down
from robo47_qp.tasks.item import SPINNING, Item
from robo47_qp.tasks.table import TABLE_TOP

DIAMETER, LENGTH = 0.02, 0.06
"""Diameter of the peg, which has no chamfer [m]."""
CLEARANCE = 0.5e-3
"""Diameter of the hole minus that of the peg; the hole has no chamfer either [m]."""
DEPTH = 0.03
"""Depth of the hole [m]."""
POSITION_ERROR, ANGLE_ERROR = 2e-3, np.radians(2.0)
"""Largest error of the hole's known pose: along each axis [m], about each axis [rad]."""
TOP = TABLE_TOP + DEPTH + 0.01
"""Height of the block's top [m]."""
BELOW_TOP = 0.012
"""Depth of the tool point below the peg's top; the rest is longer than the hole [m]."""
_FACETS, _OUTER = 16, 0.04
"""Number of boxes around the hole, which touch its circle from outside, and their outer radius
[m]."""
_STUDS, _STUD, _RECESS = 4, 2e-3, 2e-4
"""Number of studs that a peg stands on in the hole, their radius, and how far the bottom between
them is below their tops [m]."""
_SOLREF, _SOLIMP = [3.3e-3, 1.0], [0.9, 0.9, 1e-4, 0.5, 2.0]
"""Contact parameters of peg and block: 20 N cause a penetration below 0.05 mm."""
_FRICTION = [0.3, *SPINNING]


@dataclass(frozen=True, kw_only=True)
class Peg(Item):
    """A cylinder that is grasped near its top."""

    on_feet: ClassVar[bool] = False

    def add(self, spec: mujoco.MjSpec, position: tuple[float, float, float]) -> None:
        """See `Item.add`."""
        super().add(spec, position)
        for geom in (one for one in spec.geoms if one.name == self.name):
            _make_steel(geom)

    def grasp(self, T_world_item: SE3, width_max: float) -> SE3:
        """See `Item.grasp`."""
        x, y, z = T_world_item.translation()
        return tool_down([x, y, z + 0.5 * self.height - BELOW_TOP])


def set_exact_contacts(spec: mujoco.MjSpec) -> None:
    """Let MuJoCo compute contacts of convex bodies to a tight tolerance, however long that takes.

    With the default tolerance, a peg that lies flat on the block touches a wall sideways and up to
    0.5 mm deep in one of 600 poses near the hole's edge, which is measured as an impact of 60 N;
    with 1e-8, one that grazed a wall was 16 mm deep in it, and was shot out of the fingers.
    """
    spec.option.ccd_tolerance, spec.option.ccd_iterations = 1e-10, 100


def add_block(body: mujoco.MjsBody) -> None:
    """Add the geoms of a block with a hole, the origin at the centre of the hole's upper end.

    A peg stands on the tops of studs: contacts of spheres are exact, and on the flat bottom itself
    it would rattle for ever, at up to 1.7 mm/s and 0.06 rad/s.
    """
    inner = 0.5 * (DIAMETER + CLEARANCE)
    box, turn = mujoco.mjtGeom.mjGEOM_BOX, 2.0 * np.pi / _FACETS
    middle, half = 0.5 * (inner + _OUTER), 0.5 * (_OUTER - inner)
    for i in range(_FACETS):
        body.add_geom(
            name=f"wall{i}",
            type=box,
            pos=[middle * np.cos(i * turn), middle * np.sin(i * turn), -0.5 * DEPTH],
            quat=SO3.from_z_radians(i * turn).wxyz,
            size=[half, _OUTER * np.tan(0.5 * turn), 0.5 * DEPTH],
        )
    thick = 0.5 * (TOP - TABLE_TOP - DEPTH - _RECESS)
    body.add_geom(
        name="bottom",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        pos=[0.0, 0.0, -DEPTH - _RECESS - thick],
        size=[_OUTER, thick, 0.0],
    )
    out = 0.5 * DIAMETER - _STUD
    for i, angle in enumerate(np.linspace(0.0, 2.0 * np.pi, _STUDS, endpoint=False)):
        body.add_geom(
            name=f"stud{i}",
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            pos=[out * np.cos(angle), out * np.sin(angle), -DEPTH - _STUD],
            size=[_STUD, 0.0, 0.0],
        )
    for geom in body.geoms:
        geom.rgba = [0.45, 0.50, 0.56, 1.0]
        _make_steel(geom)


def _make_steel(geom: mujoco.MjsGeom) -> None:
    geom.friction, geom.solref, geom.solimp = _FRICTION, _SOLREF, _SOLIMP
