"""Every task, found by looking: rehearsed, scripted, and judged the same whoever moves the arm."""

import json
import pkgutil
import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import scenarios
from robo47_qp.constants import TASKS
from robo47_qp.errors import InvalidValueError, PlanError, UnknownNameError
from robo47_qp.model.arm import Arm
from robo47_qp.model.cell import in_cell
from robo47_qp.model.robot import Robot
from robo47_qp.model.robots import robot_names
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.robots.panda_pair import panda_pair
from robo47_qp.motion.waypoint import Place
from robo47_qp.run import registry
from robo47_qp.run.failure import Cause
from robo47_qp.run.foreign_code import ClassLoadError
from robo47_qp.run.policy.drivers import PolicyTiming
from robo47_qp.run.registry import load_task, task_names
from robo47_qp.run.runner import Runner
from robo47_qp.run.task import Task
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from scenarios.policies.random_targets import RandomTargets
from tests.policies import follow
from tests.robots import robot_or_skip

PYPROJECT = Path(__file__).parents[2] / "pyproject.toml"
DECLARED: dict[str, str] = tomllib.loads(PYPROJECT.read_text())["project"]["entry-points"][TASKS]
FOUND = {name: load_task(place) for name, place in DECLARED.items()}
PAIR = panda_pair()
SEVERE = sorted((PYPROJECT.parent / "docs" / "results").glob("success_severe_*.json"))
SCRIPTS = {name for _, name, _ in pkgutil.iter_modules(scenarios.__path__)}


def test_all_tasks_are_found() -> None:
    assert set(FOUND) == {
        *("pick_place", "reach", "stack", "sort", "wipe"),
        *("peg_insert", "obstacle_reach", "conveyor_pick", "handover", "carry_tray"),
    }
    assert set(task_names()) <= set(FOUND)


@pytest.mark.parametrize(
    ("place", "why"),
    [
        ("no_such_package.lift:Lift", "ModuleNotFoundError: No module named 'no_such_package'"),
        ("robo47_qp.run.task:Nothing", "robo47_qp.run.task has no Nothing"),
        ("pathlib:Path", "it has no build_scene and no program and no verdict"),
    ],
)
def test_an_installed_task_that_cannot_be_loaded_says_why(
    monkeypatch: pytest.MonkeyPatch, place: str, why: str
) -> None:
    entry = EntryPoint(name="lift", value=place, group=TASKS)
    monkeypatch.setattr(registry, "entry_points", lambda **_: [entry])
    with pytest.raises(ClassLoadError, match=f"The task '{place}' cannot be loaded: {why}"):
        load_task("lift")
    with pytest.raises(UnknownNameError, match=r"No task is called 'drop'.* lift"):
        load_task("drop")


def robot_for(task: type[Task]) -> Robot:
    return PAIR if task.tools_needed == 2 else PANDA


def check_contacts(robot: Robot, task: Task) -> None:
    """Check that what holds or bears an item is no more grippy than the least of the items.

    MuJoCo takes the larger one of two coefficients: else those of the items would not count.
    """
    simulation = Simulation(robot, task.build_scene)
    model, robots_own = simulation.model, Arm(robot).model
    grippers = {name for tool in robot.tools if tool.gripper for name in tool.gripper.fingers}
    links = {robots_own.body(i).name for i in range(1, robots_own.nbody)} - grippers
    obstacles = {obstacle.name for obstacle in task.obstacles}
    for geom in range(model.ngeom):
        body, name = model.body(int(model.geom_bodyid[geom])).name, model.geom(geom).name
        touches = model.geom_contype[geom] | model.geom_conaffinity[geom]
        # What the task declares as an obstacle bears nothing.
        touches = touches and (name == "table" or name not in obstacles)
        if touches and body not in links and body not in simulation.objects:
            # The walls of a hole are 0.3, as its peg is.
            assert model.geom_friction[geom, 0] <= 0.3, f"{name} of {body}"
            assert model.geom_friction[geom, 1] <= 0.005, f"{name} of {body}"
    for item in simulation.objects:
        for one in model.geom_friction[model.geom_bodyid == model.body(item).id]:
            assert one[0] <= 0.9
            assert one[1] <= 0.005


@pytest.mark.parametrize("name", FOUND)
def test_contacts_are_not_kind(name: str) -> None:
    check_contacts(robot_for(FOUND[name]), FOUND[name]())


@pytest.mark.parametrize("name", sorted({*robot_names()} - {"panda_pair"}))
def test_contacts_are_not_kind_with_any_gripper(name: str) -> None:
    task = FOUND["pick_place"]()
    check_contacts(in_cell(robot_or_skip(name), task.name), task)


@pytest.mark.parametrize("name", ["handover", "carry_tray"])
def test_a_task_for_two_arms_refuses_one(name: str) -> None:
    with pytest.raises(InvalidValueError, match="panda_pair"):
        ClassicalStack().scenario(PANDA, FOUND[name]())


@pytest.mark.parametrize("name", FOUND)
def test_what_a_task_foresees_can_be_planned_and_nothing_moves(name: str) -> None:
    """With a seed: what is foreseen without one is planned where the task's own tests run it."""
    task: Any = FOUND[name]().variant(np.random.default_rng([0, 2]))
    robot = robot_for(FOUND[name])
    simulation = Simulation(robot, task.build_scene)
    runner = Runner(ClassicalStack().scenario(robot, task, 0), simulation)
    before = simulation.data.qpos.copy()
    try:
        legs = runner.rehearse()
    except PlanError as error:
        pytest.fail(str(error))
    np.testing.assert_array_equal(simulation.data.qpos, before)
    # Where a task starts is home; what it foresees ends there.
    assert len(legs) >= 2
    assert legs[-1].waypoint.target is Place.HOME
    assert task.name == name


@pytest.mark.parametrize("name", FOUND)
def test_a_task_has_a_script_of_its_own(name: str) -> None:
    assert name.replace("pick_place", "pickplace") in SCRIPTS


def state(simulation: Simulation, kinds: int) -> np.ndarray:
    found = np.zeros(mujoco.mj_stateSize(simulation.model, kinds))
    mujoco.mj_getState(simulation.model, simulation.data, found, kinds)
    return found


@pytest.mark.parametrize("name", FOUND)
def test_a_task_notices_without_meddling_and_is_not_done_at_its_start(name: str) -> None:
    task = FOUND[name]()
    simulation = Simulation(robot_for(FOUND[name]), task.build_scene)
    task.reset(simulation, np.random.default_rng(0))
    start = task.verdict(simulation)
    assert start is not None
    assert start.cause in Cause
    assert start.evidence
    kinds = mujoco.mjtState
    own = int(kinds.mjSTATE_USERDATA | kinds.mjSTATE_MOCAP_POS | kinds.mjSTATE_MOCAP_QUAT)
    rest = int(kinds.mjSTATE_INTEGRATION) & ~own
    before, notes = state(simulation, rest), state(simulation, own)
    # The arm is where its goals are, so that there is something to notice.
    for marker in simulation.markers:
        simulation.place_marker(marker, simulation.tool_pose())
    for _ in range(3):
        task.monitor(simulation)
    np.testing.assert_array_equal(state(simulation, rest), before)
    # A reset forgets it all.
    simulation.reset()
    task.reset(simulation, np.random.default_rng(0))
    np.testing.assert_array_equal(state(simulation, own), notes)


@pytest.mark.parametrize("name", FOUND)
def test_a_policy_may_try_every_task_and_fails_with_a_cause(name: str) -> None:
    timing, robot = PolicyTiming(seconds=0.4), robot_for(FOUND[name])
    run = follow(RandomTargets(), task=FOUND[name](), timing=timing, robot=robot, seed=0)
    assert run.failure is not None
    assert run.failure.cause is Cause.PLACE
    assert len(run.rows) >= 400


@pytest.mark.parametrize("file", SEVERE, ids=lambda file: file.stem)
def test_pushes_come_within_the_time_that_a_task_took_where_much_was_wrong(file: Path) -> None:
    """In the kept evaluation of it."""
    result = json.loads(file.read_text("utf-8"))
    took = result["figures"]["cycle_time_s"]["median"]
    assert FOUND[result["task"]]().usual_time == pytest.approx(took, rel=0.2)


@pytest.mark.parametrize("name", FOUND)
def test_the_page_tells_what_is_judged_by_the_numbers_of_the_code(name: str) -> None:
    page = (Path(__file__).parents[2] / "docs" / "tasks.md").read_text()
    section = page.split(f"### `{name}`\n")[1].split("\n#")[0]
    told = " ".join(section.split())
    demands = FOUND[name]().judged
    assert demands
    for demand in demands:
        assert f"- {demand[0].upper()}{demand[1:]}." in told
    assert section.count("\n- ") == len(demands)
    assert FOUND[name]().fixed_force_max == 10.0
    assert "`fixed_force_max` (10 N)" in page
