"""Inverse of a Jacobian that stays bounded near and at singularities."""

from functools import lru_cache

import numpy as np
from scipy.linalg import lapack

from robo47_qp.arrays import Matrix, Vector

_TINY = 1e-100
"""Squares of singular values below this are those of a tool that cannot move at all."""
_LOST = 1e-12
"""Squares of singular values below this part of the largest count as zero."""


class DampedInverse:
    """J⁺ = Jᵀ U diag(1 / (σ² + λ²(σ))) Uᵀ, with U and σ² of J Jᵀ by eigenvalues.

    Where no direction is damped that is Jᵀ (J Jᵀ)⁻¹, which takes a Cholesky factor only.

    Directions with σ above σ0 are inverted exactly. Below, λ grows from 0 to σ0 / 2:
    λ²(σ) = (σ0² - σ²)² / (4 σ0²), which bounds the gain by 2 / σ0 or less. Only the directions
    that are nearly lost are damped (Chiaverini, "Singularity-robust task-priority redundancy
    resolution for real-time kinematic control of robot manipulators", 1997; Maciejewski and
    Klein, "Numerical filtering for the operation of robotic manipulators through kinematically
    singular configurations", 1988).
    """

    def __init__(self, J: Matrix, threshold: float) -> None:
        """Factor a Jacobian.

        Args:
            J: Rows in comparable units, shape (rows, n); kept, not copied.
            threshold: σ0 as a part of the largest singular value [-].
        """
        self._J = J
        # The trace of J Jᵀ is no less than its largest eigenvalue: where even that much taken
        # off leaves it positive definite, nothing is damped and no eigenvalue is needed.
        squares = J @ J.T
        entries = J.ravel()
        reserve = max(threshold**2, _LOST) * float(entries.dot(entries))
        _, lost = lapack.dpotrf(squares - reserve * _identity(len(J)))
        if lost:
            self._damped, self._exact = _by_eigenvalues(squares, J, threshold)
        else:
            _, self._damped, _ = lapack.dposv(squares, J)
            self._exact = self._damped

    def velocities(self, twist: Vector) -> Vector:
        """Joint velocities (n,) for a twist in the units of the rows of J."""
        out: Vector = twist.dot(self._damped)
        return out

    def null(self, v: Vector) -> Vector:
        """The part of joint velocities that leaves the tool at rest (n,): not damped."""
        out: Vector = v - self._J.dot(v).dot(self._exact)
        return out


def _by_eigenvalues(squares: Matrix, J: Matrix, threshold: float) -> tuple[Matrix, Matrix]:
    """The transposes of J⁺, damped and not damped (rows, n)."""
    eigenvalues, U, _ = lapack.dsyev(squares)
    np.maximum(eigenvalues, 0.0, out=eigenvalues)
    largest = max(float(eigenvalues[-1]), _TINY)
    zero = threshold**2 * largest
    damping = np.maximum(zero - eigenvalues, 0.0)
    damping *= damping
    damping /= 4.0 * zero
    damping += eigenvalues
    kept = eigenvalues > _LOST * largest
    exact = np.where(kept, 1.0 / np.maximum(eigenvalues, _TINY), 0.0)
    along = U.T @ J
    return (U / damping) @ along, (U * exact) @ along


@lru_cache(maxsize=8)
def _identity(rows: int) -> Matrix:
    return np.eye(rows)
