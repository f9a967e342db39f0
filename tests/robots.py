"""Every robot that the contracts are tested on: those of the package, found by looking, and two
from files that know nothing of the package."""

import importlib
import inspect
import os
import pkgutil
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.model import robots
from robo47_qp.model.arm import Arm
from robo47_qp.model.gripper import Gripper
from robo47_qp.model.loading import robot_from_mjcf
from robo47_qp.model.menagerie import ROOT_VARIABLE
from robo47_qp.model.payload import Payload
from robo47_qp.model.robot import Robot, ToolFrame
from robo47_qp.model.robots.panda import PANDA
from tests.plain_arm import PlainArm, welded_file

MODELS = Path(__file__).parent / "models"
SLIDER_TOOL = SE3.from_rotation_and_translation(
    SO3.from_y_radians(0.3), np.array([0.01, -0.02, 0.13])
)


def hinge6() -> Robot:
    """Six joints that turn, servos with force ranges, a site."""
    return robot_from_mjcf(
        MODELS / "hinge6.xml", tcp="pointer", home=[0.0, -0.4, -1.6, 0.0, -1.2, 0.0]
    )


def slider6() -> Robot:
    """Two joints that slide and four that turn, no actuators, no site."""
    return robot_from_mjcf(
        MODELS / "slider6.xml",
        tcp=ToolFrame(body="wrist3", T_body_tcp=SLIDER_TOOL),
        home=[0.0, 0.3, 0.4, 0.2, 0.5, 0.0],
    )


def _discovered() -> dict[str, Callable[[], Robot]]:
    found: dict[str, Callable[[], Robot]] = {}
    for module in pkgutil.iter_modules(robots.__path__, f"{robots.__name__}."):
        for name, member in vars(importlib.import_module(module.name)).items():
            if isinstance(member, Robot):
                found[member.name] = lambda member=member: member  # type: ignore[misc]
            elif inspect.isfunction(member) and member.__annotations__.get("return") is Robot:
                found[name] = member
    return found


MAKERS = {**_discovered(), "hinge6": hinge6, "slider6": slider6}
# Two arms are held to one of them, see tests/model/test_panda_pair.py.
del MAKERS["panda_pair"]
TURNING = ("panda", "iiwa14", "xarm7", "hinge6")
MODULES = {
    # The six hinges of the UR5e have more room, and are there, too.
    "test_ik_contract": ("panda", "iiwa14", "xarm7", "slider6"),
    "test_arm": ("panda", "iiwa14", "xarm7", "slider6"),
    "test_arm_input": ("panda", "iiwa14", "xarm7", "slider6"),
    "test_payload": ("panda", "iiwa14", "xarm7", "slider6"),
    "test_lin": ("panda", "slider6"),
    "test_lin_limits": ("panda", "slider6"),
    "test_planner": ("panda", "slider6"),
    "test_ptp": ("panda", "slider6"),
    "test_dls": ("panda", "slider6"),
    "test_qp": ("panda", "iiwa14"),
    "test_multistart": ("panda", "hinge6"),
    "test_joint_impedance": ("panda", "hinge6"),
    # Few or no geoms of the others can collide.
    "test_motion_bounds": ("panda",),
    "test_clearance_bounds": ("panda",),
    "test_seeds": ("panda",),
    "test_diagnosis": ("panda",),
    "test_lm": ("panda", "hinge6"),
    "test_preference": ("panda", "slider6"),
    "test_sampling": ("panda", "slider6"),
    "test_tool_error": ("panda", "slider6"),
}
"""Modules whose tests run on these robots alone, to save time; all others run on every one."""
PREMISES = {
    # Their examples start from poses, sizes or texts of one arm.
    "test_bodies_that_are_only_drawn_keep_their_mass": ("panda",),
    "test_a_joint_that_slides_without_a_range_is_refused": ("slider6",),
    "test_a_payload_is_held_in_the_tool_frame_however_that_is_turned": ("panda",),
    "test_beyond_the_stretched_arm_nothing_breaks": ("panda",),
    "test_a_joint_at_its_limit_is_inside": ("panda",),
    "test_damping_calms_the_step_at_a_singularity": ("panda",),
    "test_near_the_end_it_converges_quadratically": ("panda",),
    "test_a_path_that_cannot_be_kept_is_refused": ("panda",),
    "test_knots_are_doubled_until_the_line_is_kept": ("panda",),
    "test_a_joint_that_leaves_its_limits_is_named": ("panda",),
    "test_it_reaches_most_targets_from_home": ("panda",),
    # Geoms that can collide.
    "test_before_a_target_inside_an_obstacle_the_arm_stops": ("panda",),
    "test_a_start_too_close_is_told_and_parted": ("panda",),
    "test_too_close_is_closer_than_the_clearance_whatever_is_aimed_at": ("panda",),
    "test_clearance_and_limits_hold_whatever_the_target_does": ("panda",),
    # The xArm 7's joints, each with a bound on its speed home, pull against each other there.
    "test_the_arm_returns_home_in_the_null_space_only": ("panda", "iiwa14", "hinge6", "slider6"),
    # A null space to have many answers in, or a position that one start reaches.
    "test_answers_that_are_alike_are_one": ("panda",),
    "test_it_stops_once_there_are_as_many_answers_as_asked_for": ("panda",),
    "test_the_position_alone_leaves_the_orientation_be": ("panda",),
    "test_a_ptp_motion_is_straight_in_joint_space_and_lin_in_the_world": ("panda",),
    # In one period the damping of the xArm's wrist takes more than its inertia holds.
    "test_the_tool_turns_back_at_the_same_pace": ("panda", "iiwa14", "hinge6", "slider6"),
    # The iiwa's limits keep it far from the ground; behind a slide the bound is loose.
    "test_the_bound_on_the_reach_is_of_use": ("panda", "xarm7", "hinge6"),
    # The iiwa's file has no damping.
    "test_damping_takes_torque_in_proportion_to_the_speed": ("panda", "xarm7", "hinge6", "slider6"),
    # Distances in radians, joints and sites that the description names itself, an unlimited
    # solver that lets a rail run on for ever.
    "test_a_joint_that_the_model_lacks_is_named": TURNING,
    "test_a_tool_frame_that_the_model_lacks_is_named": TURNING,
    "test_a_joint_named_twice_is_refused": TURNING,
    "test_a_seed_outside_the_limits_is_a_start_like_any_other": TURNING,
    "test_a_target_out_of_reach_is_a_result_with_its_distance": TURNING,
    "test_a_robot_whose_home_is_outside_its_limits_cannot_go_home": TURNING,
}
"""Tests whose premise holds for these robots alone."""
FEW = {
    "panda_rail": (
        "test_arm",
        "test_arm_input",
        "test_payload",
        "test_ik_contract",
        "test_tool_error",
    ),
    "panda_base": ("test_controller_contract",),
    # Its arm is the Panda's with other numbers.
    "fr3": ("test_arm", "test_arm_input", "test_payload"),
    "ur5e": (
        "test_arm",
        "test_arm_input",
        "test_payload",
        "test_ik_contract",
        "test_lin",
        "test_lin_limits",
        "test_planner",
    ),
}
"""Modules whose tests run on these arms alone, to save time: arms that something carries (what is
their own is in tests/model/test_carrier.py) and arms that are much like others."""


def is_meant_for(module: str, test: str, robot: str) -> bool:
    """True where a test is to be run on a robot."""
    everywhere = tuple(MAKERS)
    if robot in FEW:
        return module in FEW[robot] and robot in PREMISES.get(test, everywhere)
    return robot in MODULES.get(module, everywhere) and robot in PREMISES.get(test, everywhere)


def is_at_hand(robot: str) -> bool:
    """True where a robot's model is on this machine, as far as the environment says."""
    shipped = ("panda", "panda_rail", "panda_base", "fr3", "ur5e", "hinge6", "slider6")
    return robot in shipped or ROOT_VARIABLE in os.environ


@cache
def robot_named(name: str) -> Robot:
    return MAKERS[name]()


def robot_or_skip(name: str) -> Robot:
    """A robot, the same object every time; no file is fetched for it."""
    if not is_at_hand(name):
        pytest.skip(f"{ROOT_VARIABLE} names no checkout of MuJoCo Menagerie with the {name}")
    return robot_named(name)


@cache
def arm_of(name: str) -> Arm:
    return Arm(robot_named(name))


@cache
def plain_arm_of(name: str) -> PlainArm:
    return PlainArm(robot_named(name))


def the_gripper(robot: Robot) -> Gripper:
    assert robot.gripper is not None
    return robot.gripper


GRIPPER = the_gripper(PANDA)


HELD = Payload(
    mass=1.7,
    inertia=(4e-3, 9e-3, 1.1e-2),
    T_tcp_com=SE3.from_rotation_and_translation(
        SO3.from_rpy_radians(0.7, -0.4, 1.9), np.array([0.03, -0.05, 0.08])
    ),
)


def edited(robot: Robot, folder: Path, old: str, new: str) -> Robot:
    """The robot with a line of its welded model changed."""
    path = welded_file(robot, folder)
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return replace(robot, mjcf=path)


_MADE: dict[tuple[str, bool], tuple[Arm, PlainArm]] = {}


def both(robot: Robot, payload: Payload | None) -> tuple[Arm, PlainArm]:
    key = robot.name, payload is None
    if key not in _MADE:
        _MADE[key] = Arm(robot, payload), PlainArm(robot, payload)
    return _MADE[key]
