"""Pushes: forces on the tool for a limited time."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import mujoco
import numpy as np

from robo47_qp.arrays import Checked, NotNegative, Size, Vector
from robo47_qp.constants import MANY, TIMESTEP


@dataclass(frozen=True, kw_only=True, eq=False)
class Push(Checked):
    """A constant force on the tool point for a limited time."""

    force: Annotated[Vector, Size(3)]
    """The force (3,), in the world [N]."""
    start: NotNegative
    """Time at which it begins [s]."""
    duration: NotNegative = 0.2
    """Time for which it lasts [s]."""

    def begins_in(self, time: float) -> int:
        """Return in how many periods from a time [s] it begins; 0 or less once it has begun."""
        # Rounded, because sums of the timestep are not exact.
        return round((self.start - time) / TIMESTEP)

    def acts(self, time: float) -> bool:
        """Return whether it acts in the period that begins at a time [s]."""
        return -round(self.duration / TIMESTEP) < self.begins_in(time) <= 0


class Pushes:
    """Lets pushes act on the tool point in a simulation; part of `DisturbedSimulation`."""

    def __init__(
        self, pushes: Sequence[Push], model: mujoco.MjModel, data: mujoco.MjData, tcp: str
    ) -> None:
        """Take the pushes, and the site of the tool point on which they act."""
        self._pushes, self._model, self._data = tuple(pushes), model, data
        site = model.site(tcp).id
        self._point, self._body = data.site_xpos[site], int(model.site_bodyid[site])
        self.felt = np.zeros(3)
        """The force that acted in the last period, in the world (3,) [N]."""

    def ahead(self, time: float) -> int:
        """Return for how many periods from a time [s] none acts or is felt, and let none act."""
        if self.felt.any() or any(push.acts(time) for push in self._pushes):
            return 0
        self.act(time)
        begins = [push.begins_in(time) for push in self._pushes]
        return min((periods for periods in begins if periods > 0), default=MANY)

    def act(self, time: float) -> None:
        """Apply what acts in the period that begins at a time [s]."""
        if not self._pushes:
            return
        applied = self._data.qfrc_applied
        applied[:] = 0.0
        self.felt = sum((push.force for push in self._pushes if push.acts(time)), np.zeros(3))
        if self.felt.any():
            mujoco.mj_applyFT(
                *(self._model, self._data, self.felt, np.zeros(3)),
                *(self._point, self._body, applied),
            )
