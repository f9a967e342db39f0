"""Joint stops: a soft push away from the limits of the joints."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from robo47_qp.arrays import Checked, NotNegative, Range, Vector
from robo47_qp.model.arm import Arm


@dataclass(frozen=True, kw_only=True)
class JointStops(Checked):
    """A one-sided spring in front of each joint limit.

    tau = r tau_max (x / margin)², x = how far q is past the margin's inner edge towards a limit

    It has the potential r tau_max x³ / (3 margin²), so that it stores and returns energy
    (Khatib, Real-time obstacle avoidance for manipulators and mobile robots, IJRR 5(1), 1986).
    A reference inside the margin is meant: there x counts from the reference, and following it
    costs nothing.
    """

    margin: Annotated[float, Range(above=0.0, below=0.5)] = 0.03
    """Where the push begins, before each limit, as a fraction of the joint's range [-]."""
    strength: NotNegative = 1.0
    """r: torque at the limit as a fraction of tau_max; 0 switches the stops off [-]."""

    def inside(self, arm: Arm) -> tuple[Vector, Vector]:
        """The range (n,), (n,) in which no joint is pushed [rad]."""
        width = self.margin * (arm.q_max - arm.q_min)
        return arm.q_min + width, arm.q_max - width

    def push(self, tau: Vector, arm: Arm, q_ref: Vector, q: Vector) -> None:
        """Add the push to a torque.

        Args:
            tau: (n,) [N·m], changed in place.
            arm: Whose limits.
            q_ref: Where the joints should be (n,) [rad].
            q: Where they are (n,) [rad].
        """
        width = self.margin * (arm.q_max - arm.q_min)
        inner_low, inner_high = self.inside(arm)
        low = np.maximum(np.minimum(inner_low, q_ref), arm.q_min)
        high = np.minimum(np.maximum(inner_high, q_ref), arm.q_max)
        below, above = np.maximum(low - q, 0.0), np.maximum(q - high, 0.0)
        tau += self.strength * arm.robot.tau_max * (below**2 - above**2) / width**2
