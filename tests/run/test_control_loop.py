"""The control loop: what the controller is told of payloads."""

import numpy as np
import pytest

from robo47_qp.control.joint_impedance import JointImpedance
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run.control_loop import ControlLoop
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from tests.controlled import LOAD
from tests.runs import no_objects


@pytest.mark.parametrize("factor", [1.0, 1.25])
def test_the_controller_believes_the_payload_that_it_is_told(factor: float) -> None:
    world = DisturbedSimulation(PANDA, no_objects, Disturbance(payload_factor=factor))
    loop = ControlLoop(Arm(PANDA), JointImpedance(), world)
    loop.set_payload(LOAD)
    believed = loop.control.arm.payload
    assert believed is not None
    assert believed.mass == pytest.approx(factor * LOAD.mass, rel=1e-12)
    np.testing.assert_allclose(believed.inertia, factor * np.array(LOAD.inertia), rtol=1e-12)
    assert believed.T_tcp_com == LOAD.T_tcp_com
    before = loop.control.arm
    loop.set_payload(LOAD)
    assert loop.control.arm is before, "the torque would run to the same load again"
    loop.let_go(0)
    assert loop.control.arm.payload is None
    loop.set_payload(LOAD)
    again = loop.control.arm.payload
    assert again is not None
    assert again.mass == believed.mass
