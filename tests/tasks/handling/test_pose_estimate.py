"""Looking: a noisy camera is looked through for as long as its noise calls for."""

from collections.abc import Generator
from typing import TypeVar

import mujoco
import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.arrays import Vector
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run.steps import StepLike, Wait
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.handling.pose_estimate import estimate_pose, estimate_poses
from robo47_qp.tasks.item import Item

CUBE = Item(name="cube", size=(0.04, 0.04, 0.04))


def build(spec: mujoco.MjSpec) -> None:
    CUBE.add(spec, (0.4, 0.1, 0.02))


Seen = TypeVar("Seen")


def looked(simulation: Simulation, height: float | None = None) -> tuple[SE3, float]:
    """What was seen of the cube, and how long that took [s]."""
    return watched(simulation, estimate_pose(simulation, "cube", height))


def watched(simulation: Simulation, program: Generator[StepLike, None, Seen]) -> tuple[Seen, float]:
    """What a program returns, and how long it waits [s]."""
    waited = 0.0
    try:
        while True:
            step = next(program)
            assert isinstance(step, Wait)
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
        assert waited == pytest.approx(8 / 30)
        assert abs((turn.inverse() @ seen.rotation()).log()).max() < 0.05
    # Twelve draws with a deviation of 1 mm, and not of the 3 mm of one frame.
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
    seen, waited = watched(simulation, estimate_poses(simulation, ("ball", "cube")))
    assert waited == pytest.approx(8 / 30)
    for name in ("cube", "ball"):
        miss = seen[name].translation() - simulation.object_pose(name).translation()
        assert abs(miss[:2]).max() < 4e-3
    assert watched(simulation, estimate_poses(simulation, ())) == ({}, 0.0)
