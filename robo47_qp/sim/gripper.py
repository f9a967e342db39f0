"""SimulatedGripper: the gripper of a robot in a MuJoCo model."""

from math import inf, sqrt

import mujoco
import numpy as np

from robo47_qp.arrays import Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.gripper import Grip, Gripper
from robo47_qp.sim.contact import contact_sensor
from robo47_qp.sim.signal import XYZ, Signal

_UNLOADING = 0.06
"""Time in which fingers that let go of what they squeeze take their force away [s]. An arm that
fingers have pushed aside a little springs back with it: at once, it would do so faster than its
joints are rated for."""
_CLEAR = 1e-4
"""How much further they open as slowly [m]: their pads are still pressed in then."""


class SimulatedGripper:
    """Moves the fingers and reads them; part of `Simulation`."""

    def __init__(
        self, gripper: Gripper, model: mujoco.MjModel, data: mujoco.MjData, label: str = ""
    ) -> None:
        """Take views of the gripper's state in `data`; names of signals begin with the label."""
        self.gripper = gripper
        self._model, self._data = model, data
        left, right = (model.joint(name) for name in gripper.joints)
        self._left, self._right = data.qpos[left.qposadr[0] :], data.qpos[right.qposadr[0] :]
        self._left_v, self._right_v = data.qvel[left.dofadr[0] :], data.qvel[right.dofadr[0] :]
        self.servo = int(model.actuator(gripper.actuator).id)
        """Id of the actuator."""
        self._forces = [data.sensor(contact_sensor(finger)).data for finger in gripper.fingers]
        servo = data.ctrl[self.servo : self.servo + 1]
        self.signals_now = {
            Signal(name=f"gripper/{label}fingers", labels=gripper.joints, unit="m", shown=False): (
                self._left[:1],
                self._right[:1],
            ),
            Signal(name=f"gripper/{label}width_command", labels=("width",), unit="m"): (servo,),
        }
        self.signals_last = {
            Signal(name=f"gripper/{finger}_contact", labels=XYZ, unit="N", shown=False): (force,)
            for finger, force in zip(gripper.fingers, self._forces, strict=True)
        }
        self._open = Grip(width=gripper.width_max, force=gripper.force_max)
        self._grip = self._open
        self._unloaded, self._unloading = 0.0, inf

    def reset(self) -> None:
        """Open the fingers fully and hold them there."""
        self._left[0] = self._right[0] = self.gripper.width_max / 2
        self.command(self._open)

    def command(self, grip: Grip) -> None:
        """See `Simulation.command_grip`."""
        gripper = self.gripper
        if not 0.0 <= grip.width <= gripper.width_max:
            expected = f"between 0 and {gripper.width_max} [m]"
            raise InvalidValueError("grip width", grip.width, expected)
        if not 0.0 < grip.force <= gripper.force_max:
            expected = f"above 0 and at most {gripper.force_max} [N]"
            raise InvalidValueError("grip force", grip.force, expected)
        self._grip = grip
        # A squeezed object keeps the fingers off the setpoint. To reverse, the setpoint jumps to
        # where the servo presses as it does now, and takes its time to the fingers; to go on in
        # its direction it stays, so that the force stays.
        width = min(max(self.width(), 0.0), gripper.width_max)
        self._unloaded, self._unloading = 0.0, inf
        if (self.width_command() - width) * (grip.width - width) <= 0.0:
            force = float(self._data.actuator_force[self.servo])
            squeezed = -force / float(self._model.actuator_gainprm[self.servo, 0])
            if grip.width > width and squeezed > 0.0:
                self._unloaded = min(width + _CLEAR, grip.width)
                self._unloading = (squeezed + _CLEAR) * TIMESTEP / _UNLOADING
                width = max(width - squeezed, 0.0)
            self._data.ctrl[self.servo] = width
        limit = grip.force * gripper.force_gain
        self._model.actuator_forcerange[self.servo] = (-limit, limit)

    def show(self, width: float) -> None:
        """Put the fingers and the setpoint of the servo at an opening width [m], at rest."""
        self._left[0] = self._right[0] = 0.5 * width
        self._left_v[0] = self._right_v[0] = 0.0
        self._data.ctrl[self.servo] = width

    def move(self) -> None:
        """Move the setpoint of the servo towards the commanded width, for one period."""
        ctrl, (wanted, step, unloaded, unloading) = self._data.ctrl, self.course
        now = float(ctrl[self.servo])
        if now < unloaded:
            step = unloading
        if now != wanted:
            ctrl[self.servo] = min(max(wanted, now - step), now + step)

    @property
    def course(self) -> tuple[float, float, float, float]:
        """Where the setpoint goes and by how much in a period, and below what by how much [m]."""
        step = min(self._grip.speed, self.gripper.speed_max) * TIMESTEP
        return self._grip.width, step, self._unloaded, min(step, self._unloading)

    def width(self) -> float:
        """See `Simulation.width`."""
        return float(self._left[0] + self._right[0])

    def width_speed(self) -> float:
        """See `Simulation.width_speed`."""
        return float(self._left_v[0] + self._right_v[0])

    def width_command(self) -> float:
        """See `Simulation.width_command`."""
        return float(self._data.ctrl[self.servo])

    def settled(self) -> bool:
        """See `Simulation.grip_settled`."""
        force = float(self._data.actuator_force[self.servo]) / self.gripper.force_gain
        towards = force if self._grip.width > self.width() else -force
        there = self.width_command() == self._grip.width or towards > 0.99 * self._grip.force
        return there and abs(self.width_speed()) < 1e-3

    def forces(self) -> Vector:
        """See `Simulation.last_finger_forces`."""
        return np.array([sqrt(force.dot(force)) for force in self._forces])
