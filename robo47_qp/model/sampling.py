"""Configurations spread evenly over the joint limits, the same for every call."""

import numpy as np

from robo47_qp.arrays import Matrix, Vector


def spread(q_min: Vector, q_max: Vector, count: int) -> Matrix:
    """Points of shape (count, n) inside a box; the first of many are those of few.

    An additive recurrence, x_k = frac(½ + k α) with α_i = φ⁻ⁱ and φ the positive root of
    x^(n+1) = x + 1 (Roberts, "The unreasonable effectiveness of quasirandom sequences",
    2018). No random numbers.
    """
    n = len(q_min)
    root = 2.0
    for _ in range(64):
        root = (1.0 + root) ** (1.0 / (n + 1))
    alpha = root ** -np.arange(1.0, n + 1)
    unit = np.mod(0.5 + np.arange(1, count + 1)[:, None] * alpha, 1.0)
    # Rounding at an upper limit must not leave it.
    return np.minimum(q_min + unit * (q_max - q_min), q_max)
