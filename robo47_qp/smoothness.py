"""Smoothness of a motion."""

import numpy as np

from robo47_qp.arrays import Matrix

_STILL = 1e-3
"""What is never faster does not move [m/s]."""


def smoothness(v: Matrix, jerk: Matrix, period: float) -> float | None:
    """Log dimensionless jerk: the higher, the smoother; whatever the way and the time [-].

    LDLJ = -ln(T³ / v_peak² ∫ |jerk|² dt), with T the duration and v_peak the highest speed: the
    dimensionless jerk of Hogan and Sternad (J. Motor Behavior 41(6), 2009) and its logarithm
    of Balasubramanian et al. ("On the analysis of movement smoothness", J. NeuroEngineering
    and Rehabilitation 12:112, 2015). A minimum-jerk motion has -ln(204.8) = -5.32.

    Args:
        v: Velocities (N, 3) [m/s].
        jerk: Jerks at the same instants (N, 3) [m/s³].
        period: Time between them [s].

    Returns:
        None where nothing moves.
    """
    if not len(v):
        return None
    peak = float(np.linalg.norm(v, axis=1).max())
    if peak < _STILL:
        return None
    squares = float((jerk**2).sum() * period)
    return -float(np.log((len(v) * period) ** 3 / peak**2 * squares))
