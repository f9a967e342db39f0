"""Object tracker: predicts an object that moves at a constant velocity, from camera images."""

from collections.abc import Generator

import numpy as np
from mink import SE3, SO3
from numpy.typing import NDArray
from scipy.interpolate import BPoly
from scipy.spatial.transform import Rotation

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.run.steps import StepLike, Wait
from robo47_qp.sim.sensed import Sensed
from robo47_qp.tasks.handling.pose_estimate import camera_errs

_USUAL, _PERIOD = 30.0, 0.75e-3
"""Images of the camera per second [1/s], and what times are rounded by at most [s]."""
_FEWEST = 8
"""Least number of images before a prediction: a quarter of a second."""
_GOOD_ENOUGH = 2e-3
"""Accepted standard deviation of a predicted position [m]."""
_FADES = 0.4
"""Time in which what new images change comes to what follows the object [s]."""
_DEVIATIONS = 4.0
"""Standard deviations of the noise from the line beyond which an image is left out, per axis."""


class ObjectTracker:
    """Tracks one object that moves horizontally on a line at a constant speed.

    The line is fitted to the seen positions by least squares; each new frame improves it.
    """

    def __init__(self, sensed: Sensed, name: str, height: float | None = None) -> None:
        """Start without any image.

        Args:
            sensed: What is sensed.
            name: Name of the object.
            height: Known height of its frame [m]; None takes the camera's.
        """
        self._sensed, self._name, self._height = sensed, name, height
        rate = float(sensed.sheet.noise["camera_rate"])
        self._frame = 1.0 / rate
        # When they are taken is known to a control period, which of a short time is more.
        self._soonest = 0.99 * self._frame if rate <= _USUAL else self._frame - _PERIOD
        self._times: list[float] = []
        self._seen: list[SE3] = []
        self._fading: BPoly | None = None

    def watch(self) -> Generator[StepLike, None, None]:
        """Observe the object for as long as the camera's noise requires at least.

        The line through n positions with independent errors σ is known to 2σ/√n at its end
        (Draper and Smith, Applied Regression Analysis, 1998, section 1.4). Errors that last longer
        than an image call for more: call `update` while there is time.
        """
        noise = 2.0 * self._sensed.camera_noise
        frames = max(_FEWEST, int(np.ceil((noise / _GOOD_ENOUGH) ** 2)))
        self.update()
        while len(self._seen) < frames:
            yield Wait(name=f"watch the {self._name}", seconds=self._frame)
            self.update()

    def update(self) -> None:
        """Add the camera's image if it is new, as of the time at which it was taken."""
        if self.collect():
            self._fit_line()

    def collect(self) -> bool:
        """Keep the camera's image for the next update; return whether it is new."""
        taken = self._sensed.seen_time(self._name)
        if self._times and taken < self._times[-1] + self._soonest:
            return False
        self._times.append(taken)
        self._seen.append(self._sensed.seen_pose(self._name))
        return True

    def update_smoothly(self) -> None:
        """Add an image while something follows the object: its pose changes, but does not leap."""
        if not self.collect():
            return
        now = self._sensed.time
        before, speed = self.at(now), self._speed
        off = np.array([self._left(now, k) for k in range(3)])
        self._fit_line()
        self._fading = None
        here = self.at(now)
        off[0, :3] = before.translation() - here.translation()
        off[0, 3:] = (here.rotation().inverse() @ before.rotation()).log()
        off[1, :3] += speed - self._speed
        self._fading = BPoly.from_derivatives([now, now + _FADES], [off, np.zeros((3, 6))])

    def _fit_line(self) -> None:
        """Fit the line to all images but those that are far from it."""
        self._fit(np.ones(len(self._seen), bool))
        noise = _DEVIATIONS * self._sensed.camera_noise
        off = np.abs(self._positions() - self._line(np.array(self._times))).max(axis=1)
        far = off > max(noise, 3.0 * float(np.median(off)))
        if far.any():
            self._fit(~far)

    def _fit(self, used: NDArray[np.bool_]) -> None:
        """Fit the line to some of the images."""
        times, points = np.array(self._times)[used], self._positions()[used]
        self._middle = float(times.mean())
        about = times - self._middle
        self._centre = points.mean(axis=0)
        spread = float(about @ about)
        self._speed = about @ points / spread if spread > 0.0 else np.zeros(3)
        self._speed[2] = 0.0
        if self._height is not None and camera_errs(self._sensed):
            self._centre[2] = self._height
        turns = np.array([pose.rotation().wxyz for pose in self._seen])[used]
        mean = Rotation.from_quat(turns, scalar_first=True).mean()
        self._turn = SO3(mean.as_quat(scalar_first=True))

    def _positions(self) -> Matrix:
        positions: Matrix = np.array([pose.translation() for pose in self._seen])
        return positions

    def _line(self, times: Vector) -> Matrix:
        """Return positions on the fitted line at some times (k, 3); heights as they were seen."""
        points: Matrix = self._centre + (times - self._middle)[:, None] * self._speed
        points[:, 2] = self._positions()[:, 2]
        return points

    @property
    def velocity(self) -> np.ndarray:
        """Velocity in the world (3,) [m/s]."""
        return self._speed.copy()

    def at(self, time: float) -> SE3:
        """Return T_world_object at a past or future time [s]."""
        position = self._centre + (time - self._middle) * self._speed
        off = self._left(time)
        turn = self._turn @ SO3.exp(off[3:])
        return SE3.from_rotation_and_translation(turn, position + off[:3])

    def _left(self, time: float, derivative: int = 0) -> Vector:
        """Return what is left at a time of what images have changed, or a derivative of it (6,).

        Position [m] and rotation vector [rad].
        """
        if self._fading is None:
            return np.zeros(6)
        left: Vector = self._fading(np.clip(time, *self._fading.x), derivative)
        return left
