"""Every robot that the contracts are tested on: those of the package, found by looking, and two
from files that know nothing of the package."""

import importlib
import inspect
import os
import pkgutil
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp import robots
from robo47_qp.menagerie import ROOT_VARIABLE
from robo47_qp.robot import Gripper, Robot, ToolFrame
from robo47_qp.robot_loading import robot_from_mjcf
from robo47_qp.robots.panda import PANDA

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
FEW = ("panda", "slider6")
"""For tests that take long: one of each kind."""


@cache
def robot_named(name: str) -> Robot:
    return MAKERS[name]()


def robot_or_skip(name: str) -> Robot:
    """A robot, the same object every time; no file is fetched for it."""
    if name not in ("panda", "hinge6", "slider6") and ROOT_VARIABLE not in os.environ:
        pytest.skip(f"{ROOT_VARIABLE} names no checkout of MuJoCo Menagerie with the {name}")
    return robot_named(name)


def the_gripper(robot: Robot) -> Gripper:
    assert robot.gripper is not None
    return robot.gripper


GRIPPER = the_gripper(PANDA)
