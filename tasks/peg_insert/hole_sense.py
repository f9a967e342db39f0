"""HoleSense: what a peg that is searching feels of a hole."""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from robo47_qp.run.failure import Cause, Condition
from robo47_qp.sim.sensed import Sensed
from robo47_qp.tasks.handling.wrist import FreeWrist
from robo47_qp.tasks.peg_insert.sinking import Sinking

SINKS = 0.8e-3
"""Descent of a peg upright on the block that means it is in the hole [m]."""
_BLOCK = 0.5
"""Force below which the block is not felt [N]."""
_HOPS, _HOPPING = 8.0, 15
"""By how much the force on the block varies, in so many readings, where the peg hops along [N]."""
_MU_MOST, _MEETS, _SLOW, _STOPPED, _STUCK_FOR = 0.9, 1.5, 0.3, 3.0, 4
"""Largest coefficient of friction [-]. A force aside beyond that part of the force on the block is
of a wall: from so much on [N] the search goes on at a part of its speed [-], from so much on [N] in
so many readings the wall has stopped the peg. The arm springs back by what it was pushed."""


@dataclass(kw_only=True, eq=False)
class HoleSense:
    """Tells a wall of a hole from friction, by the force at the wrist, and a peg that sinks."""

    sensed: Sensed
    axis: np.ndarray
    """Axis of the hole, up (3,) [-]."""
    free: FreeWrist
    """What the free wrist read."""
    sinking: Sinking
    """How far the peg has sunk."""
    met: bool = field(default=False, init=False)
    """Whether the hole was found; kept, because an arm that has stopped is no longer pushed."""
    _along: deque[float] = field(default_factory=lambda: deque(maxlen=_HOPPING), init=False)
    _beyond: deque[float] = field(default_factory=lambda: deque(maxlen=_STUCK_FOR), init=False)

    def found(self) -> Condition:
        """Return the condition that the peg has sunk, or is stopped."""
        return Condition(name="the peg is in the hole", cause=Cause.TIMEOUT, against=self._against)

    def sunk(self) -> float:
        """Return how far the peg has sunk by now [m]."""
        self.sinking.read()
        return self.sinking.sunk

    def pace(self) -> float:
        """Return the pace of a search: it waits for the block, and slows down at walls and hops."""
        along, beyond = self._felt()
        self._along.append(along)
        if along < _BLOCK:
            return 0.0
        hops = max(self._along) - min(self._along) >= _HOPS
        return _SLOW if beyond >= _MEETS or hops else 1.0

    def insists(self) -> bool:
        """Return False where a wall is met: the arm would load itself, and leap past it."""
        return self._felt()[1] < _MEETS

    def _against(self) -> str | None:
        self._beyond.append(self._felt()[1])
        stopped, sunk = float(np.mean(self._beyond)) >= _STOPPED, self.sunk()
        self.met |= sunk >= SINKS or (stopped and len(self._beyond) == _STUCK_FOR)
        if self.met:
            return None
        return f"the peg has sunk by {1e3 * sunk:.1f} mm; {1e3 * SINKS:.1f} mm are the hole"

    def _felt(self) -> tuple[float, float]:
        """Return the force on the block, and that aside beyond what friction can be [N]."""
        force = self.sensed.felt_force() - self.free.force
        along = float(force.dot(self.axis))
        aside = float(np.linalg.norm(force - along * self.axis))
        return along, aside - _MU_MOST * max(along, 0.0)
