import numpy as np
import pytest

from robo47_qp.control.active import ActiveController
from robo47_qp.control.computed_torque import ComputedTorque
from robo47_qp.control.identification import Identification, Identified
from robo47_qp.control.observer import DisturbanceObserver
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm, JointReference
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.timing.rest_to_rest import plan_ptp
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from tests.controlled import DT, LOAD
from tests.runs import no_objects

WAYS = 0.5 * np.array(
    [
        [1.0, 0.6, -0.8, 0.8, 1.2, -0.8, 1.0],
        [-1.0, -0.3, 0.8, -0.4, -1.2, 1.0, -1.0],
        [0.4, 0.5, 0.9, 0.6, 0.9, 0.8, 0.6],
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    ]
)
"""Turns the tool about horizontal axes, and each joint both ways."""


def identified(wrong: Disturbance, noise: float = 0.0) -> Identified:
    arm, found = Arm(PANDA), Identification(Arm(PANDA))
    sim = DisturbedSimulation(PANDA, no_objects, wrong, np.random.default_rng(2))
    observer = DisturbanceObserver(noise_q=noise, friction=None)
    active, start = ActiveController(ComputedTorque(), arm, dt=DT, observer=observer), arm.home
    assert active.observed is not None
    for offset in WAYS:
        way = plan_ptp(start, arm.home + offset, PANDA.profile, DT)
        start = arm.home + offset
        for k, (q, v, a) in enumerate(zip(way.q, way.v, way.a, strict=True)):
            sim.step(active.torque(JointReference(q, v, a), sim.state()))
            if k % 10 == 0 and k > 100:
                found.add(q, v, a, active.observed.disturbance)
    return found.solve()


def test_a_payload_and_dry_friction_are_found() -> None:
    found = identified(Disturbance(payload=LOAD, dry_friction=0.5))
    assert found.payload_mass == pytest.approx(LOAD.mass, rel=0.06)
    assert found.payload_com == pytest.approx(LOAD.T_tcp_com.translation(), abs=0.015)
    assert found.friction == pytest.approx([0.5] * 4 + [0.3] * 3, rel=0.15)
    assert found.link_mass == pytest.approx(0.0, abs=0.01)


def test_heavier_links_are_found_under_noise() -> None:
    found = identified(Disturbance(link_mass_factor=1.05, noise_q=5e-5), noise=5e-5)
    assert found.link_mass == pytest.approx(0.05, abs=0.01)
    assert found.friction == pytest.approx(0.0, abs=0.1)


def test_of_an_exact_model_there_is_nothing_to_find() -> None:
    found = identified(Disturbance())
    assert found.link_mass == pytest.approx(0.0, abs=2e-3)
    assert found.payload_mass == pytest.approx(0.0, abs=0.02)
    assert found.deviation < 0.05


def test_an_arm_that_rests_tells_nothing() -> None:
    arm = Arm(PANDA)
    found, still = Identification(arm), np.zeros(arm.n)
    for _ in range(50):
        found.add(arm.home, still, still, still)
    with pytest.raises(InvalidValueError, match="one that tells the parameters apart"):
        found.solve()
    with pytest.raises(InvalidValueError, match="one that bears none"):
        Identification(arm.with_payload(LOAD))
