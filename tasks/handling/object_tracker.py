"""Object tracker: predicts an object that moves at a constant velocity, from camera images."""

from collections.abc import Generator

import numpy as np
from mink import SE3, SO3
from scipy.spatial.transform import Rotation

from robo47_qp.run.steps import StepLike, Wait
from robo47_qp.sim.simulation import Simulation

_FRAME = 1.0 / 30.0
"""Time between two images of the camera [s]."""
_FEWEST = 8
"""Least number of images before a prediction: a quarter of a second."""
_GOOD_ENOUGH = 2e-3
"""Accepted standard deviation of a predicted position [m]."""


class ObjectTracker:
    """Tracks one object that moves horizontally on a line at a constant speed.

    The line is fitted to the seen positions by least squares; each new frame improves it.
    """

    def __init__(self, simulation: Simulation, name: str) -> None:
        """Start without any image."""
        self._simulation, self._name = simulation, name
        self._times: list[float] = []
        self._seen: list[SE3] = []

    def watch(self) -> Generator[StepLike, None, None]:
        """Observe the object for as long as the camera's noise requires.

        The line through n positions with independent errors σ is known to 2σ/√n at its end
        (Draper and Smith, Applied Regression Analysis, 1998, section 1.4).
        """
        noise = 2.0 * self._simulation.camera_noise
        frames = max(_FEWEST, int(np.ceil((noise / _GOOD_ENOUGH) ** 2)))
        self.update()
        while len(self._seen) < frames:
            yield Wait(name=f"watch the {self._name}", seconds=_FRAME)
            self.update()

    def update(self) -> None:
        """Add the camera's image if it is new."""
        now = self._simulation.time
        if self._times and now < self._times[-1] + 0.99 * _FRAME:
            return
        self._times.append(now)
        self._seen.append(self._simulation.seen_pose(self._name))
        times = np.array(self._times)
        self._middle = float(times.mean())
        about = times - self._middle
        points = np.array([pose.translation() for pose in self._seen])
        self._centre = points.mean(axis=0)
        spread = float(about @ about)
        self._speed = about @ points / spread if spread > 0.0 else np.zeros(3)
        self._speed[2] = 0.0
        turns = [pose.rotation().wxyz for pose in self._seen]
        mean = Rotation.from_quat(turns, scalar_first=True).mean()
        self._turn = SO3(mean.as_quat(scalar_first=True))

    @property
    def velocity(self) -> np.ndarray:
        """Velocity in the world (3,) [m/s]."""
        return self._speed.copy()

    def at(self, time: float) -> SE3:
        """Return T_world_object at a past or future time [s]."""
        position = self._centre + (time - self._middle) * self._speed
        return SE3.from_rotation_and_translation(self._turn, position)
