"""Default ratings of a robot, computed from its masses, joint ranges and motors.

They keep a simulated arm within the power of its motors. Give the manufacturer's ratings where
they are known.
"""

import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.model.arm import Arm
from robo47_qp.model.mjcf import implicit_inertia
from robo47_qp.model.robot import MotionProfile
from robo47_qp.model.sampling import spread

RANGE_TIME = 1.5
"""Time in which a joint at its rated speed crosses its range [s]."""
SPEED_MAX, SLIDE_SPEED_MAX = np.pi, 1.0
"""Rated speed at most: of joints that turn [rad/s], of those that slide [m/s]."""
RATED_RISE_TIME, PROFILE_RISE_TIME = 0.1, 0.5
"""Shortest time from rest to full speed, as rated and as used by default [s]."""
RATED_JERK_TIME, PROFILE_JERK_TIME = 0.02, 0.25
"""Shortest time from no acceleration to the full one, as rated and as used by default [s]."""
TORQUE_RISE_TIME = 0.05
"""Time in which a motor goes from no torque to its limit [s]."""
DRAG_SHARE = 0.5
"""Share of the torque left by gravity that drag may take at the rated speed [-]."""
PROFILE_SHARE = 0.9
"""Share of rated speed and acceleration that motions use by default: what is measured on the way
exceeds what was asked for by the tracking error [-]."""
GRAVITY_FACTOR = 2.0
"""Torque limit where the file has none, as a multiple of the largest gravity torque [-]."""
TORQUE_SHARE = 0.7
"""Share of the torque left by gravity that the rated acceleration may use [-]."""
DEFLECTION = 0.02
"""Deflection of a joint under a tenth of its torque limit [rad or m]."""
LEAST_TORQUE_SHARE = 0.05
"""Least torque limit where the file has none, as a share of the largest of its kind [-]."""
DAMPING_RATE = 1.0
"""Largest damping rate of the joint impedance times the control period: no overshoot [-]."""
_SAMPLES = 64


def torque_limits(arm: Arm) -> Vector:
    """Return torque limits (n,): twice the largest gravity torque, and more to accelerate [N·m]."""
    M, g = arm.derived(inertia_and_gravity)
    # A vertical axis carries no weight: it gets the torque that reaches full speed in time.
    start = M.diagonal(axis1=1, axis2=2).max(axis=0) * _speeds(arm) / RATED_RISE_TIME
    weight, friction = g.max(axis=0), arm.model.dof_frictionloss
    limits: Vector = GRAVITY_FACTOR * weight + start + _drag(arm)
    damping = _drag(arm) - friction
    limits = np.maximum(limits, weight + friction + damping / DRAG_SHARE)
    slides = np.array(arm.robot.units) == "m"
    for kind in (slides, ~slides):
        if kind.any():
            # The last joints carry almost no weight until the tool holds an object.
            limits[kind] = np.maximum(limits[kind], LEAST_TORQUE_SHARE * limits[kind].max())
    return limits


def rated_profile(arm: Arm, tau_max: Vector) -> MotionProfile:
    """Return speeds from the joint ranges and accelerations from the torque limits.

    Where damping would take more than DRAG_SHARE of the torque that gravity and dry friction
    leave, the joint is slower.

    With a_i the least of TORQUE_SHARE (τ_max,i - |g_i| - d_i) / M_ii over configurations, d the
    drag at full speed, and no more than full speed in RATED_RISE_TIME takes, all joints are
    slowed together until Σ_j |M_ij| a_j is no more than TORQUE_SHARE (τ_max,i - |g_i| - d_i) in
    every one.
    """
    M, g = arm.derived(inertia_and_gravity)
    v_max = _speeds(arm)
    damping, friction = arm.model.dof_damping, arm.model.dof_frictionloss
    # At least a tenth of the limit counts as left, here and below.
    free = np.maximum(tau_max - g.max(axis=0) - friction, 0.1 * tau_max)
    damped = damping > 0.0
    v_max[damped] = np.minimum(v_max, DRAG_SHARE * free / np.where(damped, damping, 1.0))[damped]
    drag = damping * v_max + friction
    left = TORQUE_SHARE * np.maximum(tau_max - g - drag, 0.1 * tau_max)
    a_max = (left / M.diagonal(axis1=1, axis2=2)).min(axis=0)
    # Before the joints are slowed together: a wrist without rotors could do thousands of rad/s².
    a_max = np.minimum(a_max, v_max / RATED_RISE_TIME)
    a_max *= min(1.0, float((left / (np.abs(M) @ a_max)).min()))
    return MotionProfile(v_max=v_max, a_max=a_max, j_max=a_max / RATED_JERK_TIME)


def default_profile(rated: MotionProfile) -> MotionProfile:
    """Return the profile used by default: almost full speed, moderate acceleration and jerk."""
    v_max = PROFILE_SHARE * rated.v_max
    a_max = np.minimum(PROFILE_SHARE * rated.a_max, v_max / PROFILE_RISE_TIME)
    j_max = np.minimum(rated.j_max, a_max / PROFILE_JERK_TIME)
    return MotionProfile(v_max=v_max, a_max=a_max, j_max=j_max)


def profile_at_ratings(rated: MotionProfile) -> MotionProfile:
    """Return PROFILE_SHARE of the ratings."""
    bounds = (rated.v_max, rated.a_max, rated.j_max)
    v_max, a_max, j_max = (PROFILE_SHARE * bound for bound in bounds)
    return MotionProfile(v_max=v_max, a_max=a_max, j_max=j_max)


def torque_rates(tau_max: Vector) -> Vector:
    """Return torque-rate limits (n,) [N·m/s]."""
    return tau_max / TORQUE_RISE_TIME


def stiffness(arm: Arm, tau_max: Vector, period: float) -> Vector:
    """Return joint stiffness (n,) that is stable at a control period [N·m/rad].

    As stiff as DEFLECTION requires, but soft enough for discrete time: with the damping
    D = 2 √(K M_ii) of a critically damped joint, the fastest rate of M(q)⁻¹ D stays below
    DAMPING_RATE / period in every configuration; explicit steps diverge at 2 / period.
    """
    M, _ = arm.derived(inertia_and_gravity)
    # Joint damping is integrated implicitly, where it acts like inertia.
    M = M + np.diag(period * arm.model.dof_damping - implicit_inertia(arm.model))
    home = np.diag(arm.mass_matrix(arm.home))
    fastest = DAMPING_RATE / period
    # The smallest inertia of a joint: with all others free to move.
    lightest = 1.0 / np.linalg.inv(M).diagonal(axis1=1, axis2=2).max(axis=0)
    K: Vector = np.minimum(0.1 * tau_max / DEFLECTION, (fastest * lightest / 2.0) ** 2 / home)
    D = 2.0 * np.sqrt(K * home)
    # M⁻¹ D is similar to a symmetric matrix: its rates are real.
    root = np.sqrt(D)
    rates = np.linalg.eigvalsh(root[:, None] * np.linalg.inv(M) * root)
    return K / max(1.0, float(rates.max()) / fastest) ** 2


def _speeds(arm: Arm) -> Vector:
    caps = [SLIDE_SPEED_MAX if unit == "m" else SPEED_MAX for unit in arm.robot.units]
    speeds: Vector = np.minimum((arm.q_high - arm.q_low) / RANGE_TIME, caps)
    return speeds


def _drag(arm: Arm) -> Vector:
    """Return the torque of damping at full speed and of dry friction (n,) [N·m]."""
    drag: Vector = arm.model.dof_damping * _speeds(arm) + arm.model.dof_frictionloss
    return drag


def inertia_and_gravity(arm: Arm) -> tuple[Matrix, Matrix]:
    """Return M (N, n, n) and |gravity torques| (N, n) in configurations over the joint ranges."""
    still = np.zeros(arm.n)
    qs = [arm.home, *spread(arm.q_low, arm.q_high, _SAMPLES)]
    M = np.array([arm.mass_matrix(q) for q in qs])
    g = np.array([arm.inverse_dynamics(q, still, still) for q in qs])
    return M, np.abs(g)
