"""Friction use: how much of the friction that the fingers' contacts can bear is in use."""

from collections.abc import Callable
from math import sqrt

import mujoco
import numpy as np

from robo47_qp.arrays import Vector
from robo47_qp.model.gripper import Gripper
from robo47_qp.sim.contact import contact_sensor
from robo47_qp.sim.signal import Signal


class FrictionUse:
    """Measures the friction in use at the fingers of grippers; part of `Simulation`.

    It looks when it is told to, at the forces that MuJoCo would solve for now.

    A contact with the normal force f_n, the tangential forces f_t and the torsional moment f_r
    uses sqrt((f_t / µ)² + (f_r / µ_r)²) / f_n of its friction: 1 is where it slides, the surface of
    MuJoCo's elliptic cone (Computation, "Friction cones"). Of a finger with several contacts, the
    worst is told, and the share of all: that of the sum of what each can bear, which is 1 where
    all of them slide. One less the share is the slip margin.
    """

    def __init__(
        self, gripper: Gripper, model: mujoco.MjModel, data: mujoco.MjData, label: str = ""
    ) -> None:
        """Look the geoms of the fingers up; names of signals begin with the label."""
        bodies = [model.body(finger).id for finger in gripper.fingers]
        self._finger = [bodies.index(b) if b in bodies else -1 for b in model.geom_bodyid.tolist()]
        self._forces = [data.sensor(contact_sensor(finger)).data for finger in gripper.fingers]
        self._use = np.zeros(2 * len(bodies))
        """Worst contact and share of all, for one finger after the other."""
        labels = [f"{finger} {what}" for finger in gripper.fingers for what in ("worst", "all")]
        signal = Signal(name=f"gripper/{label}friction_use", labels=tuple(labels), unit="-")
        self.signals_last: dict[Signal, tuple[Vector, ...]] = {signal: (self._use,)}

    def update(self, solved: Callable[[], mujoco.MjData]) -> None:
        """Look at the contacts.

        Args:
            solved: Returns a state whose contact forces are those of now; called where the
                fingers touch something.
        """
        if not any(force.any() for force in self._forces):
            self._use[:] = 0.0
            return
        data = solved()
        finger = self._finger
        contact, forces = data.contact, data.efc_force
        worst, used, able = [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]
        rows = zip(
            contact.geom.tolist(),
            contact.efc_address.tolist(),
            contact.dim.tolist(),
            contact.friction.tolist(),
            strict=True,
        )
        for (one, other), row, size, friction in rows:
            k = finger[one]
            if (k < 0) == (finger[other] < 0) or row < 0 or size < 3:
                continue
            k = max(k, finger[other])
            normal, *along = forces[row : row + size].tolist()
            if normal <= 0.0:
                continue
            parts = zip(along, friction, strict=False)
            share = sqrt(sum((force / most) ** 2 for force, most in parts)) / normal
            worst[k] = max(worst[k], share)
            used[k] += share * friction[0] * normal
            able[k] += friction[0] * normal
        for k in (0, 1):
            self._use[2 * k] = worst[k]
            self._use[2 * k + 1] = used[k] / able[k] if able[k] else 0.0
