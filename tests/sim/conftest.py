"""Worlds that tests of the simulation share."""

import pytest

from robo47_qp.model.robots.panda import PANDA
from robo47_qp.sim.simulation import Simulation
from tests.sim.shelf import cube_on_a_shelf, start_again


@pytest.fixture
def arm_alone() -> Simulation:
    return start_again()


@pytest.fixture
def shelved() -> Simulation:
    return Simulation(PANDA, cube_on_a_shelf)
