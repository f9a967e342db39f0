"""HeldItem: what is known of an item in the hand, also where fingers hide it from the camera."""

from dataclasses import dataclass

import numpy as np
from mink import SE3

from robo47_qp.sim.sensed import Sensed
from robo47_qp.tasks.handling.pose_estimate import hidden


@dataclass(frozen=True, kw_only=True)
class HeldItem:
    """What is known of an item once it is picked."""

    above: float | None
    """Height of its centre above the tool point [m]; None if it is not known."""
    mass: float
    """Mass [kg]."""
    T_tcp_item: SE3
    """Where it was in the tool when it was grasped, with z up in the world."""
    since: float
    """When that was [s]."""

    def hidden(self, sensed: Sensed, name: str) -> bool:
        """Return whether the camera has not seen it in the hand: it is where the hand has it."""
        return hidden(sensed, name, self.since)


def centred(T_tcp_item: SE3) -> SE3:
    """Return the pose in the tool of an item that the fingers have centred between them."""
    x, _, z = T_tcp_item.translation()
    return SE3.from_rotation_and_translation(T_tcp_item.rotation(), np.array([x, 0.0, z]))
