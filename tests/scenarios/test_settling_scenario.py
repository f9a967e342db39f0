"""The settling of the arm: judged by its linear equations of motion, solved in closed form."""

from io import StringIO
from pathlib import Path

import mujoco
import numpy as np
import pytest
from rich.console import Console
from scipy.linalg import expm

from robo47_qp.arrays import Vector
from robo47_qp.cli import FAILED, OK
from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.benchmarks.settling.settling import settling_time
from robo47_qp.files import read_json
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.sim.simulation import Simulation
from scenarios.settling import SettlingOptions, run, step_response
from tests.plain_arm import PlainArm
from tests.runs import no_objects

DT = 1e-3


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return Simulation(PANDA, no_objects)


def linear_errors(offset: Vector, steps: int) -> Vector:
    """|e| under M(home) e'' + D e' + K e = 0 from e = offset at rest, critically damped."""
    m = PlainArm(PANDA).welded
    d, M = mujoco.MjData(m), np.empty((7, 7))
    d.qpos[:] = PANDA.home
    mujoco.mj_forward(m, d)
    mujoco.mj_fullM(m, d, M)
    K = np.diag(PANDA.stiffness)
    D = 2.0 * np.sqrt(K @ np.diag(np.diag(M)))
    fall = -np.linalg.solve(M, np.hstack([K, D]))
    step = expm(DT * np.vstack([np.hstack([np.zeros((7, 7)), np.eye(7)]), fall]))
    x, errors = np.concatenate([offset, np.zeros(7)]), np.empty(steps)
    for k in range(steps):
        errors[k] = np.linalg.norm(x[:7])
        x = step @ x
    return errors


def test_small_steps_settle_as_the_linear_equations_say(
    simulation: Simulation, rng: np.random.Generator
) -> None:
    for _ in range(3):
        offset = rng.uniform(-1e-4, 1e-4, 7)
        response = step_response(simulation, Arm(PANDA), offset, 0.6)
        linear = linear_errors(offset, len(response.errors))
        assert response.errors[0] == pytest.approx(np.linalg.norm(offset))
        assert len(response.errors) == 601
        measured = settling_time(response.errors, DT)
        assert measured == pytest.approx(settling_time(linear, DT), abs=2e-3)


def test_a_large_step_takes_no_less_and_its_torque_is_told(simulation: Simulation) -> None:
    """The motors' torque rate is limited: the spring's pull comes late."""
    direction = np.array([0.5, -1.0, 0.3, 0.8, 0.2, -0.6, 1.0])
    small, large = (
        step_response(simulation, Arm(PANDA), size * direction, 0.6) for size in (1e-4, 0.04)
    )
    later = settling_time(large.errors, DT) - settling_time(small.errors, DT)
    assert 1e-3 < later < 20e-3
    # At rest the most loaded motor carries gravity: a third of its limit at most.
    held = np.abs(PlainArm(PANDA).full.actuator_ctrlrange[:7, 1])
    assert held.tolist() == PANDA.tau_max.tolist()
    assert 0.0 < small.torque_use < large.torque_use <= 1.0
    gravity = Arm(PANDA).inverse_dynamics(PANDA.home, np.zeros(7), np.zeros(7))
    assert small.torque_use == pytest.approx(np.max(np.abs(gravity) / PANDA.tau_max), rel=0.01)


def test_every_response_starts_from_home_and_the_order_does_not_matter(
    simulation: Simulation,
) -> None:
    arm, offsets = Arm(PANDA), [np.full(7, 0.03), np.full(7, -0.02)]
    first = [step_response(simulation, arm, offset, 0.1) for offset in offsets]
    second = [step_response(simulation, arm, offset, 0.1) for offset in reversed(offsets)]
    for before, after in zip(first, reversed(second), strict=True):
        assert before.errors.tolist() == after.errors.tolist()
        assert before.torque_use == after.torque_use


def test_a_run_reports_and_is_the_same_again(tmp_path: Path) -> None:
    reports = []
    for _ in range(2):
        options = SettlingOptions(starts=2, seconds=0.6, seed=3, report=tmp_path / "report.json")
        assert run(options, Console(file=StringIO())) == OK
        reports.append(read_json(tmp_path / "report.json", ""))
    assert reports[0] == reports[1]
    assert reports[0]["robot"] == "panda"
    assert reports[0]["settings"]["offset"] == 0.04
    offsets = np.random.default_rng(3).uniform(-0.04, 0.04, (2, 7))
    linear = [settling_time(linear_errors(offset, 600), DT) for offset in offsets]
    np.testing.assert_allclose(reports[0]["settling_times_s"], linear, atol=0.015)


def test_too_short_a_look_fails_the_run(tmp_path: Path) -> None:
    options = SettlingOptions(starts=2, seconds=0.1, report=tmp_path / "report.json")
    text = StringIO()
    assert run(options, Console(file=text)) == FAILED
    assert "2 of 2 starts did not settle" in text.getvalue()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("offset", [0.0, 0.3, np.nan])
def test_an_offset_out_of_range_is_told(offset: float) -> None:
    with pytest.raises(InvalidValueError, match="--offset must be above 0 and at most"):
        SettlingOptions(offset=offset)
