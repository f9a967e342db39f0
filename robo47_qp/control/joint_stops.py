"""Joint stops: soft springs at the joint limits."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from robo47_qp.arrays import Checked, NotNegative, Range, Vector
from robo47_qp.model.arm import Arm


@dataclass(frozen=True, kw_only=True)
class JointStops(Checked):
    """A one-sided spring before each joint limit.

    tau = r tau_max (x / margin)², with x the distance of q past the margin's inner edge

    It has the potential r tau_max x³ / (3 margin²) (Khatib, Real-time obstacle avoidance for
    manipulators and mobile robots, IJRR 5(1), 1986). Where the reference is inside the margin,
    x counts from the reference, so that following it takes no torque.
    """

    margin: Annotated[float, Range(above=0.0, below=0.5)] = 0.03
    """Width of the spring before each limit, as a fraction of the joint's range [-]."""
    strength: NotNegative = 1.0
    """r: torque at the limit as a fraction of tau_max; 0 switches the stops off [-]."""

    def inside(self, arm: Arm) -> tuple[Vector, Vector]:
        """Return the bounds (n,), (n,) between which no spring acts [rad]."""
        width = self.margin * (arm.q_high - arm.q_low)
        return arm.q_min + width, arm.q_max - width

    def push(self, tau: Vector, arm: Arm, q_ref: Vector, q: Vector) -> None:
        """Add the torque of the springs at q to `tau` (n,) [N·m], in place."""
        width = self.margin * (arm.q_high - arm.q_low)
        inner_low, inner_high = self.inside(arm)
        low = np.maximum(np.minimum(inner_low, q_ref), arm.q_min)
        high = np.minimum(np.maximum(inner_high, q_ref), arm.q_max)
        below, above = np.maximum(low - q, 0.0), np.maximum(q - high, 0.0)
        tau += self.strength * arm.robot.tau_max * (below**2 - above**2) / width**2
