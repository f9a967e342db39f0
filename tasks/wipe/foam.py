"""The foam of a sponge as a sensor of the force with which it is pressed on a board."""

from collections.abc import Callable
from math import inf

import numpy as np

from robo47_qp.arrays import Vector
from robo47_qp.sim.sensed import Sensed
from robo47_qp.tasks.handling.wrist import FreeWrist

FOAM_STIFFNESS = 1100.0
"""Nominal stiffness of the foam, which is known as well as the mass of the sponge [N/m]."""
_STIFFNESSES = (0.3, 2.0)
"""Least and largest stiffness that is believed, relative to the nominal one [-]."""
SETTLED, _READ = 0.6, 0.2
"""Time from contact until the force has settled, and in which it is then measured [s]."""
RELIEVED = 2.2
"""Time in which a sponge that has not slid is relieved [s]: it slips if that is short."""
CAREFUL, _DRAGGED = 0.0125, 0.0137
"""Speed of the sponge that is wiped by the foam [m/s], and by how much dragged foam rises at the
same force, for its speed and its coefficient of friction [s]."""
_UNLOADING = (5e-4, 5e-3)
"""Rise of the tool in which the foam, still pressed, tells its stiffness [m]."""
_ROOM = 1.1
"""Rise for which the foam presses no longer, relative to how far it gives way [-]."""
_TOUCH_ERROR, _PUSHED = 0.2, 1.2
"""Standard deviation of the force that a touch tells, and by how much one differs from the others
in which something pushed [N]."""
_CREEP = (0.0076, 1.29e-5, 0.005)
"""Rate at which the force of a pressed sponge falls, as it creeps between the fingers: that of a
soft one [N/s], what it grows by with its stiffness [m/s], and the standard deviation [N/s]."""
_FRICTION, _TRUSTED = 0.5, 20
"""Coefficient of friction that is expected, and how many readings it counts as."""


class Touch:
    """A touch of the board, as it is measured."""

    def __init__(self, sensed: Sensed, felt: Callable[[], float], contact: float) -> None:
        """Begin before it.

        Args:
            sensed: What is sensed.
            felt: Returns the force of the sponge [N].
            contact: Force that counts as contact [N].
        """
        self.felt = felt
        self.since = inf
        """When contact began [s]."""
        self._sensed, self._contact = sensed, contact
        self._readings: list[tuple[float, float, float]] = []

    def read(self) -> None:
        """Measure time, height of the tool and force."""
        time, force = self._sensed.time, self.felt()
        if self.since == inf and force >= self._contact:
            self.since = time
        if time >= self.since + SETTLED:
            height = float(self._sensed.tool_pose().translation()[2])
            self._readings.append((time, height, force))

    @property
    def done(self) -> bool:
        """Whether the force has settled, and was measured for long enough."""
        return len(self._readings) > 1 and self._readings[-1][0] - self._readings[0][0] >= _READ

    @property
    def mean(self) -> tuple[float, float, float]:
        """Mean time [s], height of the tool [m] and force [N] after it had settled."""
        time, height, force = np.mean(self._readings, axis=0).tolist()
        return time, height, force


class Unloading:
    """The rise of a sponge off the board, as it is measured."""

    def __init__(self, sensed: Sensed, felt: Callable[[], float]) -> None:
        """Begin before it; `felt` returns the force of the sponge [N]."""
        self._sensed, self._felt = sensed, felt
        self._low = float(sensed.tool_pose().translation()[2])
        self._readings: list[tuple[float, float, float]] = []

    def read(self) -> None:
        """Measure time, height of the tool and force."""
        height = float(self._sensed.tool_pose().translation()[2])
        least, most = _UNLOADING
        if least <= height - self._low <= most:
            self._readings.append((self._sensed.time, height, self._felt()))

    def stiffness(self, drift: float) -> float:
        """Return the stiffness of the sponge [N/m], with a wrist that drifts [N/s]."""
        time, height, force = np.array(self._readings).T
        return -float(np.polyfit(height - height.mean(), force - drift * time, 1)[0])


class FoamSpring:
    """The foam as a sensor of the force: what the force is at a height of the tool.

    With a stiffness k, the height with the force F that is asked for is h - c t: as it is pressed,
    the sponge creeps between the fingers, t the time in contact so far. Both are estimated by
    least squares from touches, with what creep is usual; k from how the force falls when the
    sponge is lifted. Foam that is dragged at a speed v rises by T µ v, and the drag tells µ.
    """

    def __init__(self, force: float) -> None:
        """Start without touches; `force` is what is asked for [N]."""
        self.force, self.pressed = force, 0.0
        self._touches: list[tuple[float, float, float]] = []
        self._slopes: list[float] = []
        self._drag, self._count = _TRUSTED * _FRICTION * force, _TRUSTED

    @property
    def stiffness(self) -> float:
        """k [N/m]."""
        found = np.median(self._slopes or [FOAM_STIFFNESS])
        least, most = (share * FOAM_STIFFNESS for share in _STIFFNESSES)
        return float(np.clip(found, least, most))

    @property
    def way(self) -> float:
        """How far the tool rises until the foam presses no longer, with some room [m]."""
        return _ROOM * self.force / self.stiffness

    def ways(self, tolerance: float) -> tuple[float, float]:
        """Return the same of the stiffest and of the softest foam that there may be [m].

        Args:
            tolerance: By what part stiffness may be off its nominal value.
        """
        nominal = _ROOM * self.force / FOAM_STIFFNESS
        softest, stiffest = _STIFFNESSES
        return nominal / min(1.0 + tolerance, stiffest), nominal / max(1.0 - tolerance, softest)

    def soften(self, lift: Unloading, before: FreeWrist, after: FreeWrist) -> float:
        """Take in how stiff a rise was; return the drift between two readings [N/s]."""
        drift = float(after.force[2] - before.force[2]) / (after.time - before.time)
        self._slopes.append(lift.stiffness(drift))
        return drift

    def add(self, touch: Touch, lift: Unloading, before: FreeWrist, after: FreeWrist) -> None:
        """Take in a touch between two readings of the free wrist, whose drift is taken off."""
        time, height, force = touch.mean
        force -= self.soften(lift, before, after) * (time - before.time)
        self._touches.append((self.pressed + time - touch.since, height, force))
        self.pressed += SETTLED + _READ + 0.5 * RELIEVED

    def force_at(self, sensed: Sensed, touch: Touch) -> float:
        """Return the force while the sponge is at rest on the board after a touch [N]."""
        k, pressed = self.stiffness, self.pressed + sensed.time - touch.since
        times, heights, forces = np.array(self._touches).T
        firm, growth, spread = _CREEP
        usual = firm + growth * k
        rows = np.append(np.column_stack([np.ones(len(times)), -times]), [[0.0, 1.0]], axis=0)
        values = np.append(k * heights + forces - self.force, usual)
        told = values[:-1] + usual * times
        right = np.abs(told - np.median(told)) < _PUSHED
        weights = np.append(right / _TOUCH_ERROR, 1.0 / spread)
        fitted = np.linalg.lstsq(weights[:, None] * rows, weights * values, rcond=None)[0].tolist()
        height = float(sensed.tool_pose().translation()[2])
        return float(self.force + fitted[0] - fitted[1] * pressed - k * height)

    def force_dragged(self, sensed: Sensed, touch: Touch, free: Vector, way: Vector) -> float:
        """Return the force while the sponge is dragged over the board [N].

        Args:
            sensed: What is sensed.
            touch: The touch before.
            free: What the free wrist read before it (3,) [N].
            way: Direction in which the sponge is dragged (3,) [-].
        """
        self._drag += -float((sensed.felt_force() - free).dot(way))
        self._count += 1
        friction = max(self._drag / (self._count * self.force), 0.0)
        return self.force_at(sensed, touch) + self.stiffness * _DRAGGED * friction * CAREFUL
