"""Columns of recordings."""

import mujoco
import numpy as np

from robo47_qp.model.loading import robot_from_mjcf
from robo47_qp.model.mjcf import robot_spec
from robo47_qp.report.rerun.columns import limit_columns
from tests.robots import MODELS


def test_a_joint_that_turns_freely_has_no_limits_to_draw() -> None:
    """MuJoCo has a range of 0 to 0 for it."""
    home = [0.0, 0.26, 0.0, 1.9, 0.0, 0.98, 0.0]
    robot = robot_from_mjcf(MODELS / "free7.xml", tcp="tool", home=home)
    model: mujoco.MjModel = robot_spec(robot).compile()
    found = limit_columns(model, robot)[0].as_arrow_array().to_pylist()
    ranges = np.array([model.joint(name).range for name in robot.joints])
    free = [not model.joint(name).limited[0] for name in robot.joints]
    assert 0 < sum(free) < 7
    expected = np.where(np.array(free)[:, None], np.nan, ranges).T.ravel()
    for row in found:
        np.testing.assert_array_equal(np.ravel(row), expected.astype(np.ravel(row).dtype))
