"""Verdicts go by true sizes, not by data sheets, and see what is below the table."""

from collections.abc import Callable
from typing import Any, cast

import numpy as np
import pytest

from robo47_qp.evaluation.perturbation import PRESETS, Perturbation
from robo47_qp.evaluation.task_episode import TaskEpisode
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run.failure import Failure
from robo47_qp.run.registry import load_task
from robo47_qp.run.runner import Runner
from robo47_qp.sim.disturbance import DisturbedSimulation
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.goal import marked_goal
from robo47_qp.tasks.heading import heading, upright
from robo47_qp.tasks.item import Item
from robo47_qp.tasks.sort.sort import Sort
from robo47_qp.tasks.table import TABLE_TOP
from robo47_qp.tasks.task_state import hide_marker
from robo47_qp.tasks.wipe.board import mark

Puts = Callable[[Simulation, Any], None]
GROUND = -0.70
"""Height of what the table stands on [m]."""


class Put:
    """Puts things where a test wants them, and waits."""

    def __init__(self, simulation: Simulation, puts: Puts) -> None:
        self.simulation, self.puts = simulation, puts

    def drive(self, runner: Runner) -> Failure | None:
        runner.loop.begin("put")
        self.puts(self.simulation, runner.scenario.task)
        runner.loop.hold(0.8)
        return None


def verdict(name: str, size: float, puts: Puts, seed: int = 3) -> str:
    """Return why things are not where they should be; nothing if they are."""
    worlds = Perturbation(object_size=size)
    episode = TaskEpisode(robot=PANDA, task=load_task(name)(), perturbation=worlds)
    scenario = episode.scenario(seed)
    simulation = episode.simulation(scenario, seed)
    assert isinstance(simulation, DisturbedSimulation)
    run = Runner(scenario, simulation, Put(simulation, puts)).run()
    return "" if run.failure is None else run.failure.evidence


def exactly(
    simulation: Simulation, item: Item, x: float, y: float, bottom: float, a: float
) -> None:
    """Put an item down with its bottom at a height, whatever its size is."""
    height = item.as_in(simulation).height
    Simulation.place_object(simulation, item.name, upright([x, y, bottom + 0.5 * height], a))


def at_goal(simulation: Simulation, task: Any) -> None:
    goal = marked_goal(simulation)
    x, y, z = goal.translation()
    exactly(simulation, task.item, x, y, z, heading(goal))


def in_place(simulation: Simulation, task: Any) -> None:
    place = simulation.marker_pose("place of the sponge")
    x, y, z = place.translation()
    exactly(simulation, task.sponge, x, y, z, heading(place))


def tower(simulation: Simulation, task: Any) -> None:
    goal = marked_goal(simulation)
    x, y, z = goal.translation()
    for cube in task.cubes:
        exactly(simulation, cube, x, y, z, heading(goal))
        z += cube.as_in(simulation).height


def in_bins(simulation: Simulation, task: Any, bottom: float = TABLE_TOP) -> None:
    for where in task.bins:
        own = [item for item in task.items if item.rgba == where.rgba]
        for item, (x, y) in zip(own, where.slots, strict=False):
            exactly(simulation, item, x, y, bottom, 0.3)


def in_hole(simulation: Simulation, task: Any, below: float = 0.03) -> None:
    x, y, z = simulation.marker_pose("hole").translation()
    exactly(simulation, task.peg, x, y, z - below, 0.0)


@pytest.mark.parametrize("size", [-0.1, 0.0, 0.05, 0.3])
@pytest.mark.parametrize(
    ("name", "puts"),
    [("pick_place", at_goal), ("conveyor_pick", at_goal), ("stack", tower), ("sort", in_bins)],
)
def test_what_stands_where_it_should_is_there_whatever_its_size(
    name: str, puts: Puts, size: float
) -> None:
    assert verdict(name, size, puts) == ""


@pytest.mark.parametrize("size", [-0.1, 0.0, 0.1])
def test_a_sponge_in_its_place_is_there_whatever_its_size(size: float) -> None:
    """The marks are still there, which is told first: the distance is a measure."""
    episode = TaskEpisode(
        robot=PANDA, task=load_task("wipe")(), perturbation=Perturbation(object_size=size)
    )
    simulation = episode.simulation(episode.scenario(3), 3)
    in_place(simulation, episode.task)
    assert episode.task.measures(simulation)["sponge_error_m"] < 1e-9


def test_a_thin_peg_is_as_deep_as_its_end() -> None:
    found = load_task("peg_insert")()
    for size in (-0.2, 0.0):
        episode = TaskEpisode(robot=PANDA, task=found, perturbation=Perturbation(object_size=size))
        simulation = episode.simulation(episode.scenario(3), 3)
        in_hole(simulation, found)
        assert found.measures(simulation)["depth_m"] == pytest.approx(0.03, abs=1e-9)


def test_below_the_table_nothing_is_where_it_should_be() -> None:
    assert verdict("sort", 0.0, in_bins) == ""
    found = verdict("sort", 0.0, lambda world, task: in_bins(world, task, GROUND))
    assert "m, and not all of it is in the" in found
    assert verdict("peg_insert", 0.0, in_hole) == ""
    found = verdict("peg_insert", 0.0, lambda world, task: in_hole(world, task, 0.04 - GROUND))
    assert found == "the peg is 740.0 mm below the top of the hole, which is 30 mm deep"


def test_an_item_knows_its_lengths_in_a_world() -> None:
    episode = TaskEpisode(
        robot=PANDA, task=load_task("pick_place")(), perturbation=Perturbation(object_size=0.25)
    )
    scenario = episode.scenario(3)
    item = scenario.task.item  # type: ignore[attr-defined]
    true = item.as_in(episode.simulation(scenario, 3))
    np.testing.assert_allclose(true.size, 1.25 * np.array(item.size), rtol=1e-12)
    assert item.as_in(Simulation(PANDA, scenario.task.build_scene)) is item


def test_a_larger_item_across_the_wall_is_not_in_its_bin() -> None:
    """The nominal one would be, by 1 mm."""
    found = {}
    for size in (0.0, 0.3):
        episode = TaskEpisode(
            robot=PANDA, task=load_task("sort")(), perturbation=Perturbation(object_size=size)
        )
        scenario = episode.scenario(3)
        simulation, task = episode.simulation(scenario, 3), cast(Sort, scenario.task)
        in_bins(simulation, task)
        item = task.items[0]
        (where,) = (one for one in task.bins if one.rgba == item.rgba)
        x = where.centre[0] + 0.5 * (where.size[0] - item.size[0]) - 0.001
        exactly(simulation, item, x, where.centre[1], TABLE_TOP, 0.0)
        failure = task.verdict(simulation)
        found[size] = "" if failure is None else failure.evidence
    assert "not all of it is in the" not in found[0.0]
    assert "not all of it is in the" in found[0.3]


def test_hidden_marks_are_seen_where_they_are_hidden() -> None:
    episode = TaskEpisode(robot=PANDA, task=load_task("wipe")(), perturbation=PRESETS["severe"])
    scenario = episode.scenario(3)
    simulation = episode.simulation(scenario, 3)
    scenario.task.reset(simulation, np.random.default_rng(3))
    names = [mark(i) for i in range(3)]
    for name in names[:2]:
        hide_marker(simulation, name)
        pose = simulation.seen_marker(name)
        assert pose.wxyz_xyz.tolist() == [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0]
    seen, true = (f(names[2]) for f in (simulation.seen_marker, simulation.marker_pose))
    assert np.linalg.norm(seen.translation() - true.translation()) > 1e-3
