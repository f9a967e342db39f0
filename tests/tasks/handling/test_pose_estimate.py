"""Looking: a noisy camera is looked through for as long as its noise calls for."""

from collections.abc import Generator
from typing import TypeVar

import mujoco
import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.arrays import Vector
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run.steps import Look, StepLike
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.handling.pose_estimate import (
    coordinate_error,
    estimate_pose,
    estimate_poses,
    frames_needed,
)
from robo47_qp.tasks.item import Item
from tests.runs import live

CUBE = Item(name="cube", size=(0.04, 0.04, 0.04))


def build(spec: mujoco.MjSpec) -> None:
    CUBE.add(spec, (0.4, 0.1, 0.02))


def at_rest(spec: mujoco.MjSpec) -> None:
    build(spec)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[1.0, 1.0, 0.1], pos=[0, 0, -0.1])


Seen = TypeVar("Seen")


def looked(simulation: Simulation, height: float | None = None) -> tuple[SE3, float]:
    """What was seen of the cube, and how long that took [s]."""
    return watched(simulation, estimate_pose(live(simulation), "cube", height))


def watched(simulation: Simulation, program: Generator[StepLike, None, Seen]) -> tuple[Seen, float]:
    """What a program returns, and how long it waits [s]."""
    waited = 0.0
    try:
        while True:
            step = next(program)
            assert isinstance(step, Look)
            waited += step.seconds
            for _ in range(round(step.seconds / 1e-3)):
                simulation.step(simulation.data.qfrc_bias[:7].copy())
    except StopIteration as end:
        return end.value, waited


@pytest.fixture(scope="module")
def noisy() -> Simulation:
    return DisturbedSimulation(PANDA, build, Disturbance(pose_noise=3e-3), np.random.default_rng(1))


def off(simulation: Simulation, seen: SE3) -> Vector:
    found: Vector = seen.translation() - simulation.object_pose("cube").translation()
    return found


def test_a_camera_without_noise_is_looked_through_once() -> None:
    simulation = Simulation(PANDA, build)
    seen, waited = looked(simulation, height=0.5)
    assert waited == 0.0
    np.testing.assert_array_equal(seen.wxyz_xyz, simulation.object_pose("cube").wxyz_xyz)


def test_noise_is_averaged_down_to_a_millimetre(noisy: Simulation) -> None:
    turn = SO3.from_z_radians(0.7)
    errors = []
    for _ in range(6):
        pose = SE3.from_rotation_and_translation(turn, np.array([0.4, 0.1, -5.0]))
        noisy.place_object("cube", pose)
        seen, waited = looked(noisy)
        # It falls meanwhile: the mean of its heights says nothing.
        errors += off(noisy, seen)[:2].tolist()
        assert waited == pytest.approx(12 / 30, abs=1.1 / 30)
        assert abs((turn.inverse() @ seen.rotation()).log()).max() < 0.05
    # Twelve draws with a deviation of 0.9 mm, and not of the 3 mm of one frame.
    assert 0.4e-3 < np.std(errors) < 1.8e-3


def test_a_height_that_is_known_is_believed(noisy: Simulation) -> None:
    seen, _ = looked(noisy, height=0.123)
    assert seen.translation()[2] == 0.123


def test_several_objects_are_seen_in_the_same_frames() -> None:
    ball = Item(name="ball", size=(0.03, 0.03, 0.03), round=True)

    def both(spec: mujoco.MjSpec) -> None:
        build(spec)
        ball.add(spec, (0.5, -0.2, 0.015))

    rng = np.random.default_rng(4)
    simulation = DisturbedSimulation(PANDA, both, Disturbance(pose_noise=3e-3), rng)
    seen, waited = watched(simulation, estimate_poses(live(simulation), ("ball", "cube")))
    assert waited == pytest.approx(12 / 30, abs=1.1 / 30)
    for name in ("cube", "ball"):
        miss = seen[name].translation() - simulation.object_pose(name).translation()
        assert abs(miss[:2]).max() < 4e-3
    assert watched(simulation, estimate_poses(live(simulation), ())) == ({}, 0.0)


def test_errors_that_last_are_watched_for_longer() -> None:
    """Against the variance of the mean by the sum of all correlations."""
    wrong = Disturbance(pose_noise=2e-3, pose_noise_time=0.3)
    simulation = DisturbedSimulation(PANDA, build, wrong, np.random.default_rng(2))
    n = frames_needed(live(simulation), 1e-3)
    lags = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    assert 2e-3 * np.sqrt(np.exp(-lags / 9.0).sum()) / n == pytest.approx(1e-3, rel=0.1)
    _, waited = looked(simulation)
    assert waited > n / 30 - 0.1


def test_images_that_are_wrong_altogether_are_left_out() -> None:
    wrong = Disturbance(pose_noise=2e-3, outliers=0.2, outlier_size=0.1)
    errors = []
    for seed in range(5):
        simulation = DisturbedSimulation(PANDA, at_rest, wrong, np.random.default_rng(seed))
        errors.append(abs(off(simulation, looked(simulation)[0])[:2]).max())
    assert max(errors) < 3e-3  # one of five with 0.1 m would make 20 mm


def test_images_of_where_it_was_are_not_used() -> None:
    wrong = Disturbance(camera_latency=0.1, dropped_frames=0.3)
    simulation = DisturbedSimulation(PANDA, at_rest, wrong, np.random.default_rng(2))
    for _ in range(50):
        simulation.step(simulation.data.qfrc_bias[:7].copy())
    address = simulation.model.jnt_qposadr[simulation.model.body("cube").jntadr[0]]
    simulation.data.qpos[address : address + 3] += [0.05, 0.0, 0.5]
    mujoco.mj_kinematics(simulation.model, simulation.data)
    seen, waited = looked(simulation)
    assert abs(off(simulation, seen)[:2]).max() < 1e-6
    assert waited >= 0.1


def test_of_what_is_hidden_the_last_image_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation = DisturbedSimulation(
        PANDA, build, Disturbance(pose_noise=3e-3, occlusion=1), np.random.default_rng(1)
    )
    monkeypatch.setattr(simulation, "_occluded", lambda _: True)
    simulation._camera._occluded = lambda _: True  # type: ignore[union-attr]
    for _ in range(100):
        simulation.step(simulation.data.qfrc_bias[:7].copy())
    before = simulation.seen_pose("cube")
    seen, waited = looked(simulation)
    np.testing.assert_array_equal(seen.wxyz_xyz, before.wxyz_xyz)
    assert waited < 3.0


@pytest.mark.parametrize(("share", "fewest"), [(0.01, 3), (0.05, 5), (0.24, 31)])
def test_without_noise_as_many_are_taken_as_outvote_the_wrong_ones(
    share: float, fewest: int
) -> None:
    """By a count of a million draws."""
    wrong = Disturbance(outliers=share, outlier_size=0.03)
    simulation = DisturbedSimulation(PANDA, at_rest, wrong, np.random.default_rng(0))
    n = frames_needed(live(simulation), 1e-3)
    assert n >= fewest
    lost = 2 * np.random.default_rng(1).binomial(n, share, 1_000_000) >= n
    assert lost.mean() < 1.3e-4
    np.testing.assert_allclose(off(simulation, looked(simulation)[0]), 0.0, atol=1e-4)


def test_as_many_images_are_taken_as_a_heading_needs() -> None:
    """With noise of the heading alone: of single images, it would be off by several degrees."""
    rng, headings = np.random.default_rng(3), []
    for _ in range(12):
        wrong = Disturbance(heading_noise=0.08)
        simulation = DisturbedSimulation(PANDA, at_rest, wrong, rng)
        seen, _ = looked(simulation)
        true = simulation.object_pose("cube").rotation()
        headings.append(float((true.inverse() @ seen.rotation()).log()[2]))
    # 0.9 mm at a corner that is 45 mm away.
    assert 0.0 < np.std(headings) < 1.6 * 0.02


@pytest.mark.parametrize(
    ("bias", "turn", "millimetres"), [(0.0, 0.0, 0.9), (4e-3, 0.0, 4.1), (4e-3, 0.0175, 6.661)]
)
def test_a_coordinate_errs_by_images_shift_and_turn_of_the_calibration(
    bias: float, turn: float, millimetres: float
) -> None:
    """The turn counts at 300 mm from where the camera was calibrated: 5.25 mm."""
    wrong = Disturbance(pose_bias=bias, rotation_bias=turn)
    simulation = DisturbedSimulation(PANDA, build, wrong, np.random.default_rng(3))
    assert 1e3 * coordinate_error(live(simulation)) == pytest.approx(millimetres, abs=1e-3)
