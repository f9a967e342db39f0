"""Camera: where objects seem to be, frame by frame."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Vector


@dataclass(frozen=True, kw_only=True)
class CameraNoise:
    """How far what a camera sees is off. All of it Gaussian, by standard deviation."""

    position: float
    """Of each coordinate, anew in every frame [m]."""
    heading: float
    """Of the turn about the world's vertical, anew in every frame [rad]."""
    bias: float
    """Of each coordinate, once per object and then the same in all frames [m]."""
    rate: float
    """Frames per second [1/s]."""


class ObjectCamera:
    """Sees the poses of objects, as they were at its last frame.

    What it sees of an object depends on the seed, the object and the frame, and not on how
    often or in which order it is asked: two programs in one world get the same pictures.
    """

    def __init__(self, objects: Sequence[str], noise: CameraNoise, seed: int) -> None:
        """Set the camera up; the first frame is still to be taken.

        Args:
            objects: Names of what it sees.
            noise: How far that is off.
            seed: Of the noise.
        """
        self._objects, self._noise, self._seed = tuple(objects), noise, seed
        # One more than the frame's number is used below: a seed ends as if zeros followed.
        self._biases = [
            noise.bias * np.random.default_rng([seed, i, 0]).standard_normal(3)
            for i in range(len(self._objects))
        ]
        self._frame = -1
        self._taken: dict[str, SE3] = {}
        self._seen: dict[str, SE3] = {}

    def frame(self, time: float) -> int:
        """Number of the last frame at a time [s]."""
        # Slack for the rounding of times that are sums of periods.
        return int(time * self._noise.rate + 1e-6)

    def watch(self, time: float, pose: Callable[[str], SE3]) -> None:
        """Take a frame if one is due at a time [s], of where the objects are."""
        if self.frame(time) != self._frame:
            self.take(time, pose)

    def take(self, time: float, pose: Callable[[str], SE3]) -> None:
        """Take the last frame at a time [s], again if there is one."""
        self._frame = self.frame(time)
        self._taken = {name: pose(name) for name in self._objects}
        self._seen.clear()

    def seen(self, name: str) -> SE3:
        """T_world_object as the last frame shows it; the name is known."""
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
