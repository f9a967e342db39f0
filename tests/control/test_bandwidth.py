"""Bandwidths of the observer: quiet at rest, where the arm is heavy, and where it is fast."""

import numpy as np
import pytest

from robo47_qp.arrays import Vector
from robo47_qp.control.bandwidth import Bandwidths
from robo47_qp.control.computed_torque import ComputedTorque
from robo47_qp.control.observer import DisturbanceObserver
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.trajectory import Trajectory, hold
from robo47_qp.run.control_loop import ControlLoop
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.sim.push import Push
from tests.controlled import DT, LOAD
from tests.runs import no_objects

STRETCHED = np.array([0.0, 1.4, 0.0, -0.2, 0.0, 1.6, 0.0])
STILL, MOVES = np.zeros(7), np.zeros(7, bool)


@pytest.fixture(scope="module", name="panda")
def a_panda() -> Arm:
    return Arm(PANDA)


def bandwidths(arm: Arm, noise_q: float = 5e-5, jitter: float = 0.0) -> Bandwidths:
    return Bandwidths(arm, 140.0, noise_q, DT, jitter=jitter)


def test_exact_positions_leave_all_bandwidth_everywhere(panda: Arm) -> None:
    exact = bandwidths(panda, noise_q=0.0)
    for rests in (MOVES, ~MOVES):
        assert (exact.at(panda, STRETCHED, np.ones(7), rests=rests) == 140.0).all()


@pytest.mark.parametrize("noise_q", [0.1, 1.0])
def test_noise_beyond_all_measure_leaves_the_least_bandwidth(panda: Arm, noise_q: float) -> None:
    loud = bandwidths(panda, noise_q=noise_q)
    assert loud.usual.min() == pytest.approx(0.14)
    assert (loud.usual[4:] > 0.14).all()
    assert (loud.at_rest <= loud.usual).all()
    assert (loud.at_rest > 0.0).all()


def test_a_bandwidth_beyond_the_control_rate_is_refused(panda: Arm) -> None:
    DisturbanceObserver(bandwidth=1000.0).build(panda, DT)
    with pytest.raises(InvalidValueError, match="bandwidth must be above 0 and at most 1000; fou"):
        DisturbanceObserver(bandwidth=1e5)


def test_a_heavy_load_takes_bandwidth_and_home_does_not(panda: Arm) -> None:
    loud = bandwidths(panda, noise_q=1e-4)
    assert (loud.at(panda, panda.home, STILL, rests=MOVES) == loud.usual).all()
    heavy = loud.at(panda.with_payload(LOAD), STRETCHED, STILL, rests=MOVES)
    assert (heavy <= loud.usual).all()
    assert heavy[0] < 0.9 * loud.usual[0]


def test_jitter_takes_bandwidth_where_joints_are_fast(panda: Arm) -> None:
    late = bandwidths(panda, jitter=1e-4)
    assert (late.at(panda, panda.home, STILL, rests=MOVES) == late.usual).all()
    fast = late.at(panda, panda.home, np.full(7, 2.0), rests=MOVES)
    assert (fast <= late.usual).all()
    assert (fast < 0.9 * late.usual).any()
    # All positions are late by the same time: opposite joints may cancel in a torque.
    other = late.at(panda, panda.home, 2.0 * np.resize([1.0, -1.0], 7), rests=MOVES)
    assert (other != fast).any()


def _torque_rates(*, tuned: bool) -> Vector:
    """Standard deviation of the torque rates in a fast motion that is measured late [N·m/s]."""
    arm, late = Arm(PANDA), (0.0, 1e-3)
    wrong = Disturbance(noise_q=2e-5, state_delay=late)
    simulation = DisturbedSimulation(PANDA, no_objects, wrong, np.random.default_rng(1))
    observer = DisturbanceObserver(friction=None)
    loop = ControlLoop(arm, ComputedTorque(), simulation, observer=observer)
    if not tuned:
        loop.control.tune = lambda *_: None  # type: ignore[method-assign]
    t, w = np.arange(801)[:, None] * DT, 2.0 * np.pi / 0.8
    turn = np.array([0.4, 0.2, 0.4, 0.2, 0.4, 0.2, 0.4]) / w
    q = arm.home + turn * (w * t - np.sin(w * t))
    v, a = turn * w * (1.0 - np.cos(w * t)), turn * w**2 * np.sin(w * t)
    loop.begin("turn")
    loop.track(Trajectory(q=q, v=v, a=a, dt=DT))
    tau = loop.recording.rows()["joints/tau_command"]
    rates: Vector = np.diff(tau[300:500], axis=0).std(axis=0) / DT
    return rates


def test_jitter_keeps_the_torque_rates_of_fast_joints() -> None:
    quiet, loud = _torque_rates(tuned=True), _torque_rates(tuned=False)
    assert (5.0 * quiet < PANDA.tau_rate_max).all()
    assert (loud > 1.3 * quiet).any()


@pytest.mark.parametrize("noise_q", [5e-5, 1e-4])
def test_noise_does_not_shake_an_arm_that_rests(noise_q: float) -> None:
    """No joint rubs here, so that nothing else holds it still."""
    wrong = Disturbance(noise_q=noise_q)
    simulation = DisturbedSimulation(PANDA, no_objects, wrong, np.random.default_rng(2))
    loop = ControlLoop(Arm(PANDA), ComputedTorque(), simulation, observer=DisturbanceObserver())
    loop.begin("hold")
    loop.hold(2.0)
    v = loop.recording.rows()["joints/v"]
    assert np.abs(v[700:]).max() < 2e-3
    # As long as it has not rested for a while, it follows faster.
    assert v[:100].std(axis=0)[4:].min() > 1.5 * v[700:].std(axis=0)[4:].max()


def test_a_joint_that_rubs_beside_its_place_lets_the_others_rest() -> None:
    wrong = Disturbance(noise_q=1e-4, dry_friction=np.array([4.0, *[0.3] * 6]))
    simulation = DisturbedSimulation(PANDA, no_objects, wrong, np.random.default_rng(2))
    loop = ControlLoop(Arm(PANDA), ComputedTorque(), simulation, observer=DisturbanceObserver())
    beside = np.array([0.6e-3, *[0.0] * 6])
    loop.begin("hold")
    loop.track(hold(loop.arm.home + beside, 2000, DT))
    rows = loop.recording.rows()
    assert np.abs(rows["joints/q_ref"] - rows["joints/q"])[1000:, 0].min() > 4e-4
    assert np.abs(rows["joints/v"][1000:]).max() < 2e-3
    assert np.abs(rows["joints/v"][1000:, 4:]).max() < 5e-4


@pytest.mark.parametrize("seed", [51, 53, 54, 59])
def test_an_arm_that_is_pushed_while_it_rests_follows_fast_with_all_joints(seed: int) -> None:
    rng = np.random.default_rng([seed, 9])
    friction, way = rng.uniform(0.4, 1.2, 7), rng.standard_normal(3)
    push = Push(force=10.0 * way / np.linalg.norm(way), start=1.5)
    wrong = Disturbance(
        noise_q=1e-4,
        state_delay=(1e-3, 2e-3),
        torque_delay=(1e-3, 2e-3),
        dry_friction=friction,
        wrist_friction=0.5,
        link_mass_factor=1.0 + rng.uniform(-0.1, 0.1, 64),
        pushes=(push,),
    )
    simulation = DisturbedSimulation(PANDA, no_objects, wrong, np.random.default_rng(seed))
    loop = ControlLoop(Arm(PANDA), ComputedTorque(), simulation, observer=DisturbanceObserver())
    loop.begin("hold")
    loop.track(hold(loop.arm.home + rng.uniform(-1e-3, 1e-3, 7), 4000, DT))
    place = loop.recording.rows()["tool/pose"][1500:, :3]
    off = np.linalg.norm(place - place[-300:].mean(axis=0), axis=1)
    # While joints that are near their places were followed slowly, it took 1.6 to 2.1 s.
    assert np.flatnonzero(off > 2e-4)[-1] < 1200
