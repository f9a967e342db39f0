"""Sponge: a rigid back for the fingers, with foam below it."""

from dataclasses import dataclass

import mujoco

from robo47_qp.tasks.item import SPINNING, Item

FOAM = "foam"
"""Name of its geom."""
_SOFT = [-700.0, -12.0]
"""Stiffness and damping of the foam as MuJoCo's solref, which refers to the sponge's mass: for its
40 g and four corners, 10 N compress the foam by 9 mm. When it slides with a speed v, MuJoCo's
convex friction lifts it by μ v times their ratio: 0.3 mm [1/s², 1/s]."""


@dataclass(frozen=True, kw_only=True)
class Sponge(Item):
    """A sponge with a rigid back that the fingers hold, and foam below it."""

    foam_height: float = 0.025
    """Height of the foam [m]."""
    foam_friction: float = 0.3
    """Coefficient of friction on any surface [-]."""

    @property
    def foam(self) -> tuple[float, float]:
        """Lengths of the foam along x and y; the fingers do not touch it [m]."""
        return self.size[0], self.size[1] - 0.004

    def add(self, spec: mujoco.MjSpec, position: tuple[float, float, float]) -> None:
        """See `Item.add`."""
        x, y, z = self.size
        deep, soft = self.foam_height, 0.25 * self.mass
        body = spec.worldbody.add_body(name=self.name, pos=position)
        body.add_freejoint()
        box = mujoco.mjtGeom.mjGEOM_BOX
        body.add_geom(
            name=self.name,
            type=box,
            pos=[0.0, 0.0, 0.5 * deep],
            size=[0.5 * x, 0.5 * y, 0.5 * (z - deep)],
            mass=self.mass - soft,
            rgba=self.rgba,
            friction=[sum(self.friction) / 2.0, *SPINNING],
        )
        body.add_geom(
            name=FOAM,
            type=box,
            pos=[0.0, 0.0, 0.5 * (deep - z)],
            size=[0.5 * self.foam[0], 0.5 * self.foam[1], 0.5 * deep],
            mass=soft,
            rgba=[0.95, 0.80, 0.25, 1.0],
            friction=[self.foam_friction, *SPINNING],
            # Its own softness and friction hold, whatever it touches.
            priority=1,
            solref=_SOFT,
            solimp=[0.9, 0.9, 1e-3, 0.5, 2.0],
        )
