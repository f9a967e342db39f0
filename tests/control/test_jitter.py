"""Tests for Jitter."""

import numpy as np
import pytest

from robo47_qp.arrays import Vector
from robo47_qp.control.active import ActiveController
from robo47_qp.control.computed_torque import ComputedTorque
from robo47_qp.control.jitter import Jitter
from robo47_qp.control.observer import DisturbanceObserver
from robo47_qp.model.arm import Arm, JointReference
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.timing.rest_to_rest import plan_ptp
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from tests.controlled import DT
from tests.runs import no_objects

NOISE, JITTER = 5e-5, 1.5e-4
V = np.array([1.0, -0.5, 0.2, 1.5, 0.0, -1.0, 0.3])


def _changes(found: list[Vector]) -> Vector:
    changes: Vector = np.diff(found, axis=0).std(axis=0)
    return changes


def test_a_delay_that_changes_goes_and_noise_across_the_velocity_stays(
    rng: np.random.Generator,
) -> None:
    jitter, q, found, measured = Jitter(NOISE, JITTER, DT), np.zeros(7), [], []
    for _ in range(2000):
        q = q + V * DT
        seen = q - V * JITTER * rng.standard_normal() + NOISE * rng.standard_normal(7)
        measured.append(seen - q)
        found.append(jitter.removed(seen, q, V) - q)
    along = V / np.linalg.norm(V)
    across = np.linalg.qr(np.column_stack([along, np.eye(7)[:, :6]]))[0][:, 1:]
    assert _changes(found @ along) < 0.4 * _changes(measured @ along)
    np.testing.assert_allclose(found @ across, measured @ across, atol=1e-15)


def test_what_lasts_is_left_to_the_observer() -> None:
    jitter, off = Jitter(NOISE, JITTER, DT), 1e-3 * V
    found = off
    for _ in range(50):
        found = jitter.removed(off, np.zeros(7), V)
    np.testing.assert_allclose(found, off, rtol=1e-4)


@pytest.mark.parametrize("noise", [0.0, NOISE])
def test_positions_of_joints_at_rest_are_as_measured(noise: float) -> None:
    q = np.linspace(-1.0, 1.0, 7)
    found = Jitter(noise, JITTER, DT).removed(q, np.zeros(7), np.zeros(7))
    np.testing.assert_array_equal(found, q)


def test_torques_of_a_fast_motion_change_less() -> None:
    """As in a cell where the state is 0.5 to 1 ms late, but for the noise of the positions."""
    changes = []
    for jitter in (0.0, 0.5e-3 / np.sqrt(12.0)):
        wrong, rng = Disturbance(state_delay=(0.5e-3, 1e-3)), np.random.default_rng(3)
        sim, arm = DisturbedSimulation(PANDA, no_objects, wrong, rng), Arm(PANDA)
        noise, late, later, told = sim.joint_data_sheet
        assert told == pytest.approx(0.5e-3 / np.sqrt(12.0))
        observer = DisturbanceObserver(noise_q=NOISE).in_cell(noise, late, later, jitter, DT)
        active = ActiveController(ComputedTorque(), arm, dt=DT, observer=observer)
        way, asked = plan_ptp(arm.home, arm.home + 0.6, PANDA.profile, DT), []
        for q, v, a in zip(way.q, way.v, way.a, strict=True):
            assert np.abs(sim.true_state().q - q).max() < 1.5e-3
            sim.step(active.torque(JointReference(q, v, a), sim.state()))
            asked.append(active.commanded.copy())
        changes.append(_changes(asked))
    assert (changes[1] < 0.7 * changes[0]).all()
