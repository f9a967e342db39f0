"""HeldItem: what is known of an item in the hand, also where fingers hide it from the camera."""

from dataclasses import dataclass

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
