"""Digits that a step has lost where the normal matrix JᵀJ + λ1 is nearly singular."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from scipy.linalg import lapack

from robo47_qp.arrays import Matrix, Vector

Residual: TypeAlias = tuple[Matrix, Vector, float]
"""Jacobian times the costs, wanted change of the error times them, damping."""
ILL_CONDITIONED = 1e-7
"""Damping below which a step can be wrong by more than 4e-10 rad: JᵀJ has lost the digits of what
hardly moves the tool."""
_AT_BOUND = 1e-12
"""A joint closer than this to its bound is on it [rad]."""
_ROUNDING = 1e-6
"""A longer change of a step than this is none of rounding [rad]."""


def within(low: Vector, high: Vector, dq: Vector) -> Vector:
    """Return the step between bounds that is closest to dq (n,): solvers leave them a little."""
    between: Vector = np.minimum(np.maximum(dq, low), high)
    return between


def refined(H: Matrix, fall: Vector, low: Vector, high: Vector, dq: Vector) -> Vector:
    """Return a step after one refinement of the joints that no bound holds (n,) [rad].

    Björck, "Iterative refinement of linear least squares solutions", 1967.

    Args:
        H: Normal matrix of the step (n, n); overwritten.
        fall: What is left of the gradient at dq (n,), taken from the Jacobian, which has all
            digits, and not from H; overwritten.
        low: Lower bounds of the step (n,) [rad].
        high: Upper bounds (n,) [rad].
        dq: The step, between its bounds (n,) [rad].
    """
    held = np.minimum(dq - low, high - dq) < _AT_BOUND
    if np.count_nonzero(held):
        H[held] = 0.0
        H[:, held] = 0.0
        H.reshape(-1)[:: len(dq) + 1][held] = 1.0
        fall[held] = 0.0
    _, change, lost = lapack.dposv(H, fall)
    if lost or change.dot(change) > _ROUNDING**2:
        return dq
    better: Vector = dq + change
    return better


def refined_by_residuals(
    residuals: Sequence[Residual], damping: float, bounds: tuple[Vector, Vector], dq: Vector
) -> Vector:
    """Return a step of `mink.solve_ik` after one refinement (n,) [rad]; see `refined`.

    Args:
        residuals: Those of the tasks where the step starts (`mink.BaseTask.compute_qp_residual`).
        damping: That of all joints, as `mink.solve_ik` was told.
        bounds: Lower and upper bounds of the step (n,) [rad].
        dq: mink's step (n,) [rad].
    """
    J = np.concatenate([J for J, _, _ in residuals])
    e = np.concatenate([e for _, e, _ in residuals])
    damping = damping + sum(mu for _, _, mu in residuals)
    H = J.T.dot(J)
    H.reshape(-1)[:: len(dq) + 1] += damping
    dq = within(*bounds, dq)
    return refined(H, (e - J.dot(dq)).dot(J) - damping * dq, *bounds, dq)
