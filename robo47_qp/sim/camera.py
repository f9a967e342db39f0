"""ObjectCamera: measured poses of objects, frame by frame."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Vector


@dataclass(frozen=True, kw_only=True)
class CameraNoise:
    """Standard deviations of the Gaussian errors of a camera, and its frame rate."""

    position: float
    """Error of each coordinate, drawn anew in every frame [m]."""
    heading: float
    """Error of the rotation about the world's vertical, drawn anew in every frame [rad]."""
    bias: float
    """Error of each coordinate, drawn once per object [m]."""
    rate: float
    """Frames per second [1/s]."""


class ObjectCamera:
    """Measures the poses of objects as they were at its last frame.

    The error of a pose depends on the seed, the object and the frame, not on the order or
    number of calls: two programs in one world get the same measurements.
    """

    def __init__(self, objects: Sequence[str], noise: CameraNoise, seed: int) -> None:
        """Set the camera up, without a first frame.

        Args:
            objects: Names of the objects.
            noise: Errors of the measured poses.
            seed: Seed of the errors.
        """
        self._objects, self._noise, self._seed = tuple(objects), noise, seed
        # Seeds of frames end with 1 and above: a trailing 0 is that of the bias.
        self._biases = [
            noise.bias * np.random.default_rng([seed, i, 0]).standard_normal(3)
            for i in range(len(self._objects))
        ]
        self._frame = -1
        self._taken: dict[str, SE3] = {}
        self._seen: dict[str, SE3] = {}

    def frame(self, time: float) -> int:
        """Return the number of the last frame at a time [s]."""
        # Slack for the rounding of times that are sums of periods.
        return int(time * self._noise.rate + 1e-6)

    def watch(self, time: float, pose: Callable[[str], SE3]) -> None:
        """Take a frame of the objects' poses if one is due at a time [s]."""
        if self.frame(time) != self._frame:
            self.take(time, pose)

    def take(self, time: float, pose: Callable[[str], SE3]) -> None:
        """Take the last frame at a time [s], again if it was taken already."""
        self._frame = self.frame(time)
        self._taken = {name: pose(name) for name in self._objects}
        self._seen.clear()

    def seen(self, name: str) -> SE3:
        """Return T_world_object as measured in the last frame."""
        if name not in self._seen:
            shift, turn = self._error(self._objects.index(name))
            T = self._taken[name]
            self._seen[name] = SE3.from_rotation_and_translation(
                SO3.from_z_radians(turn) @ T.rotation(), T.translation() + shift
            )
        return self._seen[name]

    def _error(self, i: int) -> tuple[Vector, float]:
        drawn = np.random.default_rng([self._seed, i, 1 + self._frame]).standard_normal(4)
        shift = self._biases[i] + self._noise.position * drawn[:3]
        return shift, float(self._noise.heading * drawn[3])
