"""Sensing: what a policy server is told of robosuite's observations, and the noise of poses."""

from typing import Any

import numpy as np

NOISE = (0.002, np.deg2rad(2.0))
"""Standard deviations of the noise of poses: along each axis [m], and about each [rad]."""
_PRIVATE = ("_to_", "object-state", "proprio", "_cos", "_sin", "hinge_qpos", "_is_", "_on_")
"""Parts of the names of what is not told: derived from robot and things, or seen by no camera."""
_PRIVATE_NAMES = ("angle", "t", "d")
"""Names of what is not told, either: how peg and hole are to each other (TwoArmPegInHole)."""
_POSES = ("_pos", "_xpos", "_quat")
"""Ends of the names of positions and orientations."""


class Noise:
    """The error of every pose: drawn once in an episode, so that no averaging removes it."""

    def __init__(self, seed: int, size: tuple[float, float]) -> None:
        self._rng, self._size = np.random.default_rng([seed, 1]), size
        self._errors: dict[str, np.ndarray] = {}

    def added(self, name: str, value: np.ndarray) -> np.ndarray:
        """A measured position (3,), or quaternion xyzw (4,)."""
        length, angle = self._size
        if name not in self._errors:
            self._errors[name] = self._rng.normal(size=3)
        error = self._errors[name]
        if len(value) == 3:
            return value + length * error
        half = 0.5 * angle * error
        x, y, z = half
        w = np.sqrt(1.0 - half.dot(half))
        # The turn, about the axes of the world, after the true one.
        left = np.array([[w, -z, y, x], [z, w, -x, y], [-y, x, w, z], [-x, -y, -z, w]])
        turned: np.ndarray = left @ value
        return turned


def measured(seen: dict[str, Any], noise: Noise | None) -> dict[str, np.ndarray]:
    """What the server is told of robosuite's observations."""
    told = {}
    for name, value in seen.items():
        if name in _PRIVATE_NAMES or any(part in name for part in _PRIVATE):
            continue
        array = np.atleast_1d(np.asarray(value, float))
        posed = name.endswith(_POSES) and not name.startswith("robot")
        told[name] = noise.added(name, array) if noise is not None and posed else array
    return told
