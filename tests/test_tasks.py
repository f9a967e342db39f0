"""Every task, found by looking: it can be rehearsed, has a script, and judges its own start."""

import pkgutil
from typing import Any

import numpy as np
import pytest

import scenarios
from robo47_qp.errors import PlanError
from robo47_qp.options import RunOptions
from robo47_qp.robots.panda import PANDA
from robo47_qp.runner import Runner
from robo47_qp.simulation import Simulation
from scenarios.evaluate import known_tasks

FOUND = known_tasks()
SCRIPTS = {name for _, name, _ in pkgutil.iter_modules(scenarios.__path__)}


def test_all_tasks_are_found() -> None:
    assert set(FOUND) == {
        *("pick_place", "reach", "stack", "sort", "wipe"),
        *("peg_insert", "obstacle_reach", "conveyor_pick"),
    }


@pytest.mark.parametrize("name", FOUND)
@pytest.mark.parametrize("seed", [None, 0])
def test_what_a_task_foresees_can_be_planned_and_nothing_moves(name: str, seed: int | None) -> None:
    if name == "obstacle_reach":
        pytest.importorskip("ompl", reason="the extra planning is not installed")
    task: Any = FOUND[name]()
    if seed is not None:
        task = task.variant(np.random.default_rng([seed, 2]))
    simulation = Simulation(PANDA, task.build_scene)
    runner = Runner(RunOptions(seed=seed).scenario(PANDA, task), simulation)
    before = simulation.data.qpos.copy()
    try:
        legs = runner.rehearse()
    except PlanError as error:
        pytest.fail(str(error))
    np.testing.assert_array_equal(simulation.data.qpos, before)
    # Where a task starts is home; what it foresees ends there, or is told as it goes.
    assert not legs or len(legs) >= 2
    assert task.force_max > 0.0
    assert task.name == name


@pytest.mark.parametrize("name", FOUND)
def test_a_task_has_a_script_of_its_own(name: str) -> None:
    assert name.replace("pick_place", "pickplace") in SCRIPTS
