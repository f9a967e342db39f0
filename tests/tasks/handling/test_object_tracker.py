"""Tracking an object on a line: through noise, late images and those that are wrong."""

import numpy as np
import pytest

from robo47_qp.model.robots.panda import PANDA
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.conveyor_pick.conveyor_pick import ConveyorPick
from robo47_qp.tasks.handling.object_tracker import ObjectTracker
from tests.runs import Holder, live


def test_tracker_find_the_line_through_noise() -> None:
    task = ConveyorPick(speed=0.1)
    simulation = Simulation(PANDA, task.build_scene)
    task.reset(simulation, None)
    holder, tracker = Holder(simulation), ObjectTracker(live(simulation), "cube")
    holder.hold(150)
    for _ in range(10):
        holder.hold(34)
        tracker.update()
        tracker.update()
    assert tracker.velocity == pytest.approx([0.0, 0.1, 0.0], abs=1e-4)
    later = simulation.time + 0.5
    predicted = tracker.at(later).translation()
    holder.hold(500)
    assert predicted == pytest.approx(simulation.object_pose("cube").translation(), abs=1e-4)


def test_a_prediction_that_is_followed_changes_without_a_leap_and_as_far_as_any_other() -> None:
    task, noisy = ConveyorPick(speed=0.1), Disturbance(pose_noise=4e-3, heading_noise=0.1)
    simulation = DisturbedSimulation(PANDA, task.build_scene, noisy, np.random.default_rng(5))
    task.reset(simulation, None)
    holder, sensed = Holder(simulation), live(simulation)
    followed, other = (ObjectTracker(sensed, "cube") for _ in range(2))
    for _ in range(10):
        holder.hold(34)
        followed.update()
        other.update()

    def around(time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """How far it is from the other, its velocity and its acceleration right after a time."""
        start, end, last = (followed.at(time + k * 1e-4) for k in range(3))
        places = np.array([T.translation() for T in (start, end, last)])
        off, speed = (other.at(time).inverse() @ start).log(), (start.inverse() @ end).log() / 1e-4
        return off, speed, np.diff(places, 2, axis=0)[0] / 1e-8

    leaps = []
    for _ in range(10):
        holder.hold(34)
        now = simulation.time
        before, then = followed.at(now), other.at(now)
        _, speed, acceleration = around(now)
        followed.update_smoothly()
        other.update()
        leaps.append(np.linalg.norm((then.inverse() @ other.at(now)).translation()))
        assert (before.inverse() @ followed.at(now)).log() == pytest.approx(np.zeros(6), abs=1e-9)
        assert around(now)[1] == pytest.approx(speed, abs=1e-3)
        assert around(now)[2] == pytest.approx(acceleration, abs=3e-3)
    assert max(leaps) > 0.2e-3
    off = around(simulation.time)[0]
    assert np.linalg.norm(off) > 0.2e-3
    # What it was is told as it is known now.
    assert around(simulation.time - 1.0)[0] == pytest.approx(off, abs=1e-9)
    assert around(simulation.time + 0.4)[0] == pytest.approx(np.zeros(6), abs=1e-9)


def test_images_that_come_late_are_of_when_they_were_taken_and_wrong_ones_are_left_out() -> None:
    task = ConveyorPick(speed=0.2)
    wrong = Disturbance(camera_latency=0.1, pose_noise=1e-4, outliers=0.1, outlier_size=0.05)
    rng = np.random.default_rng(3)
    simulation = DisturbedSimulation(PANDA, task.build_scene, wrong, rng)
    task.reset(simulation, None)
    holder, tracker = Holder(simulation), ObjectTracker(live(simulation), "cube", 0.05)
    holder.hold(400)
    for _ in range(30):
        holder.hold(34)
        tracker.update()
    expected = simulation.object_pose("cube").translation()
    found = tracker.at(simulation.time).translation()
    assert found[:2] == pytest.approx(expected[:2], abs=2e-4)  # late by 0.1 s would be 20 mm
    assert found[2] == 0.05


@pytest.mark.parametrize("rate", [20.0, 31.0, 60.0])
def test_every_image_of_the_camera_counts_however_many_it_takes(rate: float) -> None:
    task, camera = ConveyorPick(), Disturbance(pose_noise=1e-3, camera_rate=rate)
    simulation = DisturbedSimulation(PANDA, task.build_scene, camera, np.random.default_rng(1))
    task.reset(simulation, None)
    holder, tracker = Holder(simulation), ObjectTracker(live(simulation), "cube")
    taken = 0
    for _ in range(500):
        holder.hold(1)
        taken += tracker.collect()
    assert taken == pytest.approx(0.5 * rate, abs=1.0)
