"""Pushes: forces on the tool for a while, which its wrist feels."""

from dataclasses import replace

import numpy as np
import pytest

from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import Robot
from robo47_qp.model.robots.panda_pair import panda_pair
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.sim.push import Push
from robo47_qp.sim.simulation import Simulation
from tests.runs import no_objects


def test_a_push_is_a_force_at_the_tool_for_its_time(robot: Robot, arm: Arm) -> None:
    force = np.array([3.0, -4.0, 5.0])
    push = Push(force=force, start=0.01, duration=0.02)
    sim = DisturbedSimulation(robot, no_objects, Disturbance(pushes=[push]))
    free = Simulation(robot, no_objects)
    R, J = arm.pose(arm.home).rotation().as_matrix(), arm.jacobian(arm.home)
    acted = []
    for k in range(50):
        assert sim.felt_force().tolist() == (force.tolist() if 10 < k <= 30 else [0.0] * 3)
        sim.step(sim.motor_torque())
        free.step(free.motor_torque())
        applied = sim.data.qfrc_applied[: arm.n]
        acted.append(bool(applied.any()))
        if k == 10:
            assert applied == pytest.approx(J[:3].T @ (R.T @ force), abs=1e-4)
        assert not sim.last_tool_force().any()
    assert acted == [10 <= k < 30 for k in range(50)]


def test_what_pushes_together_is_felt_together_at_the_tool_that_it_pushes() -> None:
    forces = np.array([[3.0, -4.0, 5.0], [0.0, 1.0, 2.0]])
    pushes = [Push(force=force, start=0.0, duration=0.02) for force in forces]
    wrong = Disturbance(pushes=pushes, noise_force=0.2)
    sim, same = (
        DisturbedSimulation(panda_pair(), no_objects, one, np.random.default_rng(3))
        for one in (wrong, replace(wrong, pushes=()))
    )
    for _ in range(2):
        for world in (sim, same):
            world.step(world.motor_torque())
        felt = sim.felt_force() - same.felt_force()
        np.testing.assert_allclose(felt, forces.sum(axis=0), atol=1e-12)
        np.testing.assert_array_equal(sim.felt_force(1), same.felt_force(1))
        for world in (sim, same):
            world.reset()  # Nothing has pushed yet.
        np.testing.assert_array_equal(sim.felt_force(), same.felt_force())


def test_another_push_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="force must be a vector of 3"):
        Push(force=np.array([1.0, np.nan, 0.0]), start=0.0)
    with pytest.raises(InvalidValueError, match="duration must be 0 or more and finite"):
        Push(force=np.zeros(3), start=0.0, duration=-1.0)
