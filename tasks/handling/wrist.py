"""The force sensor at the wrist: what it reads while nothing is touched.

Its reading drifts by about the weight of a light item, but little within seconds: what counts is
the change from what it read just before contact.
"""

from collections.abc import Generator
from dataclasses import dataclass
from math import exp, hypot

import numpy as np

from robo47_qp.arrays import Vector
from robo47_qp.run.steps import StepLike, Wait
from robo47_qp.sim.sensed import Sensed

_READINGS = 20
"""Readings of the free wrist; white noise falls by their root."""
_PERIOD = 0.01
"""Time between two of them [s]."""
_TRIES = 4
"""How often it is read at most where something pushes the tool meanwhile."""
_APART = 7.0
"""Most that readings differ without a push, in standard deviations of their noise [-]."""
_EXACT = 0.2
"""The same without noise, as of something held that swings [N]."""
_DRIFT_TIME = 30.0
"""Time constant of the drift of the sensor that is expected [s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FreeWrist:
    """What the sensor at the wrist read while the tool touched nothing."""

    force: Vector
    """Its reading (3,), in the world [N]."""
    time: float
    """When [s]."""

    def drift(self, sensed: Sensed) -> float:
        """Return the standard deviation of its change up to now, per axis [N]."""
        passed, noise = sensed.time - self.time, sensed.sheet.noise
        drifted = float(noise["force_drift"]) * (2.0 - 2.0 * exp(-passed / _DRIFT_TIME)) ** 0.5
        return hypot(drifted, float(noise["noise_force"]) / _READINGS**0.5)


def wrist_errs(sensed: Sensed) -> bool:
    """Return whether the data sheet tells of an error of the force at the wrist."""
    return any(sensed.sheet.noise[name] for name in ("noise_force", "force_drift"))


def read_free_wrist(
    sensed: Sensed, *, untouched: bool = False
) -> Generator[StepLike, None, FreeWrist]:
    """Read the sensor at the wrist while the tool touches nothing and is at rest.

    It is read again where the readings differ by more than noise tells, as something pushes.

    Args:
        sensed: What is sensed.
        untouched: Whether what it reads also becomes the zero of the run's sense of contact.
    """
    most = _APART * float(sensed.sheet.noise["noise_force"]) + _EXACT
    readings = list[Vector]()
    for _ in range(_TRIES):
        readings.clear()
        for _ in range(_READINGS):
            yield Wait(name="tare", seconds=_PERIOD, untouched=untouched)
            readings.append(sensed.felt_force())
        if np.ptp(readings, axis=0).max() < most:
            break
    return FreeWrist(force=np.mean(readings, axis=0), time=sensed.time)
