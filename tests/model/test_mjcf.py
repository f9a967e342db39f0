"""What Arm and Simulation share of a robot's file."""

import os
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from robo47_qp.errors import UnknownNameError
from robo47_qp.model.arm import Arm
from robo47_qp.model.mjcf import read_spec, remove_visuals, robot_spec
from robo47_qp.model.robot import Robot, ToolFrame
from robo47_qp.model.robots.panda import PANDA
from tests.robots import MODELS, robot_named, robot_or_skip


def test_the_packaged_robot_is_its_file_and_nothing_else() -> None:
    own = mujoco.MjModel.from_xml_path(str(PANDA.mjcf))
    prepared = robot_spec(PANDA).compile()
    for name in ("body_mass", "jnt_range", "actuator_gainprm", "actuator_forcerange", "geom_pos"):
        np.testing.assert_array_equal(getattr(own, name), getattr(prepared, name))
    assert [own.actuator(i).name for i in range(own.nu)] == [
        prepared.actuator(i).name for i in range(prepared.nu)
    ]


def test_a_spec_is_the_callers_own(robot: Robot) -> None:
    first = robot_spec(robot)
    site = first.site(robot.tcp)
    assert site is not None
    first.delete(site)
    assert robot_spec(robot).site(robot.tcp) is not None


def test_motors_push_as_hard_as_the_description_says_and_no_harder() -> None:
    robot = replace(robot_named("hinge6"), tau_max=np.arange(1.0, 7.0))
    model = robot_spec(robot).compile()
    data = mujoco.MjData(model)
    data.ctrl[:] = 100.0
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qfrc_actuator, np.arange(1.0, 7.0))


def test_a_joints_own_limit_on_its_servo_does_not_bound_the_motor(tmp_path: Path) -> None:
    text = (MODELS / "hinge6.xml").read_text()
    path = tmp_path / "weak.xml"
    old = '<joint name="waist"'
    assert old in text
    path.write_text(text.replace(old, f'{old} actuatorfrcrange="-1 1"'))
    model = robot_spec(replace(robot_named("hinge6"), mjcf=path)).compile()
    data = mujoco.MjData(model)
    data.ctrl[0] = 50.0
    mujoco.mj_forward(model, data)
    assert data.qfrc_actuator[0] == 50.0


def test_joints_without_a_name_are_named_after_their_body() -> None:
    assert read_spec(MODELS / "slider6.xml").joint("wrist3_joint0") is not None


def test_a_tool_on_a_body_that_is_not_there_is_told() -> None:
    robot = replace(robot_named("slider6"), tool=ToolFrame(body="hand"))
    with pytest.raises(UnknownNameError, match=r"No body is called 'hand'; known: .*wrist3"):
        Arm(robot)


@pytest.mark.parametrize("name", ["iiwa14", "xarm7"])
def test_without_looks_meshes_go_and_masses_and_contacts_stay(name: str) -> None:
    robot = robot_or_skip(name)
    whole, bare = robot_spec(robot), robot_spec(robot)
    remove_visuals(bare)
    full, lean = whole.compile(), bare.compile()
    np.testing.assert_array_equal(full.body_mass, lean.body_mass)
    np.testing.assert_array_equal(full.body_inertia, lean.body_inertia)
    touching = (full.geom_contype | full.geom_conaffinity) != 0
    assert lean.ngeom == touching.sum() > 0
    used = {int(mesh) for mesh in lean.geom_dataid if mesh >= 0}
    assert lean.nmesh == len(used)
    assert lean.nmesh < full.nmesh
    assert "MENAGERIE_ROOT" in os.environ
