"""What an arm refuses: configurations and models, each by its name."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike

from robo47_qp.errors import InvalidValueError, ModelError, UnknownNameError
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import Robot
from tests.robots import edited


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_configuration_that_is_not_finite_is_refused(arm: Arm, bad: float) -> None:
    q = arm.home.copy()
    q[-1] = bad
    with pytest.raises(InvalidValueError, match=rf"elbow must be a vector of {arm.n} finite"):
        arm.checked_q("elbow", q)


@pytest.mark.parametrize("q", [[0.0], 0.0, [[0.0] * 7], "home", [0.0] * 30])
def test_a_configuration_of_another_shape_is_refused(arm: Arm, q: ArrayLike) -> None:
    with pytest.raises(InvalidValueError, match=rf"q must be a vector of {arm.n} finite numbers"):
        arm.checked_q("q", q)


def test_a_joint_that_the_model_lacks_is_named(robot: Robot) -> None:
    wrong = replace(robot, joints=("nojoint", *robot.joints[1:]))
    message = rf"No joint is called 'nojoint'; known: .*{robot.joints[0]}"
    with pytest.raises(UnknownNameError, match=message) as caught:
        Arm(wrong)
    assert set(robot.joints) <= set(caught.value.known)


def test_a_tool_frame_that_the_model_lacks_is_named(robot: Robot) -> None:
    with pytest.raises(UnknownNameError, match=rf"No site is called 'toool'; known: .*{robot.tcp}"):
        Arm(replace(robot, tcp="toool"))


def test_joints_out_of_order_are_refused(robot: Robot) -> None:
    swapped = (robot.joints[1], robot.joints[0], *robot.joints[2:])
    with pytest.raises(ModelError, match=r"names the joints .*List them from base to tip\."):
        Arm(replace(robot, joints=swapped))


def test_a_joint_named_twice_is_refused(robot: Robot) -> None:
    doubled = (robot.joints[0], robot.joints[0], *robot.joints[2:])
    with pytest.raises(ModelError, match=r"its model has .*once all others are welded"):
        Arm(replace(robot, joints=doubled))


def test_a_joint_that_slides_without_a_range_is_refused(robot: Robot, tmp_path: Path) -> None:
    old = f'<joint name="{robot.slides[0]}" class="slide"'
    free = edited(robot, tmp_path, old, f'{old} limited="false"')
    message = (
        rf"Robot '{robot.name}' has joints that slide without a range: \['{robot.slides[0]}'\]"
    )
    with pytest.raises(ModelError, match=message):
        Arm(replace(free, tool=None))
