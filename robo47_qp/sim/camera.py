"""ObjectCamera: poses of things as a camera measures them, frame by frame."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil
from typing import NamedTuple

import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Vector
from robo47_qp.sim.sensing import GaussMarkov, SensorErrors

FOCUS = np.array([0.5, 0.0, 0.0])
"""Point about which the calibration of the camera is turned, in the world (3,) [m]: the middle of
the tables of the tasks, where a camera is calibrated."""
_BIAS, _FRAMES, _THINGS = range(3)


class Sight(NamedTuple):
    """A pose as it was measured."""

    pose: SE3
    """T_world_thing as measured."""
    time: float
    """When the frame was taken [s]."""


@dataclass(frozen=True, kw_only=True)
class _Frame:
    """What one frame shows, and when it arrives."""

    arrival: float
    sights: dict[str, Sight]


class ObjectCamera:
    """Measures the poses of things as they were in its last frame that has arrived.

    A seen pose is T_bias T_world_thing, moved by the noise and turned by it about the world's
    vertical. T_bias, the error of the calibration, is the same for all things and frames. The
    errors depend on the seed, the thing and the frame, not on the order or number of calls: two
    programs in one world get the same measurements.
    """

    def __init__(
        self,
        things: Sequence[str],
        errors: SensorErrors,
        seed: int,
        occluded: Callable[[str], bool] = lambda _: False,
        put_away: Callable[[str, SE3], bool] = lambda _, __: False,
    ) -> None:
        """Set the camera up, without a first frame.

        Args:
            things: Their names.
            errors: Errors of the measured poses.
            seed: Seed of the errors.
            occluded: Says of a thing whether it is hidden from the camera now.
            put_away: Says of a thing and its pose whether it is where such things are put away:
                that is known, so a measured pose would tell of the errors. It is the true one.
        """
        self._put_away = put_away
        self._things, self._errors, self._seed = tuple(things), errors, seed
        self._occluded = occluded
        drawn = self._generator(_BIAS, 0, 0).standard_normal(6)
        turn = SE3.from_rotation(SO3.exp(errors.rotation_bias * drawn[3:]))
        moved = SE3.from_translation(FOCUS + errors.pose_bias * drawn[:3])
        self._T_bias = moved @ turn @ SE3.from_translation(-FOCUS)
        self._biased = bool(errors.rotation_bias or errors.pose_bias)
        self._process = GaussMarkov(1.0, 1.0 / errors.camera_rate, errors.pose_noise_time)
        self._frame = -1
        self._noise: dict[str, Vector] = {}
        self._outlier: dict[str, Vector] = {}
        self._coming: deque[_Frame] = deque()
        self._seen: dict[str, Sight] = {}

    def frame(self, time: float) -> int:
        """Return the number of the last frame at a time [s]."""
        # Slack for the rounding of times that are sums of periods.
        return int(time * self._errors.camera_rate + 1e-6)

    def ahead(self, time: float, period: float) -> int:
        """Return after how many periods [s] from a time [s] the next frame is due; at least 1."""
        periods = max(1, ceil(((self._frame + 1) / self._errors.camera_rate - time) / period))
        while periods > 1 and self.frame(time + (periods - 1) * period) != self._frame:
            periods -= 1
        return periods

    def start(self, time: float, pose: Callable[[str], SE3]) -> None:
        """Begin in front of things that have been at rest and in view for some time."""
        self._frame = self.frame(time)
        self._coming.clear()
        for i, name in enumerate(self._things):
            self._noise[name] = self._process.start(self._draw(i))
            self._seen[name] = self._sight(name, pose(name), time)

    def place(self, name: str, time: float, T_world_thing: SE3) -> None:
        """Show a thing that was put elsewhere, as if it had been there for some time."""
        for frame in self._coming:
            frame.sights.pop(name, None)
        self._seen[name] = self._sight(name, T_world_thing, time)

    def watch(self, time: float, pose: Callable[[str], SE3]) -> None:
        """Take a frame if one is due at a time [s], and show those that have arrived."""
        if self.frame(time) != self._frame:
            self._frame = self.frame(time)
            self._take(time, pose)
        # Slack for the rounding of times, as above.
        while self._coming and self._coming[0].arrival <= time + 1e-6:
            self._seen |= self._coming.popleft().sights

    def seen(self, name: str) -> Sight:
        """Return the last measurement of a thing that has arrived."""
        return self._seen[name]

    def _take(self, time: float, pose: Callable[[str], SE3]) -> None:
        for i, name in enumerate(self._things):
            self._noise[name] = self._process.advance(self._noise[name], self._draw(i))
        if self._generator(_FRAMES, 0, self._frame).random() < self._errors.dropped_frames:
            return
        sights = {
            name: self._sight(name, pose(name), time)
            for name in self._things
            if not self._occluded(name)
        }
        self._coming.append(_Frame(arrival=time + self._errors.camera_latency, sights=sights))

    def _draw(self, i: int) -> Vector:
        """Draw the outlier of a thing in this frame, and return normal numbers for its noise."""
        chance, errors = self._generator(_THINGS, i, self._frame), self._errors
        drawn = chance.standard_normal(4)
        wrong, direction = chance.random() < errors.outliers, chance.standard_normal(3)
        size = errors.outlier_size if wrong else 0.0
        self._outlier[self._things[i]] = size * direction / np.linalg.norm(direction)
        return drawn

    def _sight(self, name: str, T_world_thing: SE3, time: float) -> Sight:
        if self._put_away(name, T_world_thing):
            return Sight(T_world_thing, time)
        errors, noise = self._errors, self._noise[name]
        T = self._T_bias @ T_world_thing if self._biased else T_world_thing
        turn = SO3.from_z_radians(errors.heading_noise * float(noise[3]))
        position = T.translation() + errors.pose_noise * noise[:3] + self._outlier[name]
        return Sight(SE3.from_rotation_and_translation(turn @ T.rotation(), position), time)

    def _generator(self, kind: int, i: int, frame: int) -> np.random.Generator:
        return np.random.default_rng([self._seed, kind, i, frame])
