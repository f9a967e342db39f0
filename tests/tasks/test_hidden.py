"""What the fingers hide from the camera is where the hand has it."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from robo47_qp.evaluation.perturbation import Perturbation
from robo47_qp.evaluation.task_episode import TaskEpisode
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.robots.panda_pair import panda_pair
from robo47_qp.run.observers import Observer
from robo47_qp.run.runner import Runner
from robo47_qp.run.task import Task
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.conveyor_pick.conveyor_pick import ConveyorPick
from robo47_qp.tasks.handover.handover import Handover
from robo47_qp.tasks.peg_insert.peg_insert import PegInsert
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from robo47_qp.tasks.stack.stack import Stack


@dataclass
class Watch(Observer):
    """Notes how far each object is from where it is seen."""

    off: list[float] = field(default_factory=list)

    def tick(self, simulation: Simulation) -> None:
        for name in simulation.objects:
            seen, true = simulation.seen_pose(name), simulation.object_pose(name)
            self.off.append(float(np.linalg.norm(seen.translation() - true.translation())))


@pytest.mark.parametrize(
    ("task", "pose_noise"),
    [
        (PickPlace(), 0.0),
        (ConveyorPick(), 0.0),
        (ConveyorPick(), 2e-3),
        (PegInsert(), 0.0),
        (Stack(), 0.0),
        (Handover(), 0.0),
    ],
)
def test_an_item_that_the_fingers_hide_is_put_where_it_belongs(
    task: Task, pose_noise: float
) -> None:
    robot = panda_pair() if isinstance(task, Handover) else PANDA
    world = Perturbation(occlusion=1, pose_noise=pose_noise)
    episode = TaskEpisode(robot=robot, task=task, perturbation=world)
    scenario, watch = episode.scenario(77_001), Watch()
    run = Runner(scenario, episode.simulation(scenario, 77_001)).run(observers=[watch])
    assert run.failure is None
    # Indeed hidden: on its way, it is still seen where it was grasped.
    assert max(watch.off) > 0.05
