"""Logarithm of a pose and its derivative, computed in place: the error of mink's FrameTask."""

from math import tan

import numpy as np
from mujoco import mju_addToScl

from robo47_qp.arrays import Matrix, Vector

# Where the entries (v_x, v_y, v_z, w_x, w_y, w_z) of a twist stand in ad(v, w), row by row:
# [w]× twice on the diagonal, [v]× above it.
_SKEW = ((0, 1, -1.0, 2), (0, 2, 1.0, 1), (1, 0, 1.0, 2), (1, 2, -1.0, 0), (2, 0, -1.0, 1))
_SKEW_ALL = (*_SKEW, (2, 1, 1.0, 0))


class PoseLog:
    """Scratch memory for the logarithm; each call of `expand` overwrites the last result."""

    def __init__(self) -> None:
        """Allocate the memory."""
        blocks = [(0, 0, 3), (3, 3, 3), (0, 3, 0)]
        entries = [
            (6 * (row + i) + column + k, sign, source + axis)
            for row, column, source in blocks
            for i, k, sign, axis in _SKEW_ALL
        ]
        self._bracket = np.zeros((36, 6))
        for place, sign, source in entries:
            self._bracket[place, source] = sign
        self._ad, self._ad2, self._ad4 = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, 6))
        self._turning = self._ad[:3, :3]
        self._identity, self._slope = np.eye(6), np.empty((6, 6))
        self._flat = [m.reshape(-1) for m in (self._slope, self._ad, self._ad2, self._ad4)]
        self._twist = np.zeros(6)
        self._v = self._twist[:3]

    def expand(self, e: Vector) -> tuple[Vector, Matrix]:
        """Return the constant twist that reaches a pose in unit time, and its decrease per twist.

        With w the rotation vector and p the displacement, the twist is (v, w), v = A p,
        A = I - ½ [w]× + c [w]×², c = (1 - (θ/2) cot(θ/2)) / θ², θ = ‖w‖. Per twist of the tool,
        it decreases by the inverse of the left Jacobian of SE(3),
        I - ½ ad + c₂ ad² + c₄ ad⁴, ad the matrix of the twist's Lie bracket
        (Chirikjian, Stochastic Models, Information Theory, and Lie Groups, vol. 2, 2012, ch. 10).

        Args:
            e: Displacement [m] and rotation vector [rad] (6,), in one frame.

        Returns:
            The twist (6,), linear part first, and its decrease per twist of the tool (6, 6).
        """
        twist, v, slope, turning = self._twist, self._v, self._slope, self._turning
        flat_slope, flat, flat2, flat4 = self._flat
        w = e[3:]
        c, c2, c4 = _coefficients(float(w.dot(w)) ** 0.5)
        twist[:] = e
        self._bracket.dot(twist, flat)
        across = turning.dot(v)
        mju_addToScl(v, across, -0.5)
        mju_addToScl(v, turning.dot(across), c)
        self._bracket.dot(twist, flat)
        self._ad.dot(self._ad, self._ad2)
        self._ad2.dot(self._ad2, self._ad4)
        slope[:] = self._identity
        mju_addToScl(flat_slope, flat, -0.5)
        mju_addToScl(flat_slope, flat2, c2)
        mju_addToScl(flat_slope, flat4, c4)
        return twist, slope


def _coefficients(angle: float) -> tuple[float, float, float]:
    """Return c, c₂ and c₄ at an angle in [0, π], by their series where terms would cancel.

    The slope's even part is h(θ) = (θ/2) cot(θ/2) on the eigenvalues ±iθ of ad, each double:
    value and derivative give 1 - c₂ θ² + c₄ θ⁴ = h and -2 c₂ θ + 4 c₄ θ³ = h'.
    """
    x = angle * angle
    if x < 1e-2:
        c = 1 / 12 + x * (1 / 720 + x * (1 / 30240 + x / 1209600))
        c4 = -1 / 720 - x * (2 / 30240 + x * (3 / 1209600 + x * 4 / 47900160))
    else:
        cot = 1.0 / tan(0.5 * angle)
        c = (1.0 - 0.5 * angle * cot) / x
        falling = 0.5 * cot - 0.25 * angle * (1.0 + cot * cot)
        c4 = (falling + 2.0 * angle * c) / (2.0 * x * angle)
    return c, c + c4 * x, c4
