"""Robots of files: an MJCF with a TOML beside it; hands and cells."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.errors import InvalidValueError, ModelError, Robo47Error, UnknownNameError
from robo47_qp.evaluation.command import evaluate_command
from robo47_qp.evaluation.options import EvaluateOptions
from robo47_qp.model.arm import Arm
from robo47_qp.model.cell import CELLS, Cell, in_cell
from robo47_qp.model.mjcf import robot_spec
from robo47_qp.model.robots import load_robot
from robo47_qp.model.robots.fr3 import FR3
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.robots.ur5e import UR5E
from robo47_qp.run.runner import Runner
from robo47_qp.run.task import Task
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from robo47_qp.tasks.reach.obstacle_reach import ObstacleReach
from tests.robots import MODELS, robot_or_skip

WHOLE = """
home = [0.0, 0.26, 0.0, 1.9, 0.0, 0.98, 0.0]
armature = [0.3, 0.3, 0.3, 0.3, 0.1, 0.1, 0.1]

[hand]
name = "parallel_gripper"
site = "tool"
turn = 1.5707963267948966

[ratings]
tau_max = [60.0, 60.0, 60.0, 60.0, 20.0, 20.0, 20.0]

[cell]
position = [-0.05, 0.0, 0.0]
"""
HOME = "home = [0.0, 0.26, 0.0, 1.9, 0.0, 0.98, 0.0]\n"
BAD = {
    "there is no file": (None, ModelError, r"needs a description .*arm.toml"),
    "it is no TOML": ("home = [", ModelError, r"arm.toml cannot be read"),
    "home is missing": ('tcp = "tool"', InvalidValueError, r"home of the description.*arm.toml"),
    "the tool is missing": (HOME, InvalidValueError, r"tcp of the description"),
    "a key is unknown": (HOME + 'tpc = "tool"', UnknownNameError, r"'tpc'; known: name, home"),
    "a table is unknown": (
        HOME + "[grippper]\nx = 1",
        UnknownNameError,
        r"'grippper'; known: tool",
    ),
    "a hand is unknown": (HOME + '[hand]\nname = "claw"\nsite = "tool"', UnknownNameError, "claw"),
    "a rating is missing": (
        HOME + 'tcp = "tool"\n[ratings]\nv_max = [1, 1, 1, 1, 1, 1, 1]',
        InvalidValueError,
        r"a_max of \[ratings\]",
    ),
    "a site is missing": (HOME + 'tcp = "flange"', UnknownNameError, r"site.*'flange'"),
    "home has six numbers": ('tcp = "tool"\nhome = [0, 0, 0, 1, 0, 1]', InvalidValueError, "home"),
}
TOOL = HOME + 'tcp = "tool"\n'
HAND = HOME + '[hand]\nsite = "tool"\n'
GRIPPER = (
    'fingers = ["left", "right"]\nactuator = "grip"\n'
    "width_max = 0.08\nspeed_max = 0.1\nforce_max = 40\nforce_gain = 1\n"
)
WRONG = {
    "yaw = nan": (TOOL + "[cell]\nposition = [0, 0, 0]\n", "yaw of [cell]", "a finite number"),
    "yaw = 'left'": (TOOL + "[cell]\nposition = [0, 0, 0]\n", "yaw of [cell]", "a finite number"),
    "position = [0, 0, true]": (TOOL + "[cell]\n", "position of [cell]", "finite numbers"),
    "neighbours_apart = 'false'": (TOOL, "neighbours_apart of the description", "true or false"),
    "neighbours_apart = 1": (TOOL, "neighbours_apart of the description", "true or false"),
    "name = 5": (TOOL, "name of the description", "a text"),
    "tcp = 5": (HOME, "tcp of the description", "a text"),
    "joints = 3": (TOOL, "joints of the description", "a list of texts"),
    "joints = [['a']]": (TOOL, "joints of the description", "a list of texts"),
    "armature = 'x'": (TOOL, "armature of the description", "a list of finite numbers"),
    "home = ['0', 0, 0, 0, 0, 0, 0]": ("tcp = 'tool'\n", "home of the description", "numbers"),
    "turn = 'x'": (HAND + 'name = "parallel_gripper"\n', "turn of [hand]", "a finite number"),
    "turn = inf": (HAND + 'name = "parallel_gripper"\n', "turn of [hand]", "a finite number"),
    "mjcf = 3": (HAND, "mjcf of [hand]", "a text"),
    "joints = 4": (TOOL + "[gripper]\n" + GRIPPER, "joints of [gripper]", "a list of two texts"),
    "joints = ['one']": (TOOL + "[gripper]\n" + GRIPPER, "joints of [gripper]", "two texts"),
    "v_max = [[1], [1, 2]]": (TOOL + "[ratings]\n", "v_max of [ratings]", "finite numbers"),
    f"tau_max = [1{400 * '0'}]": (TOOL + "[ratings]\n", "tau_max of [ratings]", "finite numbers"),
    "j_max = [nan]": (TOOL + "[profile]\n", "j_max of [profile]", "a list of finite numbers"),
    "body = 5": (HOME + "[tool]\n", "body of [tool]", "a text"),
    "hand = 3": (TOOL, "[hand]", "a table"),
    "stiffness = [-5, 5, 5, 5, 5, 5, 5]": (TOOL + "[ratings]\n", "stiffness", "above 0"),
    "armature = [-5, 0, 0, 0, 0, 0, 0]": (TOOL, "armature", "0 or more"),
}
"""A line, what stands before it, what the message calls the key, and what it expects."""


def described(folder: Path, text: str | None) -> str:
    path = folder / "arm.xml"
    shutil.copy(MODELS / "free7.xml", path)
    if text is not None:
        path.with_suffix(".toml").write_text(text, encoding="utf-8")
    return str(path)


def test_a_robot_of_a_file_picks_and_places(tmp_path: Path) -> None:
    path = described(tmp_path, WHOLE)
    robot = load_robot(path)
    assert robot.name == "arm"
    assert robot.tau_max.tolist() == [60.0] * 4 + [20.0] * 3
    assert load_robot(str(Path(path).with_suffix(".toml"))).joints == robot.joints
    assert EvaluateOptions(robot=path).robot_for(PickPlace).mjcf == robot.mjcf
    arm = Arm(robot)
    np.testing.assert_allclose(arm.model.dof_armature, [0.3] * 4 + [0.1] * 3)
    bare = Arm(load_robot(described(tmp_path, HOME + 'tcp = "tool"')))
    moved = SE3.from_translation(np.array([-0.05, 0.0, 0.0])) @ bare.pose(bare.home)
    turned = SE3.from_rotation_and_translation(
        SO3.from_z_radians(np.pi / 2), np.array([0, 0, 0.155])
    )
    np.testing.assert_allclose(
        arm.pose(arm.home).as_matrix(), (moved @ turned).as_matrix(), atol=1e-9
    )
    task = PickPlace(pick=(0.40, 0.10), place=(0.40, -0.10))
    run = Runner(ClassicalStack().scenario(robot, task), Simulation(robot, task.build_scene)).run()
    assert run.failure is None


@pytest.mark.parametrize("case", BAD)
def test_what_is_wrong_is_told_and_ends_with_2(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, kind, message = BAD[case]
    path = described(tmp_path, text)
    with pytest.raises(kind, match=message) as caught:
        load_robot(path)
    assert isinstance(caught.value, Robo47Error)
    assert evaluate_command(["--robot", path, "--log", str(tmp_path / "a.rrd")]) == 2
    assert "error:" in capsys.readouterr().err


@pytest.mark.parametrize("line", WRONG, ids=[line[:40] for line in WRONG])
def test_a_value_of_the_wrong_kind_is_told_with_file_and_key(line: str, tmp_path: Path) -> None:
    before, key, expected = WRONG[line]
    path = described(tmp_path, before + line)
    message = rf"^{re.escape(key)} in .*arm\.toml must be .*{expected}.*; found .*\.$"
    with pytest.raises(InvalidValueError, match=message):
        load_robot(path)


def test_whole_numbers_are_numbers(tmp_path: Path) -> None:
    whole = TOOL + "armature = [1, 0, 0, 0, 0, 0, 0]\nneighbours_apart = true\n"
    robot = load_robot(described(tmp_path, whole + "[cell]\nposition = [1, 0, 0]\nyaw = 1\n"))
    assert robot.armature is not None
    assert robot.armature.tolist() == [1.0] + 6 * [0.0]
    assert robot.neighbours_apart
    assert robot.T_world_base is not None
    assert robot.T_world_base.rotation().compute_yaw_radians() == pytest.approx(1.0)


@pytest.mark.parametrize("yaw", [np.nan, np.inf])
def test_a_cell_at_no_pose_is_refused(yaw: float) -> None:
    with pytest.raises(InvalidValueError, match="T_world_base of a cell must be a vector of 7"):
        Cell.at(0.0, 0.0, yaw=yaw)


def test_a_cell_moves_the_robot_and_all_that_hangs_on_it() -> None:
    cell = Cell.at(0.2, -0.1, 0.05, yaw=0.7)
    for robot in (PANDA, UR5E):
        arm, there = Arm(robot), Arm(cell.with_robot(robot))
        wanted = cell.T_world_base @ arm.pose(arm.home)
        np.testing.assert_allclose(there.pose(arm.home).as_matrix(), wanted.as_matrix(), atol=1e-12)
    assert in_cell(PANDA) is PANDA
    assert in_cell(UR5E).T_world_base is CELLS["ur5e", None].T_world_base
    assert in_cell(UR5E, "reach").T_world_base is CELLS["ur5e", None].T_world_base
    iiwa14 = replace(PANDA, name="iiwa14")
    low, high = (in_cell(iiwa14, task).T_world_base for task in ("reach", "obstacle_reach"))
    assert low is not None
    assert high is not None
    assert low.translation()[2] == 0.0
    # Where it stands high, it stands on something.
    pedestal = robot_spec(in_cell(iiwa14, "obstacle_reach")).geom("pedestal")
    assert pedestal is not None
    assert pedestal.pos[2] + pedestal.size[1] == pytest.approx(high.translation()[2])
    np.testing.assert_allclose(pedestal.pos[:2], high.translation()[:2])
    assert EvaluateOptions(robot="ur5e").robot_for(PickPlace).T_world_base is not None


@pytest.mark.parametrize("tilt", [np.pi, 0.5 * np.pi])
def test_a_base_that_hangs_or_is_on_a_wall_has_no_pedestal(tilt: float) -> None:
    """It would go through the arm."""
    place = SE3.from_rotation_and_translation(SO3.from_x_radians(tilt), np.array([0.0, 0.0, 1.5]))
    m = robot_spec(replace(PANDA, T_world_base=place)).compile()
    d = mujoco.MjData(m)
    for name, q in zip(PANDA.joints, PANDA.home, strict=True):
        d.joint(name).qpos[0] = q
    mujoco.mj_forward(m, d)
    assert not d.ncon


@pytest.mark.parametrize("task", [ObstacleReach, ObstacleReach()])
def test_a_command_puts_a_robot_into_the_cell_of_its_task(task: Task | type[Task]) -> None:
    robot_or_skip("iiwa14")
    robot = EvaluateOptions(robot="iiwa14").robot_for(task)
    assert robot.T_world_base is CELLS["iiwa14", "obstacle_reach"].T_world_base


UR_DH = zip(
    [0.0, -0.425, -0.3922, 0.0, 0.0, 0.0],
    [0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996],
    [np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0],
    strict=True,
)
"""a, d and alpha of the UR5e (Universal Robots, DH parameters)."""


def test_the_ur5e_is_that_of_the_published_dh_table(rng: np.random.Generator) -> None:
    arm, table = Arm(UR5E), list(UR_DH)
    tool = SE3.from_rotation_and_translation(
        SO3.from_z_radians(-np.pi / 2), np.array([0, 0, 0.155])
    )
    for q in rng.uniform(-np.pi, np.pi, (20, 6)):
        T = SE3.from_rotation(SO3.from_z_radians(np.pi))
        for (a, d, alpha), angle in zip(table, q, strict=True):
            T = T @ SE3.from_rotation(SO3.from_z_radians(angle))
            T = T @ SE3.from_translation(np.array([a, 0.0, d]))
            T = T @ SE3.from_rotation(SO3.from_x_radians(alpha))
        np.testing.assert_allclose(arm.pose(q).as_matrix(), (T @ tool).as_matrix(), atol=1e-8)


def test_the_fr3_moves_as_the_panda_with_links_and_limits_of_its_own(
    rng: np.random.Generator,
) -> None:
    fr3, panda = Arm(FR3), Arm(PANDA)
    for q in rng.uniform(
        np.maximum(fr3.q_min, panda.q_min), np.minimum(fr3.q_max, panda.q_max), (9, 7)
    ):
        np.testing.assert_allclose(fr3.pose(q).as_matrix(), panda.pose(q).as_matrix(), atol=1e-9)
    assert fr3.q_max[5] == 4.5169
    assert 15.0 < fr3.model.body_mass[2:].sum() < 19.0
