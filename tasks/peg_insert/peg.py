"""Peg and hole: a cylinder, and a block that it fits into."""

from dataclasses import dataclass

import mujoco
import numpy as np
from mink import SE3, SO3

from robo47_qp.motion.waypoint import tool_down
from robo47_qp.tasks.item import Item
from robo47_qp.tasks.table import TABLE_TOP

DIAMETER, LENGTH = 0.02, 0.06
"""Of the peg, a cylinder without chamfer [m]."""
CLEARANCE = 0.5e-3
"""Diameter of the hole less that of the peg; the hole has no chamfer either [m]."""
DEPTH = 0.03
"""Of the hole [m]."""
POSITION_ERROR, ANGLE_ERROR = 2e-3, np.radians(2.0)
"""How far the pose of the hole that the robot knows is off, at most: along each axis [m], about
each axis [rad]."""
TOP = TABLE_TOP + DEPTH + 0.01
"""Height of the block's top [m]."""
BELOW_TOP = 0.012
"""How deep below the peg's top the tool point grasps it: the rest is longer than the hole [m]."""
_FACETS, _OUTER = 16, 0.04
"""Boxes around the hole, which touch its circle from outside, and their outer radius [m]."""
_SOLREF, _SOLIMP = [3.3e-3, 1.0], [0.9, 0.9, 1e-4, 0.5, 2.0]
"""Of contacts of peg and block: 20 N press them into each other by less than 0.05 mm."""
_FRICTION = [0.3, 0.005, 1e-4]


@dataclass(frozen=True, kw_only=True)
class Peg(Item):
    """A cylinder that is grasped close to its top."""

    def add(self, spec: mujoco.MjSpec, position: tuple[float, float, float]) -> None:
        """See `Item.add`."""
        super().add(spec, position)
        for geom in (one for one in spec.geoms if one.name == self.name):
            geom.friction, geom.solref, geom.solimp = _FRICTION, _SOLREF, _SOLIMP

    def grasp(self, T_world_item: SE3, width_max: float) -> SE3:
        """See `Item.grasp`."""
        x, y, z = T_world_item.translation()
        return tool_down([x, y, z + 0.5 * self.height - BELOW_TOP])


def set_exact_contacts(spec: mujoco.MjSpec) -> None:
    """Let MuJoCo find contacts of convex bodies more closely than by default.

    With its default tolerance a peg that lies flat on the block meets, in one of 600 poses near
    the hole's edge, a wall sideways and up to 0.5 mm deep, which is felt as a blow of 60 N.
    """
    spec.option.ccd_tolerance, spec.option.ccd_iterations = 1e-8, 100


def add_block(body: mujoco.MjsBody) -> None:
    """A block with a hole, the origin in the middle of the hole's upper end."""
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
            rgba=[0.45, 0.50, 0.56, 1.0],
            friction=_FRICTION,
            solref=_SOLREF,
            solimp=_SOLIMP,
        )
    body.add_geom(
        name="bottom",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        pos=[0.0, 0.0, -DEPTH - 0.005],
        size=[_OUTER, 0.005, 0.0],
        rgba=[0.45, 0.50, 0.56, 1.0],
        friction=_FRICTION,
        solref=_SOLREF,
        solimp=_SOLIMP,
    )
