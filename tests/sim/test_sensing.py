"""Sensors with errors, by statistics and against filters of scipy."""

from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from robo47_qp.model.robot import Robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.robots.panda_pair import panda_pair
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.sim.sensing import ForceSensor, GaussMarkov, SensorErrors
from tests.controlled import DT
from tests.runs import no_objects


def world(seed: int = 1, **wrong: Any) -> DisturbedSimulation:
    made = Disturbance(**wrong)
    return DisturbedSimulation(PANDA, no_objects, made, np.random.default_rng(seed))


def moved(sim: DisturbedSimulation, steps: int = 300) -> tuple[np.ndarray, ...]:
    """Measured positions and velocities, and true ones, (steps, 7) each."""
    held, rows = sim.motor_torque(), []
    for k in range(steps):
        sim.step(held + 0.5 * np.sin(0.05 * k))
        rows.append([*sim.state(), *sim.true_state()])
    return tuple(np.moveaxis(np.array(rows), 1, 0))


def test_positions_are_noisy_and_the_recording_tells_the_truth(robot: Robot) -> None:
    noise = Disturbance(noise_q=1e-3)
    sim = DisturbedSimulation(robot, no_objects, noise, np.random.default_rng(1))
    errors = []
    for _ in range(2000):
        sim.step(sim.motor_torque())
        errors.append(sim.state().q - sim.true_state().q)
    n = len(robot.joints)
    assert np.std(errors, axis=0) == pytest.approx(1e-3 * np.ones(n), rel=0.1)
    assert np.mean(errors, axis=0) == pytest.approx(np.zeros(n), abs=1.5e-4)
    white = [np.corrcoef(e[1:], e[:-1])[0, 1] for e in np.transpose(errors)]
    assert np.abs(white).max() < 0.1
    row = np.empty(sum(map(len, sim._views_now)))
    sim.write_now(row)
    assert row[:n].tolist() == sim.true_state().q.tolist()


def test_a_measurement_is_the_same_however_often_it_is_asked_for() -> None:
    errors: dict[str, Any] = {"noise_q": 1e-3, "noise_force": 1.0, "state_delay": (1e-3, 3e-3)}
    curious, lazy = world(**errors), world(**errors)
    for sim in (curious, lazy):
        for _ in range(20):
            sim.step(sim.motor_torque())
            if sim is curious:
                sim.state(), sim.felt_force()
    assert curious.state().q.tolist() == curious.state().q.tolist() == lazy.state().q.tolist()
    assert curious.felt_force().tolist() == lazy.felt_force().tolist()
    curious.state().q[:] = 0.0
    assert curious.state().q.tolist() == lazy.state().q.tolist()


def test_each_sensor_has_its_own_chance_and_a_reset_brings_it_back() -> None:
    plain, more = world(noise_q=1e-4), world(noise_q=1e-4, noise_force=1.0, pose_noise=1e-3)
    q = moved(plain)[0]
    assert np.array_equal(q, moved(more)[0])
    plain.reset()
    assert np.array_equal(q, moved(plain)[0])
    assert not np.array_equal(q, moved(world(seed=2, noise_q=1e-4))[0])


@pytest.mark.parametrize("cutoff", [None, 15.0, 200.0])
@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_velocities_are_filtered_differences_of_measured_positions(
    noise: float, cutoff: float | None
) -> None:
    sim = world(noise_q=noise, velocity_cutoff=cutoff)
    first = sim.state().q
    q, v, _, true = moved(sim)
    if cutoff is None and not noise:
        assert np.array_equal(v, true)
        return
    raw = np.diff(np.vstack([first, q]), axis=0) / DT
    keep = np.exp(-2 * np.pi * (50.0 if cutoff is None else cutoff) * DT)
    assert v == pytest.approx(lfilter([1 - keep], [1, -keep], raw, axis=0), abs=1e-12)
    assert np.abs(v - true).max() > 1e-4
    assert not (v == true).any()


def test_a_cutoff_of_zero_leaves_positions_only() -> None:
    sim = world(velocity_cutoff=0.0)
    assert np.isnan(sim.state().v).all()
    q, v, true, _ = moved(sim)
    assert np.isnan(v).all()
    assert np.array_equal(q, true)


def test_a_late_state_is_that_of_earlier() -> None:
    q, v, true_q, true_v = moved(world(state_delay=3e-3))
    assert np.array_equal(q[3:], true_q[:-3])
    assert np.array_equal(v[3:], true_v[:-3])
    assert q[0].tolist() == PANDA.home.tolist()
    half, _, true_q, _ = moved(world(state_delay=1.5e-3))
    between = (true_q[1:-1] + true_q[:-2]) / 2
    assert half[2:] == pytest.approx(between, abs=1e-12)


def test_state_and_torque_are_late_independently() -> None:
    """The whole loop is as late as both together."""
    late = world(torque_delay=2e-3, state_delay=3e-3)
    held = late.motor_torque()
    for k in range(20):
        late.step(held + (0.5 if k >= 5 else 0.0))
        # The torque of period 7 moves the arm at its end, and is measured 3 periods later.
        assert bool(np.abs(late.true_state().v).max() > 1e-4) is (k >= 7)
        assert bool(np.abs(late.state().v).max() > 1e-4) is (k >= 10)


def test_the_force_at_the_wrist_is_noisy_and_the_truth_is_not() -> None:
    sim, felt = world(noise_force=0.4), []
    for _ in range(3000):
        sim.step(sim.motor_torque())
        felt.append(sim.felt_force())
    assert np.std(felt, axis=0) == pytest.approx(0.4 * np.ones(3), rel=0.06)
    assert np.mean(felt, axis=0) == pytest.approx(np.zeros(3), abs=0.03)
    assert not sim.last_tool_force().any()


def test_the_force_drifts_slowly_from_a_start_that_differs() -> None:
    starts, changes = [], []
    for seed in range(400):
        sensor, rng = ForceSensor(SensorErrors(force_drift=1.0), 30.0), np.random.default_rng(seed)
        sensor.start(rng)
        starts.append(sensor.error[0].copy())
        for _ in range(300):
            sensor.sample()
        changes.append(sensor.error[0] - starts[-1])
    assert np.std(starts) == pytest.approx(1.0, rel=0.06)
    # Of an exponential correlation over 30 s, 0.3 s later.
    assert np.std(changes) == pytest.approx(np.sqrt(2 * (1 - np.exp(-0.3 / 30.0))), rel=0.06)


def test_each_of_two_wrists_has_its_own_errors() -> None:
    wrong = Disturbance(noise_force=0.3, force_drift=1.0, force_drift_time=0.02)
    sim = DisturbedSimulation(panda_pair(), no_objects, wrong, np.random.default_rng(3))
    felt = []
    for _ in range(4000):
        sim.step(sim.motor_torque())
        felt.append([sim.felt_force(i) - sim.last_tool_force(i) for i in range(2)])
    left, right = np.swapaxes(felt, 0, 1)
    for one in (left, right):
        assert np.std(one) == pytest.approx(np.hypot(0.3, 1.0), rel=0.1)
    # Some 200 values of each are independent of each other.
    correlation = np.corrcoef(np.hstack([left, right]).T)
    assert np.abs(correlation - np.eye(6)).max() < 0.3


@pytest.mark.parametrize("time_constant", [0.0, 0.02, 0.3])
def test_a_gauss_markov_process_has_its_size_and_correlation(time_constant: float) -> None:
    process, rng = GaussMarkov(2.0, 0.01, time_constant), np.random.default_rng(1)
    value = process.start(rng.standard_normal(4000))
    values = [value]
    for _ in range(60):
        values.append(process.advance(values[-1], rng.standard_normal(4000)))
    x = np.array(values)
    assert x.std(axis=1) == pytest.approx(2.0 * np.ones(61), rel=0.06)
    for steps in (1, 5, 30):
        wanted = np.exp(-0.01 * steps / time_constant) if time_constant else 0.0
        found = (x[steps:] * x[:-steps]).mean() / 4.0
        assert found == pytest.approx(wanted, abs=0.03)
