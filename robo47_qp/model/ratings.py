"""What a robot's file does not tell, computed from its masses, its ranges and its motors.

These are defaults, not a manufacturer's figures: they keep a simulated arm within what its own
motors can do. Give the real ones where they are known.
"""

from functools import lru_cache

import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import MotionProfile

CROSSING = 1.5
"""Time in which a joint at its rated speed crosses its range [s]."""
SPEED_MAX, SLIDE_SPEED_MAX = np.pi, 1.0
"""Rated speed at most: of joints that turn [rad/s], of those that slide [m/s]."""
RATED_RISE, PROFILE_RISE = 0.1, 0.5
"""Shortest time from rest to full speed, as rated and as used by default [s]."""
RATED_ONSET, PROFILE_ONSET = 0.02, 0.25
"""Shortest time from no acceleration to the full one, as rated and as used by default [s]."""
TORQUE_RISE = 0.05
"""Time in which a motor goes from no torque to its limit [s]."""
LIFTING = 2.0
"""Torque limit where the file has none, per largest torque of gravity [-]."""
RESERVE = 0.7
"""Part of the torque that gravity leaves which the rated acceleration may use [-]."""
SAG = 0.02
"""How far a joint gives way under a tenth of its torque limit [rad or m], at most as soft."""
FAINTEST = 0.05
"""Least torque limit where the file has none, per largest limit of its kind [-]."""
PACE = 1.0
"""Largest damping rate of the joint impedance times the control period: no overshoot [-]."""
_SAMPLES = 64


def torque_limits(arm: Arm) -> Vector:
    """Torques (n,) that lift the arm everywhere with as much again to move it [N·m]."""
    M, g = _inertia_and_gravity(arm)
    # A vertical axis carries nothing: it gets what brings it up to speed in the rated time.
    start = M.diagonal(axis1=1, axis2=2).max(axis=0) * _speeds(arm) / RATED_RISE
    limits: Vector = LIFTING * g.max(axis=0) + start + _drag(arm)
    slides = np.array(arm.robot.units) == "m"
    for kind in (slides, ~slides):
        if kind.any():
            # The last joints carry next to nothing until the tool holds something.
            limits[kind] = np.maximum(limits[kind], FAINTEST * limits[kind].max())
    return limits


def rated_profile(arm: Arm, tau_max: Vector) -> MotionProfile:
    """Speeds by the ranges of the joints, accelerations by what the motors can do.

    With a_i the least of RESERVE (τ_max,i - |g_i| - d_i) / M_ii over configurations, d the drag
    at full speed, all joints are slowed together until Σ_j |M_ij| a_j is no more than
    RESERVE (τ_max,i - |g_i| - d_i) in every one.
    """
    v_max = _speeds(arm)
    M, g = _inertia_and_gravity(arm)
    # Where the motor has nothing to spare, a tenth of it is taken to be left.
    left = RESERVE * np.maximum(tau_max - g - _drag(arm), 0.1 * tau_max)
    a_max = (left / M.diagonal(axis1=1, axis2=2)).min(axis=0)
    a_max *= min(1.0, float((left / (np.abs(M) @ a_max)).min()))
    a_max = np.minimum(a_max, v_max / RATED_RISE)
    return MotionProfile(v_max=v_max, a_max=a_max, j_max=a_max / RATED_ONSET)


def gentle(rated: MotionProfile) -> MotionProfile:
    """The profile to use where none is asked for: full speed, reached without haste."""
    a_max = np.minimum(rated.a_max, rated.v_max / PROFILE_RISE)
    j_max = np.minimum(rated.j_max, a_max / PROFILE_ONSET)
    return MotionProfile(v_max=rated.v_max, a_max=a_max, j_max=j_max)


def torque_rates(tau_max: Vector) -> Vector:
    """Torque-rate limits (n,) [N·m/s]."""
    return tau_max / TORQUE_RISE


def stiffness(arm: Arm, tau_max: Vector, period: float) -> Vector:
    """Joint stiffness (n,) that a controller of this period holds still with [N·m/rad].

    As stiff as SAG asks for, but soft enough for discrete time: with the damping
    D = 2 √(K M_ii) of a critically damped joint, the fastest rate of M(q)⁻¹ D stays below
    PACE / period in every configuration, two being where explicit steps diverge.
    """
    M, _ = _inertia_and_gravity(arm)
    # Damping in the joints is integrated implicitly, where it acts like inertia.
    M = M + period * np.diag(arm.model.dof_damping)
    home = np.diag(arm.mass_matrix(arm.home))
    fastest = PACE / period
    # The lightest a joint ever is: with all others free to move.
    lightest = 1.0 / np.linalg.inv(M).diagonal(axis1=1, axis2=2).max(axis=0)
    K: Vector = np.minimum(0.1 * tau_max / SAG, (fastest * lightest / 2.0) ** 2 / home)
    D = 2.0 * np.sqrt(K * home)
    # M⁻¹ D is similar to a symmetric matrix: its rates are real.
    root = np.sqrt(D)
    rates = np.linalg.eigvalsh(root[:, None] * np.linalg.inv(M) * root)
    return K / max(1.0, float(rates.max()) / fastest) ** 2


def _speeds(arm: Arm) -> Vector:
    caps = [SLIDE_SPEED_MAX if unit == "m" else SPEED_MAX for unit in arm.robot.units]
    speeds: Vector = np.minimum((arm.q_max - arm.q_min) / CROSSING, caps)
    return speeds


def _drag(arm: Arm) -> Vector:
    """Torque of damping at full speed and of dry friction (n,) [N·m]."""
    drag: Vector = arm.model.dof_damping * _speeds(arm) + arm.model.dof_frictionloss
    return drag


@lru_cache(maxsize=4)
def _inertia_and_gravity(arm: Arm) -> tuple[Matrix, Matrix]:
    """M (N, n, n) and sizes of the torques of gravity (N, n), spread over the joint ranges."""
    # An additive recurrence: evenly spread, the same every time (Roberts, 2018).
    root = 2.0
    for _ in range(64):
        root = (1.0 + root) ** (1.0 / (arm.n + 1))
    steps = np.arange(1, _SAMPLES + 1)[:, None] * root ** -np.arange(1.0, arm.n + 1)
    spread = arm.q_min + np.mod(0.5 + steps, 1.0) * (arm.q_max - arm.q_min)
    still = np.zeros(arm.n)
    qs = [arm.home, *spread]
    M = np.array([arm.mass_matrix(q) for q in qs])
    g = np.array([arm.inverse_dynamics(q, still, still) for q in qs])
    return M, np.abs(g)
