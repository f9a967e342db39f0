"""Spaces of an environment: numbers that stand for quantities."""

from typing import Any

import numpy as np
import pytest

from robo47_qp.errors import InvalidValueError
from robo47_qp.motion.waypoint import tool_down
from robo47_qp.run.policy.drivers import StepwiseDriver
from robo47_qp.run.policy.policy import JointTarget, ToolTarget, Torques, vector_of

pytest.importorskip("gymnasium", reason="the extra gym is not installed")

from robo47_qp.evaluation.gym.spaces import (
    ActionScale,
    Mode,
    numbers_of,
    observation_space,
)
from tests.evaluation.gym.environments import ARM, env


@pytest.mark.parametrize("mode", ["joints", "tool", "torques"])
def test_numbers_stand_for_quantities(mode: Mode) -> None:
    scale = ActionScale(ARM, mode)
    pose = vector_of(tool_down([0.4, -0.3, 0.2], 0.5))
    vector = {"joints": ARM.home + 0.1, "tool": pose, "torques": np.arange(7.0)}[mode]
    numbers = scale.numbers([*vector, 0.03])
    assert scale.space.contains(numbers)
    action = scale.action(numbers)
    assert action.width == pytest.approx(0.03, abs=1e-8)
    kinds: dict[str, tuple[type, str]] = {
        "joints": (JointTarget, "q"),
        "tool": (ToolTarget, "pose"),
        "torques": (Torques, "tau"),
    }
    kind, field = kinds[mode]
    assert type(action) is kind
    np.testing.assert_allclose(getattr(action, field), vector, atol=1e-5)


def test_any_quaternion_is_made_a_unit_one() -> None:
    scale = ActionScale(ARM, "tool")
    action = scale.action(np.array([0, 0, 0, 0.2, 0, 0, 0.2, 0], dtype=np.float32))
    assert isinstance(action, ToolTarget)
    np.testing.assert_allclose(action.pose[3:], [0.5**0.5, 0, 0, 0.5**0.5], atol=1e-7)
    nothing = scale.action(np.zeros(8, dtype=np.float32))
    assert isinstance(nothing, ToolTarget)
    assert not nothing.pose[3:].any()


def test_readings_saturate_at_the_bounds_of_the_space() -> None:
    made = env()
    made.reset(seed=0)
    assert isinstance(made._episode, StepwiseDriver)
    seen = made._episode.observe()
    seen.force[:] = [600.0, -700.0, 5.0]
    assert seen.fingers is not None
    seen.fingers[:] = [7.0, 600.0]
    numbers = numbers_of(seen, observation_space(ARM, 0, 0, 3.0))
    np.testing.assert_array_equal(numbers["force"], [500.0, -500.0, 5.0])
    np.testing.assert_array_equal(numbers["fingers"], [7.0, 500.0])


@pytest.mark.parametrize("given", [["a"] * 8, [[0.0], [0.0, 1.0]], None, np.zeros(7)])
def test_what_are_no_numbers_of_the_space_is_refused(given: Any) -> None:
    with pytest.raises(InvalidValueError, match="action"):
        ActionScale(ARM, "joints").action(given)
