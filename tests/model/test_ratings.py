"""Defaults keep an arm within what its own masses and motors allow."""

from dataclasses import replace

import numpy as np
import pytest

from robo47_qp.model import ratings as defaults
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import MotionProfile
from robo47_qp.model.robots.panda import PANDA
from tests.plain_arm import PlainArm

DT = 1e-3


def test_the_default_torques_lift_the_arm_wherever_it_is(arm: Arm, plain: PlainArm) -> None:
    limits = defaults.torque_limits(arm)
    rng = np.random.default_rng(2)
    for q in rng.uniform(arm.q_min, arm.q_max, (40, arm.n)):
        assert (1.5 * np.abs(plain.gravity_torque(q)) <= limits).all()
    turning = np.array(arm.robot.units) == "rad"
    assert (limits[turning] >= 0.0499 * limits[turning].max()).all()


def test_the_rated_acceleration_is_within_the_motors_strength(arm: Arm) -> None:
    limits = defaults.torque_limits(arm)
    rated = defaults.rated_profile(arm, limits)
    rng, still = np.random.default_rng(3), np.zeros(arm.n)
    for q in rng.uniform(arm.q_min, arm.q_max, (200, arm.n)):
        a = rng.choice([-1.0, 1.0], arm.n) * rated.a_max
        assert (np.abs(arm.inverse_dynamics(q, still, a)) <= limits).all()


def test_what_gravity_and_drag_take_accelerates_nothing(arm: Arm) -> None:
    """Motors that are hardly strong enough to hold the arm."""
    rng, still = np.random.default_rng(4), np.zeros(arm.n)
    qs = rng.uniform(arm.q_min, arm.q_max, (300, arm.n))
    held = np.abs([arm.inverse_dynamics(q, still, still) for q in qs]).max(axis=0)
    limits = 1.3 * np.maximum(held, 0.05 * held.max())
    a_max = defaults.rated_profile(arm, limits).a_max
    for q in qs:
        a = rng.choice([-1.0, 1.0], arm.n) * a_max
        assert (np.abs(arm.inverse_dynamics(q, still, a)) <= limits).all()


def test_twice_the_strength_is_more_acceleration_and_never_less() -> None:
    arm = Arm(PANDA)
    weak, strong = (defaults.rated_profile(arm, k * PANDA.tau_max) for k in (1.0, 2.0))
    assert (strong.a_max > 1.2 * weak.a_max).sum() >= 3
    assert (strong.a_max >= weak.a_max).all()
    assert strong.v_max.tolist() == weak.v_max.tolist()


def test_speeds_cross_the_range_in_the_time_named_and_are_capped_by_kind(arm: Arm) -> None:
    v_max = defaults.rated_profile(arm, defaults.torque_limits(arm)).v_max
    for v, low, high, unit in zip(v_max, arm.q_min, arm.q_max, arm.robot.units, strict=True):
        cap = 1.0 if unit == "m" else np.pi
        assert v == pytest.approx(min(cap, (high - low) / 1.5))


def test_a_joint_that_damping_would_stall_is_slower() -> None:
    """Of a twentieth of the Panda's torque, half of what gravity leaves goes to damping."""
    arm = Arm(replace(PANDA, home=np.array([0.0, 0.0, 0.0, -0.1, 0.0, 0.0, 0.0])))
    tau_max = np.array([2.0, 200.0, 200.0, 200.0, 20.0, 20.0, 0.4])
    slow = defaults.rated_profile(arm, tau_max)
    assert slow.v_max[0] == pytest.approx(0.5 * 2.0 / 1.0, rel=0.02)  # damping 1, no gravity
    assert slow.v_max[6] < 0.3
    assert slow.v_max[1] == defaults.rated_profile(arm, 2.0 * tau_max).v_max[1]


def test_a_wrist_without_rotors_does_not_slow_the_shoulder_down() -> None:
    """Of an arm with light wrists, capped before all joints are slowed together."""
    arm = Arm(replace(PANDA, armature=np.array([0.1, 0.1, 0.1, 0.1, 0.0, 0.0, 0.0])))
    with_rotors = defaults.rated_profile(Arm(PANDA), PANDA.tau_max).a_max
    assert (defaults.rated_profile(arm, PANDA.tau_max).a_max[:4] > 0.7 * with_rotors[:4]).all()


def test_a_gentle_profile_stays_below_what_is_rated() -> None:
    rated = MotionProfile(
        v_max=np.array([1.0, 2.0]), a_max=np.array([0.5, 100.0]), j_max=np.array([0.1, 1e4])
    )
    gentle = defaults.default_profile(rated)
    np.testing.assert_allclose(gentle.v_max, [0.9, 1.8])
    np.testing.assert_allclose(gentle.a_max, [0.45, 3.6])
    np.testing.assert_allclose(gentle.j_max, [0.1, 14.4])


def test_the_default_stiffness_is_stable_all_over_the_workspace(arm: Arm) -> None:
    """Explicit steps diverge where a rate of M⁻¹D exceeds two per period."""
    K = defaults.stiffness(arm, arm.robot.tau_max, DT)
    D = np.diag(2.0 * np.sqrt(K * np.diag(arm.mass_matrix(arm.home))))
    B = DT * np.diag(arm.model.dof_damping)
    rng = np.random.default_rng(9)
    for q in rng.uniform(arm.q_min, arm.q_max, (300, arm.n)):
        rates = np.abs(np.linalg.eigvals(np.linalg.solve(arm.mass_matrix(q) + B, D)))
        assert DT * rates.max() < 1.5
    assert (K > 0.0).all()
    assert (5.0 * arm.robot.tau_max * (1 + 1e-9) >= K).all()


def test_a_longer_period_asks_for_a_softer_arm(arm: Arm) -> None:
    fast, slow = (defaults.stiffness(arm, arm.robot.tau_max, dt) for dt in (1e-3, 0.2))
    assert (slow < fast).any()
