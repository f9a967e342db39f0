"""The cart-pole: textbook equations, an independent Riccati iteration, and what balances."""

import json
from io import StringIO
from pathlib import Path

import mujoco
import numpy as np
import pytest
from rich.console import Console
from scipy.integrate import solve_ivp

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.cli import FAILED, OK
from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.benchmarks.settling.settling import settling_time
from scenarios.cartpole_lqr import (
    MJCF,
    TOLERABLE,
    TOLERABLE_FORCE,
    CartPoleOptions,
    balanced,
    error,
    linearised,
    lqr_gain,
    run,
)

CART, POLE, ARM, MOMENT, G, DT = 1.0, 0.1, 0.5, 0.0083333, 9.81, 0.005
"""Masses [kg], pole's centre from the hinge [m], its inertia about it [kg·m²], period [s]."""
Q, R = np.diag(1 / TOLERABLE**2), np.array([[1 / TOLERABLE_FORCE**2]])


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MJCF)


@pytest.fixture(scope="module")
def gain(model: mujoco.MjModel) -> Matrix:
    return lqr_gain(*linearised(model), Q, R)


def accelerations(theta: float, theta_rate: float, force: float) -> Vector:
    """Lagrange's equations of the frictionless cart-pole, the pole's angle from upright."""
    s, c = np.sin(theta), np.cos(theta)
    M = np.array([[CART + POLE, POLE * ARM * c], [POLE * ARM * c, MOMENT + POLE * ARM**2]])
    right = np.array([force + POLE * ARM * s * theta_rate**2, POLE * G * ARM * s])
    solution: Vector = np.linalg.solve(M, right)
    return solution


def test_the_linearisation_is_that_of_the_textbook(model: mujoco.MjModel) -> None:
    M = np.array([[CART + POLE, POLE * ARM], [POLE * ARM, MOMENT + POLE * ARM**2]])
    stiffness = np.linalg.solve(M, np.diag([0.0, POLE * G * ARM]))
    push = np.linalg.solve(M, [[1.0], [0.0]])
    # Semi-implicit Euler: v' = v + DT (stiffness q + push u), q' = q + DT v'.
    eye = np.eye(2)
    A = np.block([[eye + DT**2 * stiffness, DT * eye], [DT * stiffness, eye]])
    B = np.vstack([DT**2 * push, DT * push])
    found_A, found_B = linearised(model)
    np.testing.assert_allclose(found_A, A, atol=1e-8)
    np.testing.assert_allclose(found_B, B, atol=1e-8)
    assert np.abs(np.linalg.eigvals(found_A)).max() > 1.01


def test_the_gain_is_that_of_value_iteration(model: mujoco.MjModel, gain: Matrix) -> None:
    A, B = linearised(model)
    P, K = np.zeros((4, 4)), np.zeros((1, 4))
    for _ in range(20000):
        K = np.linalg.inv(R + B.T @ P @ B) @ (B.T @ P @ A)
        P, before = Q + A.T @ P @ (A - B @ K), P
        if np.abs(P - before).max() < 1e-12 * np.abs(P).max():
            break
    np.testing.assert_allclose(gain, K, rtol=1e-6)
    assert np.abs(np.linalg.eigvals(A - B @ gain)).max() < 0.999


def test_no_gain_nearby_costs_less(
    model: mujoco.MjModel, gain: Matrix, rng: np.random.Generator
) -> None:
    A, B = linearised(model)

    def cost(K: Matrix) -> float:
        x, total = np.array([0.3, 0.1, -0.2, 0.1]), 0.0
        for _ in range(4000):
            u = -K @ x
            total += float(x @ Q @ x + u @ R @ u)
            x = A @ x + B @ u
        return total

    best = cost(gain)
    for _ in range(8):
        assert cost(gain * (1 + 0.1 * rng.standard_normal(gain.shape))) > best


def test_the_balanced_motion_is_that_of_lagrange_s_equations(
    model: mujoco.MjModel, gain: Matrix
) -> None:
    """The nonlinear motion beside the equations above, integrated finely, force held per step."""
    start = np.array([0.2, 0.19])
    states, force = balanced(model, gain, start, 3.0)
    y = np.array([*start, 0.0, 0.0])
    path = [y]
    for _ in range(len(force)):
        u = float(np.clip(-(gain @ y)[0], -20.0, 20.0))
        done = solve_ivp(
            lambda _, s, u=u: [s[2], s[3], *accelerations(s[1], s[3], u)],
            (0.0, DT),
            y,
            rtol=1e-8,
            atol=1e-10,
        )
        y = done.y[:, -1]
        path.append(y)
    # MuJoCo's integrator is of first order: a step of 5 ms leaves some millimetres.
    np.testing.assert_allclose(states[:, :2], np.array(path)[:, :2], atol=0.02)
    times = [settling_time(error(x), DT) for x in (states, np.array(path))]
    assert times[0] == pytest.approx(times[1], rel=0.02)


def test_small_starts_follow_the_linear_closed_loop(model: mujoco.MjModel, gain: Matrix) -> None:
    A, B = linearised(model)
    states, force = balanced(model, gain, np.array([1e-3, -2e-3]), 6.0)
    x = states[0]
    assert x.tolist() == [1e-3, -2e-3, 0.0, 0.0]
    for k, state in enumerate(states):
        np.testing.assert_allclose(state, x, atol=2e-6)
        if k < len(force):
            assert force[k] == pytest.approx(-(gain @ state)[0])
        x = (A - B @ gain) @ x
    assert error(states[-1:])[0] < 1e-3 * error(states[:1])[0]


def test_the_force_is_that_of_the_motor(model: mujoco.MjModel, gain: Matrix) -> None:
    _, force = balanced(model, gain, np.array([0.5, 0.3]), 1.0)
    assert np.abs(force).max() == 20.0


def test_without_a_gain_the_pole_falls(model: mujoco.MjModel) -> None:
    states, _ = balanced(model, np.zeros((1, 4)), np.array([0.0, 0.05]), 3.0)
    assert np.abs(states[:, 1]).max() > 2.0
    assert settling_time(error(states), DT) == np.inf


def test_the_error_weighs_place_and_angle() -> None:
    states = np.array([[0.5, 0.0, 9.0, 9.0], [0.0, -0.2, 0.0, 0.0], [0.3, 0.16, 5.0, 0.0]])
    np.testing.assert_allclose(error(states), [1.0, 1.0, 1.0])


def test_a_run_reports_and_is_the_same_again_and_another_with_another_seed(
    tmp_path: Path,
) -> None:
    console = Console(file=StringIO())
    texts = []
    for seed in (0, 0, 1):
        path = tmp_path / "report.json"
        assert run(CartPoleOptions(starts=3, seed=seed, report=path), console) == OK
        report = json.loads(path.read_text())
        del report["machine"]  # tells how busy it was
        texts.append(json.dumps(report))
    assert texts[0] == texts[1]
    report, other = json.loads(texts[0]), json.loads(texts[2])
    assert set(report["settling_times_s"]).isdisjoint(other["settling_times_s"])
    assert max(report["closed_loop"]) < 1.0
    assert 1.0 < report["metrics"]["mean_settling_time_s"] < 5.0


def test_a_pole_that_cannot_be_saved_fails_the_run(tmp_path: Path) -> None:
    options = CartPoleOptions(starts=5, pole=1.5, seconds=5.0, report=tmp_path / "report.json")
    assert run(options, Console(file=StringIO())) == FAILED
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("choice", "value"), [("cart", 0.0), ("pole", 1.6), ("pole", np.nan)])
def test_starts_out_of_range_are_told(choice: str, value: float) -> None:
    with pytest.raises(InvalidValueError, match=f"--{choice} must be above 0 and at most"):
        CartPoleOptions(**{choice: value})  # type: ignore[arg-type]
