"""A target that is moved by hand: by keys in steps, and smoothed to what an arm can follow."""

import mujoco
import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Vector
from robo47_qp.constants import TIMESTEP

_STEP, _TURN = 0.02, np.deg2rad(10.0)
"""How far a key moves [m] and turns [rad] the target."""
_RIGHT, _LEFT, _DOWN, _UP, _PAGE_UP, _PAGE_DOWN, HOME_KEY = range(262, 269)
_COMMA, _PERIOD = 44, 46
"""Codes of keys, as the viewer tells them (those of GLFW)."""
_MOVES = {
    _UP: (1.0, 0.0, 0.0),
    _DOWN: (-1.0, 0.0, 0.0),
    _LEFT: (0.0, 1.0, 0.0),
    _RIGHT: (0.0, -1.0, 0.0),
    _PAGE_UP: (0.0, 0.0, 1.0),
    _PAGE_DOWN: (0.0, 0.0, -1.0),
}
_TURNS = {_COMMA: 1.0, _PERIOD: -1.0}
HELP = (
    "Hold Ctrl and drag with the mouse: the right button moves the target, the left one turns it; "
    "if something else is selected, double-click the target first. Keys: arrows and Page Up/Down "
    "move it, comma and period turn it, Home brings it back. Close the window to end."
)
"""How the target is moved in the viewer's window."""
_RATE = 30.0
"""ω: how fast the smoothed pose follows [1/s]; it lags by 2 / ω."""
_FASTEST = np.array([1.0, 3.0])
"""Largest speed of the smoothed pose [m/s, rad/s]."""


def moved_by_key(key: int, T_world_target: SE3, T_world_start: SE3) -> SE3:
    """Return where a key puts the target; keys without a meaning leave it where it is.

    Args:
        key: Code of the key.
        T_world_target: Where it is now.
        T_world_start: Where it was at the start.
    """
    if key == HOME_KEY:
        return T_world_start
    place, R = T_world_target.translation(), T_world_target.rotation()
    if key in _MOVES:
        place = place + _STEP * np.array(_MOVES[key])
    if key in _TURNS:
        R = SO3.exp(np.array([0.0, 0.0, _TURN * _TURNS[key]])) @ R
    return SE3.from_rotation_and_translation(R, place)


class SmoothedPose:
    """A pose that follows another one like a critically damped spring, x'' = ω² e - 2 ω x'.

    Hands and keys move in jumps, 50 times a second at most; this makes motion of them whose
    velocity can be fed forward. Its speed is bounded by that of its error e, shortened to
    2 v_max / ω.
    """

    def __init__(self, start: SE3) -> None:
        """Start at rest at a pose."""
        self._p, self._quaternion = start.translation().copy(), start.rotation().wxyz.copy()
        self._twist, self._turn = np.zeros(6), np.zeros(3)

    def step(self, goal: SE3) -> SE3:
        """Move on by one control period, and return the pose."""
        e = np.zeros(6)
        e[:3] = goal.translation() - self._p
        mujoco.mju_subQuat(self._turn, goal.rotation().wxyz, self._quaternion)
        mujoco.mju_rotVecQuat(e[3:], self._turn, self._quaternion)
        for part, fastest in zip((slice(0, 3), slice(3, 6)), _FASTEST, strict=True):
            e[part] *= _shortening(e[part], 2.0 * fastest / _RATE)
        self._twist += TIMESTEP * (_RATE**2 * e - 2.0 * _RATE * self._twist)
        self._p += TIMESTEP * self._twist[:3]
        R = SO3.exp(TIMESTEP * self._twist[3:]) @ SO3(self._quaternion)
        self._quaternion = R.wxyz / np.linalg.norm(R.wxyz)
        return SE3(np.concatenate([self._quaternion, self._p]))


def _shortening(e: Vector, longest: float) -> float:
    length = float(np.linalg.norm(e))
    return longest / length if length > longest else 1.0
