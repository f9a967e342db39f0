"""SimulatedMotors: the torques that the motors of an arm deliver."""

from math import isfinite

import numpy as np

from robo47_qp.arrays import Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.robot import Robot


class SimulatedMotors:
    """Keeps the torques of a MuJoCo model within the motors' limits. Part of `Simulation`."""

    def __init__(self, robot: Robot, ctrl: Vector) -> None:
        """Keep a view of the motors' torques (n,) in MjData."""
        self._ctrl, self._limit = ctrl, robot.tau_max
        self._step = robot.tau_rate_max * TIMESTEP
        self._low, self._high = np.empty_like(ctrl), np.empty_like(ctrl)

    def start(self, tau: Vector) -> None:
        """Deliver torques at once, within tau_max."""
        np.clip(tau, -self._limit, self._limit, out=self._ctrl)

    def check(self, tau: Vector) -> None:
        """Check that a command is one finite torque for each motor (n,), and none for all.

        Raises:
            InvalidValueError: It is not.
        """
        if tau.shape != self._ctrl.shape:
            expected = f"{self._ctrl.size} numbers [N·m]"
            raise InvalidValueError("commanded torque", f"shape {tau.shape}", expected)
        if not isfinite(tau.dot(tau)):
            raise InvalidValueError("commanded torque", tau.tolist(), "finite [N·m]")

    def deliver(self, tau: Vector) -> None:
        """Deliver the torque closest to a command within tau_max and tau_rate_max.

        Raises:
            InvalidValueError: The command is not finite, or not one for each motor.
        """
        self.check(tau)
        ctrl, low, high, limit = self._ctrl, self._low, self._high, self._limit
        np.subtract(ctrl, self._step, out=low)
        np.add(ctrl, self._step, out=high)
        np.maximum(tau, low, out=ctrl)
        np.minimum(ctrl, high, out=ctrl)
        np.minimum(ctrl, limit, out=ctrl)
        np.maximum(ctrl, -limit, out=ctrl)
