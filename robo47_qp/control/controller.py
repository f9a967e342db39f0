"""Controller: what computes torques, and the dry friction that each feeds forward."""

from typing import Protocol

import numpy as np

from robo47_qp.arrays import Vector
from robo47_qp.model.arm import Arm, JointReference, JointState


class Controller(Protocol):
    """Computes torques. The controller is its settings; what it believes is the arm."""

    def torque(self, arm: Arm, reference: JointReference, state: JointState) -> Vector:
        """Torque to apply over the control period that starts now.

        Args:
            arm: The belief, with what the tool holds.
            reference: What the joints should do at the instant of `state`: not one period
                later, which would show as an error of one period times the velocity.
            state: What the joints do now.

        Returns:
            tau (n,) [N·m]; the motors' limits are theirs to apply.
        """
        ...


_SPEED = 0.05
"""Speed at which three quarters of the final value are reached [rad/s or m/s]."""
_SHARE = 0.8
"""Part of the friction that is fed forward: more than there is would drive limit cycles [-]."""


def add_dry_friction(tau: Vector, arm: Arm, v_ref: Vector) -> None:
    """Add the torque that dry friction takes at a reference velocity: 0.8 f tanh(v_ref / v_0).

    The reference's velocity, not the measured one: that would push the arm on wherever its
    noise points, and take the joints' own resistance from a controller at rest (Olsson, Åström,
    Canudas de Wit, Gäfvert and Lischinsky, European J. Control 4(3), 1998).

    Args:
        tau: (n,) [N·m], changed in place.
        arm: Whose joints.
        v_ref: (n,) [rad/s].
    """
    tau += dry_friction_torque(arm, v_ref)


def dry_friction_torque(arm: Arm, v_ref: Vector) -> Vector:
    """Return the torque that `add_dry_friction` adds (n,) [N·m]."""
    torque: Vector = _SHARE * arm.dry_friction * np.tanh(v_ref / _SPEED)
    return torque
