"""Damping of least squares: constant, by the error, or by the distance from a singularity."""

from dataclasses import dataclass
from math import sqrt

import numpy as np

from robo47_qp.arrays import Checked, Matrix, NotNegative, Vector


@dataclass(frozen=True, kw_only=True)
class Damping(Checked):
    """λ² = constant² + per_error ‖e‖² + singular² (1 - w / threshold)² where w < threshold.

    w is the manipulability, √det(J Jᵀ) of a whole pose (Nakamura and Hanafusa, "Inverse kinematic
    solutions with singularity robustness for robot manipulator control", 1986); the law of the
    error is that of Sugihara, "Solvability-unconcerned inverse kinematics by the
    Levenberg-Marquardt method", 2011.
    """

    constant: NotNegative = 0.0
    """λ at no error, far from singularities [m or rad per rad]."""
    per_error: NotNegative = 0.0
    """λ² per squared error."""
    singular: NotNegative = 0.0
    """λ at a singularity."""
    threshold: NotNegative = 0.05
    """Manipulability below which a configuration counts as nearly singular."""

    def squared(self, J: Matrix, squared_error: float, asked: int | None = None) -> float:
        """Return λ².

        Args:
            J: The Jacobian (rows, n).
            squared_error: What is left of the error.
            asked: Degrees of freedom that are asked for, where rows of J stand for none: w is the
                product of so many singular values, the largest. None: of as many as rows.
        """
        found = self.constant**2 + self.per_error * squared_error
        if self.singular > 0.0:
            w = float(np.prod(np.linalg.svd(J, compute_uv=False)[:asked]))
            if w < self.threshold:
                found += (self.singular * (1.0 - w / self.threshold)) ** 2
        return found


def clamped(e: Vector, longest: float, widest: float) -> Vector:
    """Return an error with its displacement and its rotation no longer than a bound each.

    Buss and Kim, "Selectively damped least squares for inverse kinematics", 2005. The first three
    of six numbers are the displacement; of three, all.
    """
    found = e.copy()
    for part, most in ((slice(3), longest), (slice(3, None), widest)):
        size = sqrt(found[part].dot(found[part]))
        if size > most:
            found[part] *= most / size
    return found
