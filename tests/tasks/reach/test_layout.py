"""Post and shelf stand where the cell of a robot has them, and stay as much in the way."""

from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from robo47_qp.errors import InvalidValueError, PlanError
from robo47_qp.evaluation import command
from robo47_qp.evaluation.command import evaluate_chosen
from robo47_qp.evaluation.options import EvaluateOptions
from robo47_qp.model.cell import CELLS, Cell, in_cell
from robo47_qp.model.robot import Robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run.runner import Runner
from robo47_qp.run.task import Task, task_of_options
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from robo47_qp.tasks.reach.obstacle_reach import ObstacleReach
from robo47_qp.tasks.reach.reach import Reach
from tests.robots import robot_or_skip

CELL = CELLS["iiwa14", "obstacle_reach"]
STANDS = CELL.with_robot(replace(PANDA, name="iiwa14"))
"""An arm in the cell of the iiwa14, without its files."""
LAID_OUT = ObstacleReach().laid_out(STANDS)


def drawn(task: ObstacleReach, seed: int) -> ObstacleReach:
    return task.variant(np.random.default_rng([seed, 2]))


def test_for_other_arms_a_seed_draws_the_same_scene_as_ever() -> None:
    task = ObstacleReach().laid_out(PANDA)
    assert task == ObstacleReach()
    scene = drawn(task, 2)
    assert scene.post == (0.3598719302367141, 0.19762592331517218)
    assert scene.shelf == (0.39467803308751676, -0.4265267640201275)
    assert (scene.post_radius, scene.post_height) == (0.04166115640892929, 0.3770903980497727)
    assert scene.shelf_height == 0.5302507705978874


def test_the_cell_moves_post_and_shelf_along_their_radii() -> None:
    for seed in range(50):
        scene, usual = drawn(LAID_OUT, seed), drawn(ObstacleReach(), seed)
        for place, moved in (("post", -0.03), ("shelf", 0.03)):
            there, where = np.array(getattr(scene, place)), np.array(getattr(usual, place))
            away = where / np.linalg.norm(where)
            np.testing.assert_allclose(there, where + moved * away, atol=1e-12)
        same = {name: getattr(usual, name) for name in ("post", "shelf")}
        ranges = {name: getattr(usual, name) for name in ("post_distance", "shelf_distance")}
        assert replace(scene, **same, **ranges) == usual


def test_what_was_chosen_and_what_stands_elsewhere_is_not_moved() -> None:
    chosen = ObstacleReach(post_distance=(0.37, 0.38))
    assert chosen.laid_out(STANDS) == replace(LAID_OUT, post_distance=(0.37, 0.38))
    elsewhere = Cell.at(0.0, 0.0, 0.1).with_robot(STANDS)
    assert ObstacleReach().laid_out(elsewhere) == ObstacleReach()
    assert Reach().laid_out(STANDS) == Reach()


@pytest.mark.parametrize("task", [ObstacleReach(), LAID_OUT], ids=["usual", "laid out"])
def test_the_targets_are_behind_the_post_and_under_the_shelf(task: ObstacleReach) -> None:
    simulation = Simulation(PANDA, task.build_scene)
    for seed in range(100):
        scene = drawn(task, seed)
        scene.reset(simulation, np.random.default_rng(seed))
        post, board = (one.T_world_obstacle for one in scene.obstacles[1:3])
        target = simulation.marker_pose("behind post").translation()
        # The straight way from above the base to the target goes through the post.
        way = target[:2] / np.linalg.norm(target[:2])
        along = way @ post.translation()[:2]
        assert 0.2 < along < np.linalg.norm(target[:2]) - 0.19
        aside = np.linalg.norm(post.translation()[:2] - along * way)
        assert aside < scene.post_radius
        assert target[2] < scene.post_height - 0.14
        assert target[2] >= 0.08
        at = (board.inverse() @ simulation.marker_pose("under shelf")).translation()
        out, across, _ = scene.obstacles[2].size
        assert abs(at[0]) < out
        assert abs(at[1]) < across
        assert -0.28 < at[2] < -0.19


def blocked(robot: Robot, task: ObstacleReach, seeds: range) -> int:
    """How often the plan is refused where nothing but straight motions is tried."""
    refusals = list[str]()
    for seed in seeds:
        scene = drawn(task.laid_out(robot), seed)
        scenario = ClassicalStack().scenario(robot, scene, seed)
        straight = replace(scenario, planner=replace(scenario.planner, detour=None))
        simulation = Simulation(robot, scene.build_scene, drawn=False)
        try:
            Runner(straight, simulation).rehearse()
        except PlanError as error:
            refusals.append(str(error))
    assert all("come within" in told for told in refusals), refusals
    return len(refusals)


def test_straight_motions_of_the_iiwa14_are_blocked_as_often_as_those_of_the_panda() -> None:
    iiwa14, seeds = in_cell(robot_or_skip("iiwa14"), "obstacle_reach"), range(8)
    usual = blocked(PANDA, ObstacleReach(), seeds)
    assert usual >= 4
    assert blocked(iiwa14, ObstacleReach(), seeds) >= usual


def test_a_run_and_an_evaluation_are_laid_out(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = in_cell(robot_or_skip("iiwa14"), "obstacle_reach")
    assert task_of_options(ObstacleReach, {}, None, robot) == LAID_OUT
    assert task_of_options(ObstacleReach, {}, 3, robot) == drawn(LAID_OUT, 3)
    seen = list[Task]()

    def evaluate(task: Task, *_: object) -> int:
        seen.append(task)
        return 0

    monkeypatch.setattr(command, "evaluate", evaluate)
    evaluate_chosen(EvaluateOptions(task="obstacle_reach", robot="iiwa14"), Console())
    assert seen == [LAID_OUT]


def test_an_environment_is_laid_out() -> None:
    pytest.importorskip("gymnasium", reason="the extra gym is not installed")
    from robo47_qp.evaluation.gym.env import TaskEnv

    env = TaskEnv("obstacle_reach", robot=STANDS)
    try:
        assert env._task == LAID_OUT
    finally:
        env.close()


@pytest.mark.parametrize("found", [(0.4, 0.3), (0.0, 0.3), (0.3, np.inf), (0.3,), (np.nan, 0.3)])
def test_distances_are_a_least_and_a_largest(found: tuple[float, float]) -> None:
    with pytest.raises(InvalidValueError, match=r"shelf_distance must be two (finite )?numbers"):
        ObstacleReach(shelf_distance=found)
