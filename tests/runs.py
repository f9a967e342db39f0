"""Runs, worlds and observers that several tests share."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.arrays import Matrix
from robo47_qp.control.joint_impedance import JointImpedance
from robo47_qp.control.observer import DisturbanceObserver
from robo47_qp.model.arm import Arm, JointReference
from robo47_qp.model.obstacle import Obstacle
from robo47_qp.model.payload import Payload
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.planner import Leg
from robo47_qp.motion.waypoint import Motion, Place, Waypoint
from robo47_qp.run.failure import Failure
from robo47_qp.run.observers import Observer
from robo47_qp.run.recording import Sink
from robo47_qp.run.runner import Runner
from robo47_qp.run.scenario import Run
from robo47_qp.run.task import Program, Task
from robo47_qp.sim.sensed import Reading, Sensed, Senses
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from robo47_qp.tasks.table import add_table


def no_objects(spec: mujoco.MjSpec) -> None:
    """Adds nothing: the robot is alone."""


class _Live(Sensed):
    """Measures whenever it is asked."""

    def __init__(self, simulation: Simulation) -> None:
        super().__init__(simulation.robot, Senses(simulation).sensed.sheet, simulation.objects)
        self._senses = Senses(simulation)

    @property
    def reading(self) -> Reading:
        return self._senses.read().reading

    def tool_pose(self, tool: int = 0) -> SE3:
        return self._senses.read().tool_pose(tool)


def live(simulation: Simulation) -> Sensed:
    """What programs know of a world that a test steps itself."""
    return _Live(simulation)


ZEROS = np.zeros(len(PANDA.joints))


def make_runner(
    task: Task,
    *,
    seed: int | None = None,
    speed: float = 1.0,
    observer: DisturbanceObserver | None = ClassicalStack.observer,
    controller: str = ClassicalStack.controller,
) -> tuple[Runner, Simulation]:
    """A runner at the start of a task on the Panda, with the default choices."""
    stack = ClassicalStack(pace=speed, observer=observer, controller=controller)
    scenario = stack.scenario(PANDA, task, seed)
    simulation = Simulation(PANDA, task.build_scene)
    return Runner(scenario, simulation), simulation


def carry_out(
    task: Task,
    *,
    seed: int | None = None,
    speed: float = 1.0,
    observer: DisturbanceObserver | None = ClassicalStack.observer,
    controller: str = ClassicalStack.controller,
    sinks: Sequence[Sink] = (),
    observers: Sequence[Observer] = (),
) -> Run:
    """Run a task once; the rows cannot be written to."""
    runner, _ = make_runner(task, seed=seed, speed=speed, observer=observer, controller=controller)
    run = runner.run(sinks=sinks, observers=observers)
    run.rows.values.setflags(write=False)
    return run


@cache
def picked_and_placed(
    seed: int | None = None,
    speed: float = 1.0,
    observer: DisturbanceObserver | None = ClassicalStack.observer,
) -> Run:
    """An undisturbed run of the main job, shared by all tests of a process."""
    return carry_out(PickPlace(), seed=seed, speed=speed, observer=observer)


@dataclass(frozen=True, kw_only=True)
class Reach(Task):
    """A short job without objects: up by `rise` and home again."""

    rise: float = 0.02
    carried: Payload | None = None
    ending: Failure | None = None
    force_max: float = 60.0
    obstacles: tuple[Obstacle, ...] = ()
    name: str = "reach"

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        add_table(spec)

    def preview(self, sensed: Sensed) -> Sequence[Waypoint]:
        up = SE3.from_translation(np.array([0.0, 0.0, self.rise])) @ sensed.tool_pose()
        return [
            Waypoint(name="up", target=up, motion=Motion.LIN, carried=self.carried),
            Waypoint(name="home", target=Place.HOME),
        ]

    def program(self, sensed: Sensed) -> Program:
        yield from self.preview(sensed)
        return self.ending

    def verdict(self, simulation: Simulation) -> Failure | None:
        return None

    def measures(self, simulation: Simulation) -> dict[str, float]:
        return {"rise_m": self.rise}


@dataclass
class Witness(Observer):
    """Writes down every call."""

    phases: list[tuple[float, str]] = field(default_factory=list)
    legs: list[tuple[float, Leg, dict[str, Matrix]]] = field(default_factory=list)
    notes: list[tuple[float, str, str]] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    calls: list[str] = field(default_factory=list)

    def planned(self, time: float, leg: Leg, tool_paths: Mapping[str, Matrix]) -> None:
        self.legs.append((time, leg, {name: path.copy() for name, path in tool_paths.items()}))
        self.calls.append("planned")

    def phase(self, time: float, name: str) -> None:
        self.phases.append((time, name))
        self.calls.append("phase")

    def note(self, time: float, text: str, level: str) -> None:
        self.notes.append((time, text, level))
        self.calls.append("note")

    def tick(self, simulation: Simulation) -> None:
        self.times.append(simulation.time)
        self.calls.append("tick")


@dataclass
class Meddler(Observer):
    """Does something to the world once, or each time, in the middle of a phase."""

    name: str
    """The phase."""
    act: Callable[[Simulation], None]
    times: int = 1
    """How often to act at most, once per beginning of the phase."""
    after: float = 0.0
    """How long into the phase [s]."""
    done: int = 0
    _since: float | None = None

    def phase(self, time: float, name: str) -> None:
        self._since = time if name == self.name else None

    def tick(self, simulation: Simulation) -> None:
        if self._since is None or self.done >= self.times:
            return
        if simulation.time >= self._since + self.after:
            self._since = None
            self.done += 1
            self.act(simulation)


def moves_cube(x: float, y: float) -> Callable[[Simulation], None]:
    """Puts the cube, as it is turned, on the table at x and y [m]."""

    def act(simulation: Simulation) -> None:
        rotation = simulation.object_pose("cube").rotation()
        pose = SE3.from_rotation_and_translation(rotation, np.array([x, y, 0.02]))
        simulation.place_object("cube", pose)

    return act


def at_rest(simulation: Simulation) -> None:
    """Let a second go by in which nothing moves, as before a verdict."""
    simulation.data.time += 1.0


class Holder:
    """Holds the arm at home by joint impedance while the world goes on."""

    def __init__(self, simulation: Simulation) -> None:
        self.simulation = simulation
        self._arm = Arm(PANDA)
        self._reference = JointReference(PANDA.home, ZEROS, ZEROS)
        self._controller = JointImpedance()

    def hold(self, steps: int, look: Callable[[], None] | None = None) -> None:
        for _ in range(steps):
            state = self.simulation.state()
            self.simulation.step(self._controller.torque(self._arm, self._reference, state))
            if look is not None:
                look()
