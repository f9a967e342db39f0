"""Sinking: tells a peg that goes into a hole from one that creeps between the fingers."""

from collections import deque

import numpy as np

from robo47_qp.sim.sensed import Sensed

_CAUGHT = 0.3e-3
"""Descent from which on the hole holds the peg's end [m]."""
_LATELY = 100
"""Readings of the height, every 10 ms, in which it sinks into a hole."""


class Sinking:
    """By how much a tool has sunk of late; between the fingers, a pressed peg only creeps."""

    def __init__(self, sensed: Sensed, axis: np.ndarray) -> None:
        """Begin where the tool is; `axis` points up (3,) [-]."""
        self._sensed, self._axis = sensed, axis
        self._heights: deque[float] = deque(maxlen=_LATELY)
        self.caught = sensed.tool_pose()
        """Pose of the tool before it began to sink."""
        self.read()

    def read(self) -> None:
        """Measure the pose of the tool."""
        here = self._sensed.tool_pose()
        self._heights.append(float(here.translation().dot(self._axis)))
        if self.sunk < _CAUGHT:
            self.caught = here

    @property
    def sunk(self) -> float:
        """How far it has sunk [m]."""
        return self._heights[0] - self._heights[-1]
