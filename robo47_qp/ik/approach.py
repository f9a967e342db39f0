"""How fast to go to a target that moves, jumps or cannot be reached."""

from math import isfinite, sqrt

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.arrays import Vector

_FARTHEST = 1e6
"""Where coordinates of targets end [m]: beyond it differences overflow."""


def approach_rate(way: Vector, v_max: Vector, a_max: Vector, gain: float) -> float:
    """Part of the way to go per second, so that every joint can stop at its end [1/s].

    A joint with the way d ahead may go K d while that is gentle, and further away
    sqrt(2 a_max (d - a_max / (2 K²))), never above v_max: both laws and their slopes meet at
    d = a_max / K², and following them takes no more than a_max. The slowest joint sets the pace
    of all, so the joints arrive together.

    Args:
        way: Joint displacement to the target (n,) [rad].
        v_max: Largest joint speeds to use (n,) [rad/s].
        a_max: Largest decelerations to use (n,) [rad/s²].
        gain: K [1/s].
    """
    # For a few joints floats are faster than arrays.
    pace = gain
    for d, v, a in zip(np.abs(way).tolist(), v_max.tolist(), a_max.tolist(), strict=True):
        soft = a / gain**2
        if d > soft:
            pace = min(pace, sqrt(a * (2.0 * d - soft)) / d)
        if pace * d > v:
            pace = v / d
    return pace


def shortened(displacement: Vector, longest: float) -> Vector:
    """The displacement, scaled to a length of at most `longest` [m]; any finite input."""
    largest = max(map(abs, displacement.tolist()))
    if largest > longest:
        displacement = displacement * (longest / largest)
    length = sqrt(displacement.dot(displacement))
    return displacement * (longest / length) if length > longest else displacement


class TargetMotion:
    """The target's own velocity, by the difference of two ticks."""

    def __init__(self, dt: float) -> None:
        self._dt = dt
        self._last: Vector | None = None
        self._turn = np.empty(3)

    def forget(self) -> None:
        """Start anew: the next target counts as being at rest."""
        self._last = None

    def twist(self, target: Vector, fastest: Vector) -> tuple[Vector, bool]:
        """Twist of the target in the world frame, linear part first (6,) [m/s, rad/s].

        A target that moved farther in one tick than the tool could have is taken to have
        jumped. One that jumped is at rest until the next tick.

        Args:
            target: Quaternion wxyz and position (7,).
            fastest: Largest component-wise twist of the tool at any joint velocity allowed (6,).

        Returns:
            The twist, and whether the target jumped.
        """
        twist, last = np.zeros(6), self._last
        self._last = target.copy()
        if last is None:
            return twist, False
        np.subtract(target[4:], last[4:], out=twist[:3])
        mujoco.mju_subQuat(self._turn, target[:4], last[:4])
        mujoco.mju_rotVecQuat(twist[3:], self._turn, last[:4])
        twist /= self._dt
        if np.count_nonzero(np.abs(twist) > fastest):
            return np.zeros(6), True
        return twist, False


def pose_or_none(T_world_target: object) -> SE3 | None:
    """The target with its position held within 1000 km of the world's origin, if it is a pose."""
    if not isinstance(T_world_target, SE3):
        return None
    numbers = np.asarray(T_world_target.wxyz_xyz)
    if numbers.shape != (7,) or numbers.dtype.kind not in "fiu":
        return None
    pose = numbers.astype(np.float64)
    w, x, y, z, *position = pose.tolist()
    # Comparisons are false for NaN, and products of floats overflow to infinity.
    if not abs(w * w + x * x + y * y + z * z - 1.0) <= 2e-6 or not all(map(isfinite, position)):
        return None
    if max(map(abs, position)) > _FARTHEST:
        np.clip(pose[4:], -_FARTHEST, _FARTHEST, out=pose[4:])
    elif numbers.dtype == np.float64:
        return T_world_target
    return SE3(pose)
