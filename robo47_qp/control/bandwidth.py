"""Bandwidths at which an observer may follow noisy positions, by the inertia that joints bear."""

from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov
from scipy.optimize import brentq

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.control.joint_filter import gains
from robo47_qp.model.arm import Arm
from robo47_qp.model.sampling import spread

_FEEDBACK = 30.0
"""Natural frequency of the feedback through which the noise comes to the motors [rad/s]."""
_DEVIATIONS = 7.0
"""Standard deviations of the change of a torque in a period that make its rate limit."""
_SAMPLES, _HEAVY = 32, 80.0
"""Configurations in which the noise is looked at; and the percentile of inertias
for which the torque rate is kept."""
_ROUNDS, _LOUD = 50, 0.1
"""Rounds of lowering the noise, in joints that make this share of a torque's variance."""
_STILL = 5e-4
"""Standard deviation of the velocity with which noise moves a joint that rests [rad/s]."""
_LEAST = 1e-3
"""Least part of the largest bandwidth that is usual, however loud the noise is [-]."""
_STEP, _STEPS = 0.95, 24
"""From one step of lower bandwidths to the next [-], and how many there are."""


class Bandwidths:
    """The bandwidth of every joint's filter, for the configuration and the speed of the arm.

    Errors of the measured positions become accelerations by feedback and compensation, and torques
    by the mass matrix. What is usual keeps the torque rates at rest in four of five configurations;
    where the arm is stretched and its inertia larger than that, or where jitter adds its part to
    the noise because joints are fast, bandwidths are lower, by steps. While joints rest, theirs
    are as low as noise needs not to shake them.
    """

    def __init__(
        self, arm: Arm, bandwidth: float, noise_q: float, dt: float, *, jitter: float = 0.0
    ) -> None:
        """Find what is usual.

        Args:
            arm: The belief.
            bandwidth: Largest bandwidth [rad/s].
            noise_q: Standard deviation of measured positions [rad].
            dt: Control period [s].
            jitter: Standard deviation of the time by which all positions are late [s].
        """
        self.usual: Vector = arm.derived(_usual, bandwidth, noise_q, dt)
        """Bandwidths in usual configurations (n,) [rad/s]."""
        self._errors, self._dt = _Errors(noise_q, jitter), dt
        self._allowed = _allowed(arm, dt)
        self._gains = np.array([_gain(omega, dt) for omega in self.usual])
        self.at_rest: Vector = np.array([_still(float(w), noise_q, dt) for w in self.usual])
        """Bandwidths while the reference rests (n,) [rad/s]."""

    def at(self, arm: Arm, q: Vector, v: Vector, *, rests: NDArray[np.bool_]) -> Vector:
        """Return the bandwidths at a state q, v (n,) [rad/s], by the inertias of an arm.

        Args:
            arm: The belief.
            q: Positions of the reference (n,) [rad].
            v: Its velocities (n,) [rad/s].
            rests: Which joints have been where they are to rest for a while (n,).
        """
        if not any(self._errors):
            return self.usual
        gains_now = _lowered(arm.mass_matrix(q), self._gains, v, self._errors, self._allowed)
        now = self.usual.copy()
        for j in np.flatnonzero(gains_now < self._gains):
            steps = _steps(float(self.usual[j]), self._dt)
            quiet = steps[:, 1] <= gains_now[j]
            now[j] = steps[quiet, 0].max(initial=steps[-1, 0])
        return np.where(rests, np.minimum(now, self.at_rest), now)


class _Errors(NamedTuple):
    """Standard deviations of errors of measured positions."""

    noise: float
    """Of each joint's own [rad]."""
    jitter: float
    """Of the time by which all are late [s]."""


def _gain(omega: float, dt: float) -> float:
    """Return the acceleration that feedback and compensation make of an error of q, per rad."""
    q, v, d = gains(omega, dt).tolist()
    return float(_FEEDBACK**2 * q + 2.0 * _FEEDBACK * v + d)


@lru_cache(maxsize=64)
def _steps(omega: float, dt: float) -> Matrix:
    """Return lower and lower bandwidths and their gains, as rows of both."""
    return np.array([[w := omega * _STEP**k, _gain(w, dt)] for k in range(_STEPS)])


@lru_cache(maxsize=64)
def _still(omega: float, noise_q: float, dt: float) -> float:
    """Return the largest bandwidth, up to one, at which noise lets a joint rest [rad/s]."""
    steps = (omega * _STEP**k for k in range(2 * _STEPS))
    return next((w for w in steps if noise_q * _shaking(w, dt) <= _STILL), omega * _STEP**_STEPS)


def _shaking(omega: float, dt: float) -> float:
    """Return the standard deviation of the velocity of a joint at rest per that of noise [1/s].

    Of the joint as a mass with feedback of what is estimated, by the Lyapunov equation.
    """
    G = gains(omega, dt)
    to_q, to_v = np.array([dt * dt, dt])
    # q and v of the joint, then its estimates of q, v, d.
    feedback = -np.array([0.0, 0.0, _FEEDBACK**2, 2.0 * _FEEDBACK, 1.0])
    F = np.zeros((5, 5))
    F[:2, :2] = F[2:4, 2:4] = [[1.0, dt], [0.0, 1.0]]
    F[:2] += np.outer([to_q, to_v], feedback)
    F[2:4] += np.outer([to_q, to_v], feedback)
    F[2:4, 4] += [to_q, to_v]
    F[4, 4] = 1.0
    F[2:] += np.outer(G, F[0] - F[2])
    noise = np.concatenate([np.zeros(2), G])
    variance = solve_discrete_lyapunov(F, np.outer(noise, noise), method="bilinear")
    return float(np.sqrt(variance[1, 1]))


def _allowed(arm: Arm, dt: float) -> Vector:
    """Return the standard deviation of the change of every torque that is let be (n,) [N·m]."""
    allowed: Vector = arm.robot.tau_rate_max * dt / _DEVIATIONS
    return allowed


def _lowered(M: Matrix, gains_usual: Vector, v: Vector, errors: _Errors, allowed: Vector) -> Vector:
    """Return gains (n,) from positions to accelerations that leave the torques be.

    They are lowered in the joints that are loud in a torque that is not let be.

    Args:
        M: Mass matrix (n, n).
        gains_usual: Gains to begin with (n,) [1/s²].
        v: Velocities (n,) [rad/s].
        errors: Of the positions.
        allowed: Standard deviations that are let be of the torques (n,) [N·m].
    """
    g = gains_usual.copy()
    each = M**2 * (errors.noise**2 + (errors.jitter * v) ** 2)
    for _ in range(_ROUNDS):
        # Jitter moves all positions at once, noise each for itself.
        total = (M * g) ** 2 @ np.full(len(g), errors.noise**2) + (errors.jitter * M @ (g * v)) ** 2
        over = np.maximum(1.0, np.sqrt(total) / allowed)[:, None]
        if (over == 1.0).all():
            break
        g /= np.where(each * g**2 > _LOUD * total[:, None], over, 1.0).max(axis=0)
    return g


def _usual(arm: Arm, bandwidth: float, noise_q: float, dt: float) -> Vector:
    """Return the largest bandwidths at which noise leaves the torque rates be (n,) [rad/s]."""
    omegas = np.full(arm.n, bandwidth)
    if not noise_q:
        return omegas
    qs = [arm.home, *spread(arm.q_low, arm.q_high, _SAMPLES)]
    M = np.percentile(np.abs([arm.mass_matrix(q) for q in qs]), _HEAVY, axis=0)
    most_gains = np.full(arm.n, _gain(bandwidth, dt))
    quiet = _lowered(M, most_gains, np.zeros(arm.n), _Errors(noise_q, 0.0), _allowed(arm, dt))
    for i, most in enumerate(quiet):
        if most < _gain(bandwidth, dt):
            excess = partial(_excess, most=most, dt=dt)
            low = _LEAST * bandwidth
            # What is louder still gets the least there is.
            omegas[i] = low if excess(low) >= 0.0 else brentq(excess, low, bandwidth)
    return omegas


def _excess(omega: float, most: float, dt: float) -> float:
    return _gain(omega, dt) - most
