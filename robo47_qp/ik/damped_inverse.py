"""Inverse of a Jacobian that stays bounded near and at singularities."""

import numpy as np

from robo47_qp.arrays import Matrix, Vector

_TINY = 1e-100
"""Squares of singular values below this are those of a tool that cannot move at all."""
_LOST = 1e-12
"""Squares of singular values below this part of the largest count as zero."""


class DampedInverse:
    """J⁺ = Jᵀ U diag(1 / (σ² + λ²(σ))) Uᵀ, with U and σ² of J Jᵀ by eigenvalues.

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
        squares, self._U = np.linalg.eigh(J @ J.T)
        np.maximum(squares, 0.0, out=squares)
        largest = max(float(squares[-1]), _TINY)
        zero = threshold**2 * largest
        damping = np.maximum(zero - squares, 0.0)
        damping *= damping
        damping /= 4.0 * zero
        self._damped = 1.0 / (squares + damping)
        self._exact = np.where(squares > _LOST * largest, 1.0 / np.maximum(squares, _TINY), 0.0)

    def velocities(self, twist: Vector) -> Vector:
        """Joint velocities (n,) for a twist in the units of the rows of J."""
        return self._inverted(twist, self._damped)

    def null(self, v: Vector) -> Vector:
        """The part of joint velocities that leaves the tool at rest (n,): not damped."""
        return v - self._inverted(self._J.dot(v), self._exact)

    def _inverted(self, twist: Vector, inverses: Vector) -> Vector:
        U = self._U
        parts = twist.dot(U)
        parts *= inverses
        out: Vector = U.dot(parts).dot(self._J)
        return out
