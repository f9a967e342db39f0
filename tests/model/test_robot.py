from dataclasses import FrozenInstanceError, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mink import SE3

from robo47_qp.errors import InvalidValueError, ModelError
from robo47_qp.model.gripper import Gripper
from robo47_qp.model.hands import hand
from robo47_qp.model.robot import Hand, MotionProfile, Mount, Robot, ToolFrame
from tests.robots import GRIPPER

BOUNDS = ("v_max", "a_max", "j_max")
VECTORS = ("home", "tau_max", "tau_rate_max", "stiffness")
POSITIVE = ("tau_max", "tau_rate_max", "stiffness")
NOT_NEGATIVE = ("armature", "damping", "dry_friction")
NO_POSES = {
    "nan": (SE3(np.array([1.0, 0.0, 0.0, 0.0, 0.0, np.nan, 0.0])), "a vector of 7 finite numbers"),
    "long": (SE3(np.array([2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])), "a pose with a unit quaternion"),
    "list": ([0.0, 0.0, 0.0], "a mink.SE3"),
}
"""What is no pose, and what the message expects."""


def changed(robot: Robot, name: str, value: object) -> Robot:
    fields: dict[str, Any] = {name: value}
    return replace(robot, **fields)


def profile(**changed: object) -> MotionProfile:
    bounds: dict[str, object] = {name: np.array([1.0, 2.0, 3.0]) for name in BOUNDS}
    return MotionProfile(**{**bounds, **changed})  # type: ignore[arg-type]


def test_uniform_bounds_are_the_same_for_every_joint() -> None:
    uniform = MotionProfile.uniform(4, v=1.0, a=2.0, j=3.0)
    assert uniform.v_max.tolist() == [1.0] * 4
    assert uniform.a_max.tolist() == [2.0] * 4
    assert uniform.j_max.tolist() == [3.0] * 4


@given(pace=st.floats(0.01, 1.0), v=st.floats(0.1, 3.0))
def test_a_slowed_profile_bounds_the_same_motion_stretched_in_time(pace: float, v: float) -> None:
    # q(t) = sin(v t) has derivatives with amplitudes v, v², v³.
    full = MotionProfile.uniform(1, v=v, a=v**2, j=v**3)
    t = np.linspace(0.0, 2 * np.pi / (v * pace), 4001)
    q = np.sin(v * pace * t)
    slowed = full.slowed(pace)
    for order, bound in enumerate((slowed.v_max, slowed.a_max, slowed.j_max), start=1):
        largest = np.abs(np.diff(q, order)).max() / (t[1] - t[0]) ** order
        assert bound[0] == pytest.approx(largest, rel=2e-2)


def test_full_speed_changes_nothing_and_slowing_leaves_the_original_alone() -> None:
    full = profile()
    half = full.slowed(0.5)
    for name in BOUNDS:
        assert getattr(full.slowed(1.0), name).tolist() == [1.0, 2.0, 3.0]
        assert getattr(full, name).tolist() == [1.0, 2.0, 3.0]
        assert (getattr(half, name) < getattr(full, name)).all()


@pytest.mark.parametrize("pace", [0.0, -0.5, 1.0 + 1e-9, 2.0, np.nan, np.inf])
def test_a_pace_outside_0_to_1_is_refused(pace: float) -> None:
    with pytest.raises(InvalidValueError, match="pace must be above 0 and at most 1; found"):
        profile().slowed(pace)


@pytest.mark.parametrize("name", BOUNDS)
@pytest.mark.parametrize("bad", [0.0, -1.0])
def test_a_bound_that_is_not_positive_is_refused(name: str, bad: float) -> None:
    with pytest.raises(InvalidValueError, match=rf"{name} must be positive in every joint; found"):
        profile(**{name: np.array([1.0, bad, 1.0])})


@pytest.mark.parametrize("name", BOUNDS)
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_bound_that_is_not_finite_is_refused(name: str, bad: float) -> None:
    with pytest.raises(InvalidValueError, match=rf"{name} must be a vector of 3 finite numbers"):
        profile(**{name: np.array([1.0, bad, 1.0])})


@pytest.mark.parametrize("name", BOUNDS)
@pytest.mark.parametrize("bad", ["x", [[1.0], [1.0, 2.0]], [[1.0], [1.0, 2.0], [3.0]]])
def test_bounds_that_are_no_numbers_are_refused(name: str, bad: object) -> None:
    with pytest.raises(InvalidValueError, match=r"must be a vector of \d finite numbers"):
        profile(**{name: bad})


@pytest.mark.parametrize("name", ["a_max", "j_max"])
def test_bounds_of_different_lengths_are_refused(name: str) -> None:
    with pytest.raises(InvalidValueError, match=rf"{name} must be a vector of 3 .* \(2,\)"):
        profile(**{name: np.array([1.0, 1.0])})


def test_the_bounds_of_a_profile_cannot_be_changed() -> None:
    mine = np.array([1.0, 2.0, 3.0])
    made = profile(v_max=mine)
    mine[:] = 9.0
    assert made.v_max.tolist() == [1.0, 2.0, 3.0]
    for name in BOUNDS:
        with pytest.raises(ValueError, match="read-only"):
            getattr(made, name)[0] = 5.0
        with pytest.raises(FrozenInstanceError):
            setattr(made, name, mine)


def test_a_robot_is_a_description_of_n_joints(robot: Robot) -> None:
    n = len(robot.joints)
    for name in VECTORS:
        assert getattr(robot, name).shape == (n,)
    for motion in (robot.rated, robot.profile):
        for name in BOUNDS:
            assert getattr(motion, name).shape == (n,)
    assert len(robot.motors) == len(set(robot.motors)) == n


@pytest.mark.parametrize("name", VECTORS)
def test_the_arrays_of_a_robot_cannot_be_changed(robot: Robot, name: str) -> None:
    with pytest.raises(ValueError, match="read-only"):
        getattr(robot, name)[0] = 5.0


def test_a_robot_does_not_change_with_the_arrays_it_was_made_of(robot: Robot) -> None:
    home = robot.home.copy()
    made = replace(robot, home=home)
    home += 1.0
    assert made.home.tolist() == robot.home.tolist()


@pytest.mark.parametrize("name", VECTORS)
def test_an_array_of_the_wrong_length_is_refused(robot: Robot, name: str) -> None:
    n = len(robot.joints)
    with pytest.raises(InvalidValueError, match=rf"{name} must be a vector of {n} .*\({n + 1},\)"):
        changed(robot, name, np.ones(n + 1))


@pytest.mark.parametrize("name", VECTORS)
def test_an_array_that_is_not_finite_is_refused(robot: Robot, name: str) -> None:
    bad = np.ones(len(robot.joints))
    bad[-1] = np.nan
    with pytest.raises(InvalidValueError, match=rf"{name} must be a vector of .* found .*nan"):
        changed(robot, name, bad)


@pytest.mark.parametrize("name", POSITIVE)
@pytest.mark.parametrize("bad", [0.0, -1.0])
def test_a_limit_that_is_not_positive_is_refused(robot: Robot, name: str, bad: float) -> None:
    wrong = np.append(np.ones(len(robot.joints) - 1), bad)
    with pytest.raises(InvalidValueError, match=rf"{name} must be above 0 and finite; found .*1\."):
        changed(robot, name, wrong)


@pytest.mark.parametrize("name", NOT_NEGATIVE)
def test_what_resists_a_joint_is_zero_or_more(robot: Robot, name: str) -> None:
    none = np.zeros(len(robot.joints))
    assert getattr(changed(robot, name, none), name).tolist() == none.tolist()
    none[-1] = -1e-9
    with pytest.raises(InvalidValueError, match=rf"{name} must be 0 or more and finite; found"):
        changed(robot, name, none)


@pytest.mark.parametrize("case", NO_POSES)
def test_a_frame_at_no_pose_is_refused(robot: Robot, case: str) -> None:
    pose, expected = NO_POSES[case]
    with pytest.raises(InvalidValueError, match=f"T_world_base must be {expected}; found"):
        changed(robot, "T_world_base", pose)
    with pytest.raises(InvalidValueError, match=f"tool frame on 'hand' must be {expected}; found"):
        ToolFrame(body="hand", T_body_tcp=pose)  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match=f"of mount 'left_' must be {expected}; found"):
        Mount(prefix="left_", T_world_base=pose)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["width_max", "speed_max", "force_max", "force_gain"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -1.0, 0.0, "0.1", None])
def test_a_gripper_has_positive_numbers(name: str, bad: object) -> None:
    fields: dict[str, Any] = {name: bad}
    message = f"gripper {name} must be above 0 and finite; found"
    with pytest.raises(InvalidValueError, match=message):
        replace(GRIPPER, **fields)


@pytest.mark.parametrize("turn", [np.nan, np.inf, "left"])
def test_a_hand_is_turned_by_a_finite_angle(turn: Any) -> None:
    with pytest.raises(InvalidValueError, match=r"hand turn must be .*finite.*; found"):
        hand("parallel_gripper", "flange", turn)


def test_a_hand_has_a_gripper(tmp_path: Path) -> None:
    none: Any = None
    with pytest.raises(InvalidValueError, match=f"hand gripper must be a {Gripper.__name__}"):
        Hand(mjcf=tmp_path, site="flange", gripper=none)


@pytest.mark.parametrize("name", ["rated", "profile"])
def test_a_profile_of_another_arm_is_refused(robot: Robot, name: str) -> None:
    other = MotionProfile.uniform(len(robot.joints) + 1, v=1.0, a=1.0, j=1.0)
    with pytest.raises(InvalidValueError, match=rf"{name}\.v_max must be a vector of"):
        changed(robot, name, other)


def test_a_missing_motor_is_refused(robot: Robot) -> None:
    with pytest.raises(InvalidValueError, match=r"motors must be \d+ names, one per joint; found"):
        replace(robot, motors=robot.motors[:-1])


def test_a_missing_model_is_named(robot: Robot, tmp_path: Path) -> None:
    missing = tmp_path / "nowhere.xml"
    message = rf"Robot '{robot.name}' needs the model .*nowhere\.xml: no such file"
    with pytest.raises(ModelError, match=message):
        replace(robot, mjcf=missing)


def test_a_folder_is_no_model(robot: Robot, tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="no such file"):
        replace(robot, mjcf=tmp_path)
