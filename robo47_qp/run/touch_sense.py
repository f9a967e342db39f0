"""TouchSense: whether a tool touches something, by sensors at the wrists that drift."""

from math import exp, inf

import numpy as np

from robo47_qp.arrays import Matrix
from robo47_qp.model.arm import Arm
from robo47_qp.sim.simulation import Simulation

CONTACT_FORCE = 4.0
"""Force on the tool above which it is in contact, beside half of its payload's weight [N]."""

_ZEROING = 3.0
"""Time constant with which the reading of a wrist that is not in contact becomes its zero [s]."""

_TOLD = 0.05
"""The same where a program tells that nothing is touched [s]."""
_BEGINS = 1.0
"""Time in which something may have pushed from the start, and lets go [s]."""


class TouchSense:
    """Tells contact from the drift of the sensors in one run.

    What a sensor reads first, and then follows slowly while nothing is touched, is its zero. A
    force that grows by less than `CONTACT_FORCE` within the time constant is taken for drift. One
    that falls by more, soon after the start, had been a push.
    """

    def __init__(self, simulation: Simulation) -> None:
        """Start without zeros.

        Args:
            simulation: The world whose sensors are read.
        """
        self._sim = simulation
        self._zeros: Matrix | None = None
        self._passed = 0.0

    def touching(
        self, arm: Arm, passed: float, *, free: bool = True, untouched: bool = False
    ) -> bool:
        """Return whether a tool is in contact with more than its payload.

        Args:
            arm: The arm with what its tools hold.
            passed: Time since the last call [s].
            free: Whether nothing is meant to be touched: what presses gently for long is no drift.
            untouched: Whether it is known that nothing is touched.
        """
        tools = arm.robot.tools
        forces, most = np.zeros((len(tools), 3)), np.full(len(tools), CONTACT_FORCE)
        for i, tool in enumerate(tools):
            payload = arm.payloads.get(tool.name)
            forces[i] = self._sim.felt_force(i)
            if payload is not None:
                weight = payload.mass * arm.model.opt.gravity
                forces[i] -= weight
                most[i] += 0.5 * float(np.sqrt(weight.dot(weight)))
        if self._zeros is None:
            self._zeros = forces
        # A zero that is told is one.
        self._passed += inf if untouched else passed
        off = forces - self._zeros
        pressed = np.square(off).sum(axis=1) > most**2
        if self._passed < _BEGINS and pressed.any():
            eased = np.square(forces).sum(axis=1) < np.square(self._zeros).sum(axis=1)
            eased &= pressed
            pressed &= ~eased
            self._zeros[eased], off[eased] = forces[eased], 0.0
        touches = bool(pressed.any())
        if untouched or (free and not touches):
            self._zeros += (1.0 - exp(-passed / (_TOLD if untouched else _ZEROING))) * off
        return touches
