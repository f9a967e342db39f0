"""Jitter: measured positions that are late by a time that changes from period to period."""

from math import exp, sqrt
from typing import Any

import numpy as np

from robo47_qp.arrays import Vector

_BANDWIDTH = 300.0
"""Changes of the time of measurement that are slower than this are left to the observer [rad/s]."""
_LEAST_NOISE = 1e-6
"""Noise of the positions that is assumed where there is none [rad]."""


class Jitter:
    """Takes the changing delay of one run out of its measured positions.

    All joints are measured at one instant. Where that is early or late by s, the positions are off
    by v s along the velocity, which at 1 rad/s and 0.1 ms is more than the noise of good encoders.
    Least squares over the joints, with the noise σ_q and the jitter σ_s as weights, finds

        s = v · (q - q_expected) / (v · v + (σ_q / σ_s)²)

    What of s is slower than `_BANDWIDTH` is kept: it may be an error of the expectation, which is
    for the observer to see.
    """

    def __init__(self, noise_q: float, jitter: float, dt: float) -> None:
        """Start without a shift.

        Args:
            noise_q: Standard deviation of the measured positions σ_q [rad].
            jitter: Standard deviation of their delay σ_s, above 0 [s].
            dt: Control period [s].
        """
        self._floor = (max(noise_q, _LEAST_NOISE) / jitter) ** 2
        self._share = _share(dt)
        self._kept = np.zeros(1)

    @property
    def compiled(self) -> dict[str, Any]:
        """The same for the compiled core, on the arrays of this object."""
        return {
            "jitter_floor": self._floor,
            "jitter_share": self._share,
            "jitter": self._kept,
        }

    def removed(self, q: Vector, expected: Vector, v: Vector) -> Vector:
        """Return the measured positions without what changed in their delay (n,) [rad].

        Args:
            q: As measured (n,) [rad].
            expected: As expected at this period (n,) [rad].
            v: The velocities then (n,) [rad/s].
        """
        s = float(v.dot(q - expected)) / (float(v.dot(v)) + self._floor)
        self._kept[0] += self._share * (s - self._kept[0])
        found: Vector = q - (s - self._kept[0]) * v
        return found


def left(dt: float) -> float:
    """Return the part of the jitter's standard deviation that is not removed [-]."""
    share = _share(dt)
    return sqrt(share / (2.0 - share))


def _share(dt: float) -> float:
    """Return what is kept of a change in a period [-]."""
    return 1.0 - exp(-_BANDWIDTH * dt)
