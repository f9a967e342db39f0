"""Filter of one joint: position, velocity and disturbance from sampled positions."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.control.pole_placement import observer_gains

_POLES = np.array([-1.0, -0.7 + 0.714j, -0.7 - 0.714j])
"""Poles of the observer, relative to its bandwidth."""


@lru_cache(maxsize=256)
def gains(omega: float, dt: float) -> Vector:
    """Return the gains (3,) that correct q, v, d by the error of q, with poles at ω [rad/s]."""
    F, H = _transition(dt), np.array([[1.0, 0.0, 0.0]])
    poles = np.exp(omega * dt * _POLES)
    return observer_gains(F, H @ F, (poles[0].real, poles[1]))


def _transition(dt: float) -> Matrix:
    """As MuJoCo integrates: the velocity first, then the position with the new velocity."""
    return np.array([[1.0, dt, dt * dt], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])


def update(correction: Vector, dt: float) -> Matrix:
    """Return the matrix (3, 5) from q, v, d, a and the next measured q to the next q, v, d."""
    kept = np.eye(3) - np.outer(correction, [1.0, 0.0, 0.0])
    known = np.column_stack([_transition(dt), [dt * dt, dt, 0.0]])
    return np.column_stack([kept @ known, correction])


def prediction(periods: int, dt: float) -> Matrix:
    """Return the matrix (2, 3 + periods) from q, v, d and the next accelerations to q, v."""
    out = np.eye(3, 3 + periods)
    for k in range(periods):
        out = _transition(dt) @ out
        out[:, 3 + k] += [dt * dt, dt, 0.0]
    return out[:2]


def per_joint(matrices: Sequence[Matrix]) -> Matrix:
    """Return one matrix for rows of all joints, from one for the numbers of each joint."""
    rows, columns = matrices[0].shape
    n = len(matrices)
    whole = np.zeros((rows, n, columns, n))
    for j, matrix in enumerate(matrices):
        whole[:, j, :, j] = matrix
    return whole.reshape(rows * n, columns * n)
