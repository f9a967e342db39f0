"""Sensed: programs and policies reach what sensors and sheets say, and nothing of the world."""

import gc
from collections import deque
from collections.abc import Iterator
from functools import partial
from types import CellType, FunctionType, GeneratorType, MethodType, ModuleType
from typing import Any

import mujoco
import numpy as np
import pytest

from robo47_qp.evaluation.perturbation import PRESETS, Perturbation
from robo47_qp.evaluation.task_episode import TaskEpisode
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run.control_loop import ControlLoop
from robo47_qp.run.policy.cell import PolicyCell
from robo47_qp.run.registry import load_task, task_names
from robo47_qp.run.runner import Runner
from robo47_qp.run.steps import as_step
from robo47_qp.run.task import Task
from robo47_qp.sim.camera import ObjectCamera
from robo47_qp.sim.disturbance import Disturbance
from robo47_qp.sim.objects import SimulatedObjects
from robo47_qp.sim.sensed import Senses
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.peg_insert.peg_insert import PegInsert
from robo47_qp.tasks.wipe.board import SURFACE
from robo47_qp.tasks.wipe.wipe import Wipe
from tests.runs import live

WORLD = (
    *(Simulation, SimulatedObjects, ObjectCamera, Senses, Disturbance, Perturbation),
    *(ControlLoop, Runner, TaskEpisode),
)
"""Objects of the true world, or which lead to it."""
SINGLE = [name for name in task_names() if load_task(name).tools_needed == 1]


def reachable(root: object) -> Iterator[tuple[str, object]]:
    """All that code which is given an object can reach through it, with the way there."""
    seen: set[int] = set()
    kept: list[object] = []
    waiting: deque[tuple[str, object]] = deque([("", root)])
    while waiting:
        way, one = waiting.popleft()
        if id(one) in seen or isinstance(one, type | ModuleType | str | bytes | int | float):
            continue
        seen.add(id(one))
        kept.append(one)
        yield way, one
        waiting.extend(_parts(way, one))


def _parts(way: str, one: Any) -> Iterator[tuple[str, object]]:
    if isinstance(one, dict):
        yield from ((f"{way}[{key!r}]", value) for key, value in one.items())
        yield from ((f"{way} key", key) for key in one)
    elif isinstance(one, list | tuple | set | frozenset | deque):
        yield from ((f"{way}[{i}]", value) for i, value in enumerate(one))
    elif isinstance(one, GeneratorType):
        if one.gi_frame is not None:
            yield f"{way}.gi_frame", one.gi_frame.f_locals
        yield f"{way}.gi_yieldfrom", one.gi_yieldfrom
    elif isinstance(one, MethodType):
        yield from ((f"{way}.__self__", one.__self__), (f"{way}.__func__", one.__func__))
    elif isinstance(one, FunctionType):
        yield from ((f"{way}.__closure__", cell) for cell in one.__closure__ or ())
        yield f"{way}.__defaults__", one.__defaults__
    elif isinstance(one, CellType):
        try:
            yield f"{way}()", one.cell_contents
        except ValueError:
            return
    elif isinstance(one, partial):
        yield f"{way}.partial", (one.func, one.args, one.keywords)
    elif isinstance(one, np.ndarray):
        yield f"{way}.base", one.base
    yield f"{way}.__dict__", getattr(one, "__dict__", None)
    for name in getattr(type(one), "__slots__", ()):
        yield f"{way}.{name}", getattr(one, name, None)
    # What Python's collector knows of it besides, such as the parts of compiled objects.
    if not isinstance(one, FunctionType | GeneratorType | CellType):
        yield from ((f"{way} ...", part) for part in gc.get_referents(one))


def leaks(root: object, simulation: Simulation) -> list[str]:
    """Ways from an object into the true world."""
    m, d = simulation.model, simulation.data
    true = [d.qpos, d.qvel, d.xpos, d.mocap_pos, d.sensordata, m.body_mass, m.geom_friction]
    found = []
    for way, one in reachable(root):
        world = isinstance(one, WORLD) or one is m or one is d
        if isinstance(one, np.ndarray) and any(np.shares_memory(one, array) for array in true):
            world = True
        if world:
            found.append(f"{way}: {type(one).__name__}")
    return found


def start(task: Task, seed: int = 3) -> tuple[Runner, Simulation]:
    """The start of an episode in which everything is perturbed."""
    episode = TaskEpisode(robot=PANDA, task=task, perturbation=PRESETS["severe"])
    scenario = episode.scenario(seed)
    simulation = episode.simulation(scenario, seed)
    return Runner(scenario, simulation), simulation


@pytest.mark.parametrize("name", SINGLE)
def test_programs_reach_nothing_of_the_true_world(name: str) -> None:
    runner, simulation = start(load_task(name)())
    sensed = runner.loop.senses.read()
    task = runner.scenario.task
    program = task.program(sensed)
    steps: list[object] = [as_step(next(program)) for _ in range(2)]
    assert leaks((program, sensed, steps, task.preview(sensed)), simulation) == []


def test_policies_reach_nothing_of_the_true_world() -> None:
    runner, simulation = start(load_task("pick_place")())
    assert leaks(PolicyCell(runner.loop).observe(), simulation) == []


def hidden_ways(simulation: Simulation) -> dict[str, object]:
    def closure() -> float:
        return simulation.time

    return {
        "closure": closure,
        "method": simulation.object_pose,
        "partial": partial(max, simulation),
        "view": simulation.data.qpos[2:5],
        "nested": [{"a": (simulation.data,)}],
        "default": lambda world=simulation: world,
        "generator": (one for one in [simulation]),
    }


@pytest.mark.parametrize("way", ["closure", "method", "partial", "view", "nested", "default"])
def test_the_walk_finds_what_is_hidden(way: str) -> None:
    _, simulation = start(load_task("pick_place")())
    assert leaks(hidden_ways(simulation)[way], simulation)


def test_the_true_hole_is_not_told() -> None:
    for camera in ("none", "severe"):
        episode = TaskEpisode(robot=PANDA, task=PegInsert(), perturbation=PRESETS[camera])
        scenario = episode.scenario(1)
        runner = Runner(scenario, episode.simulation(scenario, 1))
        observation = PolicyCell(runner.loop).observe()
        assert set(observation.markers) == {"hole seen"}
        assert "hole" not in runner.loop.senses.sensed.seen


def test_the_height_of_the_board_is_not_told() -> None:
    episode = TaskEpisode(robot=PANDA, task=Wipe())
    scenario = episode.scenario(1)
    simulation = episode.simulation(scenario, 1)
    observation = PolicyCell(Runner(scenario, simulation).loop).observe()
    assert abs(simulation.marker_pose("board").translation()[2] - SURFACE) > 1e-4
    heights = {name: pose[2] for name, pose in observation.markers.items()}
    for name in ("board", *(f"mark{i}" for i in range(8))):
        assert heights[name] == SURFACE


def test_data_sheets_tell_the_level_and_not_what_was_drawn() -> None:
    runners = [start(load_task("pick_place")(), seed)[0] for seed in (1, 2)]
    first, second = (runner.loop.senses.sensed.sheet.noise for runner in runners)
    assert first == second
    assert first["mass_tolerance"] == 0.6
    assert first["size_tolerance"] == 0.0
    assert first["pose_noise"] == 4e-3


def test_the_pose_of_the_tool_is_that_of_the_measured_joints() -> None:
    runner, simulation = start(load_task("pick_place")())
    sensed = runner.loop.senses.read()
    measured = runner.loop.arm.pose(simulation.state().q)
    np.testing.assert_allclose(sensed.tool_pose().as_matrix(), measured.as_matrix(), atol=1e-12)
    assert not np.array_equal(sensed.state().q, simulation.true_state().q)


def test_measurements_are_copies() -> None:
    def nothing(spec: mujoco.MjSpec) -> None:
        """Adds nothing."""

    world = Simulation(PANDA, nothing)
    sensed = live(world)
    sensed.state().q[:] = 9.0
    sensed.felt_force()[:] = 9.0
    sensed.finger_forces()[:] = 9.0
    assert np.array_equal(sensed.state().q, world.true_state().q)
    assert not world.felt_force().any()
