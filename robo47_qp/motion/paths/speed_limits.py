"""How fast the tool may go along a path."""

from dataclasses import dataclass

import numpy as np

from robo47_qp.arrays import Vector


@dataclass(frozen=True, kw_only=True)
class PathProfile:
    """Bounds on the tool along a straight path; each a speed, an acceleration, a jerk."""

    linear: tuple[float, float, float] = (0.25, 0.75, 5.0)
    """[m/s, m/s², m/s³]"""
    angular: tuple[float, float, float] = (1.0, 3.0, 20.0)
    """[rad/s, rad/s², rad/s³]"""

    def along(self, length: float, angle: float, pace: float) -> Vector:
        """Bounds on the first three derivatives of the path parameter in [0, 1].

        Args:
            length: Length of the path [m].
            angle: Angle turned on the way [rad].
            pace: Ratio in (0, 1]; stretches time by its inverse.

        Returns:
            Shape (3,) [1/s, 1/s², 1/s³].
        """
        bounds = np.full(3, np.inf)
        if length > 0.0:
            bounds = np.minimum(bounds, np.array(self.linear) / length)
        if angle > 0.0:
            bounds = np.minimum(bounds, np.array(self.angular) / angle)
        bounds *= pace ** np.arange(1, 4)
        return bounds

    def least_time(self, length: float, angle: float) -> float:
        """Time to go a way and turn an angle at full speed [s]."""
        return max(length / self.linear[0], angle / self.angular[0])

    def slowed(self, pace: float) -> "PathProfile":
        """The bounds of the same paths run at `pace` times the full speed."""
        v, a, j = self.linear
        w, b, k = self.angular
        return PathProfile(
            linear=(v * pace, a * pace**2, j * pace**3),
            angular=(w * pace, b * pace**2, k * pace**3),
        )
