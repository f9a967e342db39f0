import mujoco
import numpy as np
import pytest

from robo47_qp.arm import Arm
from robo47_qp.disturbance import Disturbance, DisturbedSimulation, Push
from robo47_qp.errors import InvalidValueError
from robo47_qp.robot import Robot
from robo47_qp.simulation import Simulation
from tests.controlled import DT, LOAD
from tests.runs import no_objects


def held(arm: Arm) -> np.ndarray:
    return arm.inverse_dynamics(arm.home, np.zeros(arm.n), np.zeros(arm.n))


def test_nothing_wrong_is_the_simulation_itself(robot: Robot, rng: np.random.Generator) -> None:
    plain = Simulation(robot, no_objects)
    other = DisturbedSimulation(robot, no_objects, Disturbance(), rng)
    for _ in range(50):
        tau = plain.motor_torque() + rng.uniform(-0.5, 0.5, len(robot.joints))
        plain.step(tau)
        other.step(tau)
    assert plain.state().q.tolist() == other.state().q.tolist()
    assert plain.state().v.tolist() == other.state().v.tolist()


@pytest.mark.parametrize("delay", [1, 5])
def test_a_command_arrives_so_many_periods_later(robot: Robot, delay: int) -> None:
    sim = DisturbedSimulation(robot, no_objects, Disturbance(delay=delay))
    for _ in range(2):
        start, step = sim.motor_torque(), 0.5 * robot.tau_rate_max * DT
        for k in range(delay + 2):
            sim.step(start + step)
            arrived = sim.last_torque() - start
            assert arrived == pytest.approx(step if k >= delay else 0 * step, abs=1e-9)
        sim.reset()


def test_sensors_are_noisy_and_the_recording_tells_the_truth(robot: Robot) -> None:
    noise = Disturbance(noise_q=1e-3, noise_v=2e-2)
    sim = DisturbedSimulation(robot, no_objects, noise, np.random.default_rng(1))
    again = DisturbedSimulation(robot, no_objects, noise, np.random.default_rng(1))
    seen = [sim.state() for _ in range(2000)]
    assert seen[7].q.tolist() == [again.state() for _ in range(8)][7].q.tolist()
    q, v = np.array([s.q for s in seen]), np.array([s.v for s in seen])
    assert np.std(q, axis=0) == pytest.approx(1e-3 * np.ones(q.shape[1]), rel=0.1)
    assert np.std(v, axis=0) == pytest.approx(2e-2 * np.ones(q.shape[1]), rel=0.1)
    assert np.mean(q, axis=0) == pytest.approx(robot.home, abs=1.5e-4)
    row = np.empty(sum(map(len, sim._views_now)))
    sim.write_now(row)
    assert row[: len(robot.joints)].tolist() == robot.home.tolist()


def test_noise_needs_a_generator(robot: Robot) -> None:
    with pytest.raises(InvalidValueError, match="rng must be a numpy Generator"):
        DisturbedSimulation(robot, no_objects, Disturbance(noise_q=1e-3))
    with pytest.raises(InvalidValueError, match="rng must be a numpy Generator"):
        DisturbedSimulation(robot, no_objects, Disturbance(noise_force=0.1))


def test_an_unknown_payload_pulls_as_one_that_the_arm_knows(robot: Robot, arm: Arm) -> None:
    sim = DisturbedSimulation(robot, no_objects, Disturbance(payload=LOAD))
    loaded = arm.carrying(LOAD)
    if robot.gripper is None:
        assert sim.motor_torque() == pytest.approx(held(loaded), abs=1e-6)
    assert sim.motor_torque() - Simulation(robot, no_objects).motor_torque() == pytest.approx(
        held(loaded) - held(arm), abs=1e-6
    )


def test_heavier_links_take_torque_in_proportion(robot: Robot, arm: Arm) -> None:
    torque = {
        factor: DisturbedSimulation(
            robot, no_objects, Disturbance(inertia_factor=factor, payload=LOAD)
        ).motor_torque()
        for factor in (0.8, 1.0, 1.2)
    }
    brick = held(arm.carrying(LOAD)) - held(arm)
    for factor in (0.8, 1.2):
        own = torque[1.0] - brick
        assert torque[factor] == pytest.approx(factor * own + brick, abs=1e-6)


def test_a_push_is_a_force_at_the_tool_for_its_time(robot: Robot, arm: Arm) -> None:
    force = np.array([3.0, -4.0, 5.0])
    push = Push(force=force, start=0.01, duration=0.02)
    sim = DisturbedSimulation(robot, no_objects, Disturbance(pushes=[push]))
    free = Simulation(robot, no_objects)
    R, J = arm.pose(arm.home).rotation().as_matrix(), arm.jacobian(arm.home)
    felt = []
    for k in range(50):
        sim.step(sim.motor_torque())
        free.step(free.motor_torque())
        applied = sim.data.qfrc_applied[: arm.n]
        felt.append(bool(applied.any()))
        if k == 10:
            assert applied == pytest.approx(J[:3].T @ (R.T @ force), abs=1e-4)
    assert felt == [10 <= k < 30 for k in range(50)]


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"delay": -1}, "delay must be finite and not negative"),
        ({"noise_q": np.nan}, "noise_q must be finite and not negative"),
        ({"noise_force": -0.1}, "noise_force must be finite and not negative"),
        ({"inertia_factor": 0.0}, "inertia_factor must be above 0"),
    ],
)
def test_another_disturbance_is_refused(setting: dict[str, float], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        Disturbance(**setting)  # type: ignore[arg-type]


def test_another_push_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="force must be a vector of 3"):
        Push(force=np.array([1.0, np.nan, 0.0]), start=0.0)
    with pytest.raises(InvalidValueError, match="duration must be finite and not negative"):
        Push(force=np.zeros(3), start=0.0, duration=-1.0)


@pytest.mark.parametrize("factor", [0.8, 1.2])
def test_heavier_links_are_harder_to_turn_in_proportion(robot: Robot, factor: float) -> None:
    matrices, weights = [], []
    for sim in (
        Simulation(robot, no_objects),
        DisturbedSimulation(robot, no_objects, Disturbance(inertia_factor=factor)),
    ):
        m, M = sim.model, np.zeros((sim.model.nv, sim.model.nv))
        mujoco.mj_fullM(m, sim.data, M)
        matrices.append(M - np.diag(m.dof_armature))
        weights.append(m.body_subtreemass[0])
    assert np.abs(matrices[1] - factor * matrices[0]).max() < 1e-9
    assert weights[1] == pytest.approx(factor * weights[0])
