"""What a robot must have for a task is checked before anything runs."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from robo47_qp.cli import run_command
from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.command import evaluate_command
from robo47_qp.evaluation.evaluation import evaluate_policy
from robo47_qp.evaluation.gym.env import TaskEnv
from robo47_qp.evaluation.options import EvaluateOptions
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run.start import check_clear, checked_start
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from robo47_qp.tasks.carry_tray.carry_tray import CarryTray
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from tests.robots import GRIPPER

BARE = replace(PANDA, name="bare", gripper=None)
NARROW = replace(PANDA, name="narrow", gripper=replace(GRIPPER, width_max=0.06))
WRONG: dict[str, Any] = {
    "bare": (
        BARE,
        PickPlace(),
        r"opens at least 61 mm.*panda; found bare, without",
    ),
    "narrow": (NARROW, PickPlace(), r"found narrow, whose gripper opens 60 mm"),
    "alone": (PANDA, CarryTray(), r"one with 2 tools for carry_tray, such as panda_pair; found"),
}


@dataclass(frozen=True, kw_only=True)
class Walled(PickPlace):
    """The robot's elbow stands in a wall."""

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        super().build_scene(spec)
        spec.worldbody.add_geom(
            name="wall", type=mujoco.mjtGeom.mjGEOM_BOX, pos=[0, 0, 0.6], size=[0.2, 0.2, 0.1]
        )


@pytest.mark.parametrize("case", WRONG)
def test_a_robot_that_cannot_do_the_task_is_refused_everywhere(case: str) -> None:
    robot, task, message = WRONG[case]
    with pytest.raises(InvalidValueError, match=message):
        evaluate_policy(task, robot, episodes=1, workers=1)
    with pytest.raises(InvalidValueError, match=message):
        ClassicalStack().scenario(robot, task)
    if task.tools_needed == 1:
        with pytest.raises(InvalidValueError, match=message):
            TaskEnv(task, robot=robot)


def test_a_robot_that_stands_in_the_scene_is_refused() -> None:
    with pytest.raises(InvalidValueError, match=r"panda, whose link.* is in wall"):
        checked_start(Walled(), PANDA, seed=None)
    simulation = checked_start(PickPlace(), PANDA, seed=3)
    np.testing.assert_allclose(simulation.true_state().q, PANDA.home)


def test_so_it_is_before_a_run_of_which_nothing_is_left(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    args = ["--log", str(tmp_path / "a.rrd")]
    assert run_command(f"{__file__}:Walled", args=args, prog="run") == 2
    assert "robot must be one that stands clear of everything in" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_that_a_start_is_looked_at_does_not_change_it() -> None:
    simulation, other = (Simulation(PANDA, PickPlace().build_scene) for _ in range(2))
    for one in (simulation, other):
        one.reset()
        PickPlace().reset(one, None)
    check_clear(simulation, "pick_place")
    for name in ("qpos", "qvel", "qacc", "qacc_warmstart", "sensordata", "xpos"):
        np.testing.assert_array_equal(getattr(simulation.data, name), getattr(other.data, name))


def test_an_evaluation_refuses_with_2_and_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    named = ["--task", "carry_tray", "--robot", "panda", "--log", str(tmp_path / "a.rrd")]
    assert evaluate_command(named) == 2
    assert "panda_pair" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_task_brings_the_robot_it_is_made_for() -> None:
    options = EvaluateOptions(task="carry_tray")
    assert options.robot_for(CarryTray).name == "panda_pair"
    assert options.robot_for(PickPlace).name == "panda"
    assert replace(options, robot="panda_rail").robot_for(CarryTray).name == "panda_rail"
    assert TaskEnv("pick_place").action_space.shape == (8,)
    assert TaskEnv("reach", robot="panda_rail").action_space.shape == (9,)
