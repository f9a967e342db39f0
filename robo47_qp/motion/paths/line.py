"""Line: the straight motion of a tool between two poses."""

import mujoco
import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Matrix, Vector


class Line:
    """The position goes straight; the orientation turns about one axis, in proportion."""

    def __init__(self, start: SE3, goal: SE3) -> None:
        """From `start` to `goal`, both T_world_tcp; the turn is the shorter one."""
        self._start = start
        self._shift = goal.translation() - start.translation()
        # mink's logarithm is zero at half a turn; MuJoCo's is not.
        self._turn = np.zeros(3)
        mujoco.mju_subQuat(self._turn, goal.wxyz_xyz[:4], start.wxyz_xyz[:4])
        self.length = float(np.linalg.norm(self._shift))
        """[m]"""
        self.angle = float(np.linalg.norm(self._turn))
        """[rad]"""

    @property
    def turn(self) -> Vector:
        """Rotation vector from start to goal in the frame of the start [rad]."""
        return self._turn.copy()

    def at(self, s: float) -> SE3:
        """T_world_tcp at s in [0, 1]."""
        return SE3.from_rotation_and_translation(
            self._start.rotation() @ SO3.exp(s * self._turn),
            self._start.translation() + s * self._shift,
        )

    def position(self, s: float, order: int) -> Vector:
        """Derivative of the position by s, of an order of 0 or more (3,) [m]."""
        if order == 0:
            place: Vector = self._start.translation() + s * self._shift
            return place
        return self._shift.copy() if order == 1 else np.zeros(3)

    def distances(self, positions: Matrix) -> Vector:
        """Distance of points (N, 3) from the line between the two poses, shape (N,) [m]."""
        offset: Matrix = positions - self._start.translation()
        if self.length > 0.0:
            s = np.clip(offset @ self._shift / self.length**2, 0.0, 1.0)
            offset -= s[:, None] * self._shift
        distance: Vector = np.linalg.norm(offset, axis=1)
        return distance
