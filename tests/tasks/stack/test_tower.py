"""Towers: which cubes stand in them, and which is to be picked next."""

import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.tasks.heading import upright
from robo47_qp.tasks.stack.tower import Tower

EDGE = 0.04
TOWER = Tower(edge=EDGE, T_world_goal=upright([0.5, 0.1, 0.0], 0.3))


def at(x: float, y: float, storey: float) -> SE3:
    return upright([x, y, (storey + 0.5) * EDGE], 1.0)


def test_levels_lie_on_top_of_each_other() -> None:
    for number in range(3):
        T = TOWER.level(number)
        np.testing.assert_allclose(T.translation(), [0.5, 0.1, 0.02 + 0.04 * number], atol=1e-12)
        assert TOWER.storey(T) == number
        np.testing.assert_allclose(T.rotation().wxyz, TOWER.T_world_goal.rotation().wxyz)


def test_a_camera_whose_calibration_errs_sees_goal_and_cubes_with_the_same_error() -> None:
    turn, shift = SO3.exp(np.array([0.05, -0.03, 0.02])), np.array([0.004, -0.003, 0.02])
    T_bias = SE3.from_rotation_and_translation(turn, shift)
    tower = Tower(edge=EDGE, T_world_goal=T_bias @ TOWER.T_world_goal)
    cubes = {"c": TOWER.level(2), "a": TOWER.level(0), "b": TOWER.level(1)}
    seen = {name: T_bias @ T for name, T in cubes.items()}
    assert tower.standing(seen) == ["a", "b", "c"]
    for number, name in enumerate(("a", "b", "c")):
        level = tower.level(number)
        np.testing.assert_allclose(level.translation()[:2], seen[name].translation()[:2])
        # Heights are those of the data sheet.
        assert level.translation()[2] == TOWER.height(number)
    assert [tower.storey(T_bias @ at(0.3, -0.3, storey)) for storey in range(3)] == [0, 1, 2]


@pytest.mark.parametrize(
    ("shift", "stands"), [((0.0079, 0, 0), True), ((0.0081, 0, 0), False), ((0, 0, 0.01), False)]
)
def test_a_cube_in_place_stands(shift: tuple[float, float, float], stands: bool) -> None:
    first, second = TOWER.level(0), SE3.from_translation(np.array(shift)) @ TOWER.level(1)
    seen = {"b": second, "a": first}
    assert TOWER.standing(seen) == (["a", "b"] if stands else ["a"])
    assert TOWER.loose(seen) == ([] if stands else ["b"])


def test_a_cube_above_a_gap_does_not_stand() -> None:
    seen = {"a": TOWER.level(1), "b": at(0.4, 0.3, 0)}
    assert TOWER.standing(seen) == []
    assert TOWER.loose(seen) == ["a", "b"]


def test_what_lies_on_others_is_picked_first_and_then_what_is_in_the_way() -> None:
    seen = {"far": at(0.3, -0.3, 0), "near": at(0.52, 0.1, 0), "up": at(0.3, -0.3, 1)}
    assert TOWER.loose(seen) == ["up", "near", "far"]
