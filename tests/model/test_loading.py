"""An arm from a file with only a tool frame and a home."""

import os
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from math import pi
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.errors import InvalidValueError, ModelError, UnknownNameError
from robo47_qp.model.arm import Arm
from robo47_qp.model.gripper import Gripper
from robo47_qp.model.loading import Ratings, robot_from_menagerie, robot_from_mjcf
from robo47_qp.model.robot import MotionProfile, ToolFrame
from robo47_qp.sim.simulation import Simulation
from tests.robots import MODELS, hinge6, robot_named, slider6
from tests.runs import no_objects

HOME = [0.0, -0.4, -1.6, 0.0, -1.2, 0.0]
HAND = """
<mujoco>
  <worldbody>
    <body name="post"><geom size="0.05"/>
      <body name="arm" pos="0 0 0.3">
        <joint name="turn" axis="0 0 1" range="-100 100" damping="1"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03"/>
        <body name="slide" pos="0.3 0 0">
          <joint name="out" type="slide" axis="1 0 0" range="0 0.2" damping="1"/>
          <geom size="0.03"/>
          <site name="tcp" pos="0.1 0 0"/>
          <body name="left" pos="0 0.03 0"><joint name="l" type="slide" axis="0 1 0"
            range="0 0.04"/><geom size="0.01"/></body>
          <body name="right" pos="0 -0.03 0"><joint name="r" type="slide" axis="0 -1 0"
            range="0 0.04"/><geom size="0.01"/></body>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon><fixed name="width"><joint joint="l" coef="1"/><joint joint="r" coef="1"/></fixed>
  </tendon>
  <equality><joint joint1="l" joint2="r"/></equality>
  <sensor><jointpos joint="l"/></sensor>
  <actuator>
    <position name="a" joint="turn" kp="100" forcerange="-8 9" gear="3"/>
    <position name="b" joint="out" kp="100"/>
    <position name="c" tendon="width" kp="100"/>
  </actuator>
  <keyframe><key name="home" qpos="0 0.1 0.02 0.02"/></keyframe>
</mujoco>
"""
CLAW = Gripper(
    joints=("l", "r"),
    fingers=("left", "right"),
    actuator="c",
    width_max=0.08,
    speed_max=0.1,
    force_max=20.0,
    force_gain=1.0,
)


@pytest.fixture
def hand(tmp_path: Path) -> Path:
    path = tmp_path / "hand.xml"
    path.write_text(HAND)
    return path


def test_the_joints_between_world_and_tool_are_found_base_to_tip() -> None:
    robot = hinge6()
    assert robot.name == "hinge6"
    assert robot.joints == ("waist", "shoulder", "elbow", "roll", "pitch", "twist")
    assert robot.slides == ()
    assert slider6().joints == ("rail", "lift", "swing", "yaw", "tilt", "wrist3_joint0")
    assert slider6().slides == ("rail", "lift")


def test_torque_limits_are_those_of_the_files_servos_through_their_gears() -> None:
    assert hinge6().tau_max.tolist() == [60.0, 150.0, 80.0, 20.0, 20.0, 10.0]


def test_a_hand_that_is_not_described_is_welded_with_all_that_moves_it(hand: Path) -> None:
    robot = robot_from_mjcf(hand, tcp="tcp", home=[0.0, 0.1])
    assert robot.joints == ("turn", "out")
    assert robot.tau_max[0] == 27.0
    assert robot.tau_max[1] > 0.0  # its servo has no limit: a default
    model = Simulation(robot, no_objects).model
    assert [model.joint(i).name for i in range(model.njnt)] == ["turn", "out"]
    assert [model.actuator(i).name for i in range(model.nu)] == ["turn_torque", "out_torque"]
    assert (model.ntendon, model.neq, model.nkey) == (0, 0, 0)
    # Those of the simulation, none of the file's.
    kinds = {int(kind) for kind in model.sensor_type}
    assert kinds == {int(mujoco.mjtSensor.mjSENS_CONTACT)}


@pytest.mark.parametrize("body", ["post", "left", "right"])
def test_what_drives_no_joint_limits_none(tmp_path: Path, hand: Path, body: str) -> None:
    sticky = tmp_path / "sticky.xml"
    drive = f'<adhesion body="{body}" ctrlrange="0 1" gain="5" forcerange="0 5"/></actuator>'
    sticky.write_text(HAND.replace("</actuator>", drive))
    robot, plain = (robot_from_mjcf(file, tcp="tcp", home=[0.0, 0.1]) for file in (sticky, hand))
    assert robot.tau_max.tolist() == plain.tau_max.tolist()


def test_a_new_tool_frame_does_not_take_the_name_of_one_in_the_file(hand: Path) -> None:
    T = SE3.from_translation(np.array([0.0, 0.0, 0.2]))
    robot = robot_from_mjcf(hand, tcp=ToolFrame(body="slide", T_body_tcp=T), home=[0.0, 0.1])
    assert robot.tcp == "tcp_"
    np.testing.assert_allclose(Arm(robot).pose(robot.home).translation(), [0.4, 0.0, 0.5])


def test_what_is_known_is_taken_and_the_rest_computed() -> None:
    rated = MotionProfile.uniform(6, v=1.0, a=2.0, j=3.0)
    known = Ratings(rated=rated, tau_max=np.arange(1.0, 7.0), stiffness=np.full(6, 9.0))
    robot = robot_from_mjcf(MODELS / "hinge6.xml", tcp="pointer", home=HOME, ratings=known)
    assert robot.rated is rated
    assert robot.tau_max.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    assert robot.stiffness.tolist() == [9.0] * 6
    assert (robot.profile.a_max <= 2.0).all()
    assert (robot.tau_rate_max > robot.tau_max).all()


def test_some_of_the_joints_can_be_chosen() -> None:
    chosen = ["waist", "shoulder", "elbow"]
    robot = robot_from_mjcf(
        MODELS / "hinge6.xml", tcp="pointer", home=[0.0, -0.4, -1.6], joints=chosen, name="stiff"
    )
    assert Arm(robot).n == 3
    assert robot.name == "stiff"


CANNOT = {
    "no file": (ModelError, "model .*nowhere.xml is no file", "nowhere.xml", {}),
    "no site": (UnknownNameError, "No site is called 'x'; known: pointer", None, {"tcp": "x"}),
    "no body": (
        UnknownNameError,
        "No body is called 'x'; known: .*wrist3",
        None,
        {"tcp": ToolFrame(body="x")},
    ),
    "no joint": (
        UnknownNameError,
        "No joint is called 'x'; known: waist",
        None,
        {"joints": ["x"], "home": [0.0]},
    ),
    "no joints": (
        InvalidValueError,
        "joints must be names of .*; found \\[\\]",
        None,
        {"joints": []},
    ),
    "a joint twice": (
        InvalidValueError,
        "joints must be names of one joint or more, each of them once; found .*'waist', 'waist'",
        None,
        {"joints": ["waist", "waist"], "home": [0.0, 0.0]},
    ),
    "joints as text": (InvalidValueError, "found 'waist'", None, {"joints": "waist"}),
    "short home": (InvalidValueError, "home must be a vector of 6", None, {"home": [0.0]}),
    "home outside": (
        InvalidValueError,
        r"home must be inside the joint ranges \[\[-2.9, 2.9\]",
        None,
        {"home": [3.0, 0.0, 0.0, 0.0, 0.0, 0.0]},
    ),
    "bad torques": (
        InvalidValueError,
        "tau_max must be a vector of 6",
        None,
        {"ratings": Ratings(tau_max=[1.0])},
    ),
    "negative torques": (
        InvalidValueError,
        "tau_max must be above 0 and finite; found",
        None,
        {"ratings": Ratings(tau_max=[60.0, -1.0, 80.0, 20.0, 20.0, 10.0])},
    ),
    "tool on the base": (
        ModelError,
        "Between the world and the tool frame 'tcp' there is no joint",
        None,
        {"tcp": ToolFrame(body="base")},
    ),
}


@pytest.mark.parametrize(("error", "message", "file", "change"), CANNOT.values(), ids=CANNOT)
def test_what_cannot_be_is_told(
    error: type[Exception], message: str, file: str | None, change: dict[str, object]
) -> None:
    arguments: dict[str, object] = {"tcp": "pointer", "home": HOME, **change}
    with pytest.raises(error, match=message):
        robot_from_mjcf(MODELS / (file or "hinge6.xml"), **arguments)  # type: ignore[arg-type]


def test_a_file_that_is_no_mjcf_is_told(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text("arm: yes")
    with pytest.raises(ModelError, match=r"MuJoCo cannot read .*arm\.xml"):
        robot_from_mjcf(path, tcp="tcp", home=[0.0])


def test_a_file_whose_meshes_are_missing_is_told(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(HAND.replace("<worldbody>", '<asset><mesh file="no.stl"/></asset><worldbody>'))
    with pytest.raises(ModelError, match=r"MuJoCo cannot compile .*arm\.xml: .*no\.stl"):
        robot_from_mjcf(path, tcp="tcp", home=[0.0, 0.1])


def test_an_arm_on_a_free_body_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "float.xml"
    path.write_text(HAND.replace('<body name="post">', '<body name="post"><freejoint name="f"/>'))
    with pytest.raises(ModelError, match=r"'tcp' the joints \['f'\] neither turn nor slide"):
        robot_from_mjcf(path, tcp="tcp", home=[0.0, 0.1])


def test_a_description_that_mixes_up_slides_is_refused() -> None:
    with pytest.raises(ModelError, match=r"model \('rail', 'lift'\) do"):
        Arm(replace(robot_named("slider6"), slides=("rail",)))


@pytest.mark.skipif("MENAGERIE_ROOT" not in os.environ, reason="MENAGERIE_ROOT is not set")
@pytest.mark.parametrize(
    ("model", "tcp", "home"),
    [
        ("kuka_iiwa_14/iiwa14", "attachment_site", [0.0, 0.4, 0.0, -1.5, 0.0, 1.2, 0.0]),
        ("ufactory_xarm7/xarm7", ToolFrame(body="link7"), [0.0, -0.2, 0.0, 0.9, 0.0, 1.2, 0.0]),
        ("franka_emika_panda/panda", ToolFrame(body="hand"), [0.0, -0.8, 0, -2.4, 0, 1.6, 0.8]),
    ],
)
def test_an_arm_of_menagerie_needs_only_a_tool_and_a_home(
    model: str, tcp: str | ToolFrame, home: list[float]
) -> None:
    robot = robot_from_menagerie(model, tcp=tcp, home=home)
    assert robot.joints == tuple(f"joint{i}" for i in range(1, 8))
    assert robot.menagerie == model
    simulation, arm = Simulation(robot, no_objects), Arm(robot)
    assert simulation.model.njnt == simulation.model.nu == 7
    still = np.zeros(7)
    for _ in range(200):
        simulation.step(arm.inverse_dynamics(simulation.state().q, still, still))
    assert np.abs(simulation.state().q - robot.home).max() < 1e-6
    own = mujoco.MjModel.from_xml_path(str(robot.mjcf))
    ranges = [own.joint(joint).range for joint in robot.joints]
    np.testing.assert_array_equal(np.column_stack([arm.q_min, arm.q_max]), ranges)


@pytest.mark.parametrize(
    ("gripper", "turn", "outcome"),
    [
        (CLAW, 0.0, nullcontext()),
        (replace(CLAW, fingers=("right", "left")), pi, nullcontext()),
        (
            replace(CLAW, fingers=("right", "left")),
            0.0,
            pytest.raises(InvalidValueError, match="of y first"),
        ),
        (CLAW, 0.5 * pi, pytest.raises(InvalidValueError, match="along the tool's y")),
        (
            replace(CLAW, fingers=("left", "thumb")),
            0.0,
            pytest.raises(UnknownNameError, match="thumb"),
        ),
        (replace(CLAW, joints=("l", "m")), 0.0, pytest.raises(UnknownNameError, match="'m'")),
    ],
)
def test_fingers_open_along_the_tools_y_axis(
    hand: Path, gripper: Gripper, turn: float, outcome: AbstractContextManager[object]
) -> None:
    T_body_tcp = SE3.from_rotation(SO3.from_z_radians(turn))
    tool = ToolFrame(body="slide", T_body_tcp=T_body_tcp)
    with outcome:
        robot_from_mjcf(hand, tcp=tool, home=[0.0, 0.1], gripper=gripper)
