"""Gripper: what the fingers of a robot can do, and a command to them."""

from dataclasses import dataclass, replace
from math import inf
from typing import Annotated

from robo47_qp.arrays import Checked, Positive, Range


@dataclass(frozen=True, kw_only=True)
class Gripper(Checked):
    """A parallel gripper with two mirrored sliding fingers."""

    joints: tuple[str, str]
    """Finger joints; the opening width is the sum of their positions."""
    fingers: tuple[str, str]
    """Bodies of the two fingers, in the order of `joints`, that on the tool's y side first."""
    actuator: str
    """Position servo on the opening width [m], with a force limit."""
    width_max: Positive
    """Opening width when fully open [m]."""
    speed_max: Positive
    """Largest speed of the opening width [m/s]."""
    force_max: Positive
    """Largest force of one finger on the object [N]."""
    force_gain: Positive
    """Force limit of the actuator per newton of finger force [-]."""

    def _label(self, field: str) -> str:
        return f"gripper {field}"

    def prefixed(self, prefix: str) -> "Gripper":
        """Return the same gripper with something put before each of its names."""
        (one, other), (left, right) = self.joints, self.fingers
        return replace(
            self,
            joints=(prefix + one, prefix + other),
            fingers=(prefix + left, prefix + right),
            actuator=prefix + self.actuator,
        )


@dataclass(frozen=True, kw_only=True)
class Grip(Checked):
    """Bring the fingers to an opening width, pushing no harder than a force."""

    width: float
    """Opening width to move to [m]; a smaller one than the object's squeezes it."""
    force: float
    """Force of one finger at most [N]."""
    speed: Annotated[float, Range(above=0.0, infinite=True)] = inf
    """Rate of the opening width at most, beside that of the gripper [m/s]."""

    def _label(self, field: str) -> str:
        return f"grip {field}"
