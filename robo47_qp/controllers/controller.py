"""What every controller is."""

from typing import Protocol

from robo47_qp.arm import Arm, JointReference, JointState
from robo47_qp.arrays import Vector


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
