"""Policies that tests share, and how they are run."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from robo47_qp.model.robot import Robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run.observers import Observer
from robo47_qp.run.policy.drivers import PolicyDriver, PolicyTiming
from robo47_qp.run.policy.policy import Action, Observation, Policy
from robo47_qp.run.recording import Sink
from robo47_qp.run.runner import Runner
from robo47_qp.run.scenario import Run
from robo47_qp.run.task import Task
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from tests.runs import Reach


@dataclass
class Scripted:
    """Answers by a function, and keeps what it saw."""

    answer: Callable[[Observation], Action | None]
    seen: list[Observation] = field(default_factory=list)
    first: Observation | None = None

    def reset(self, observation: Observation) -> None:
        self.first = observation

    def act(self, observation: Observation) -> Action | None:
        self.seen.append(observation)
        return self.answer(observation)


def follow(
    policy: Policy,
    *,
    task: Task | None = None,
    timing: PolicyTiming | None = None,
    robot: Robot = PANDA,
    simulation: Simulation | None = None,
    seed: int | None = None,
    sinks: Sequence[Sink] = (),
    observers: Sequence[Observer] = (),
) -> Run:
    """Run a policy once, by default for a second on a task without objects."""
    task = Reach() if task is None else task
    if simulation is None:
        simulation = Simulation(robot, task.build_scene)
    scenario = ClassicalStack().scenario(robot, task, seed)
    driver = PolicyDriver(policy, PolicyTiming(seconds=1.0) if timing is None else timing)
    return Runner(scenario, simulation, driver).run(sinks=sinks, observers=observers)
