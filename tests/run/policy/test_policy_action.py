"""What a policy answers: taken as it was meant, or refused with a reason before anything moves."""

import re
from dataclasses import replace

import numpy as np
import pytest

from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import JOINT_MARGIN, Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.waypoint import tool_down
from robo47_qp.run.policy.action_check import checked_action, grip_of
from robo47_qp.run.policy.policy import (
    Action,
    JointTarget,
    ToolTarget,
    Torques,
    pose_of,
    vector_of,
)
from tests.robots import robot_named, the_gripper

PANDA_ARM = Arm(PANDA)
HOME = PANDA_ARM.home
DOWN = vector_of(tool_down([0.4, 0.1, 0.2], 0.3))


def checked(action: object) -> Action:
    return checked_action(action, PANDA_ARM)


def test_numbers_inside_the_bounds_are_taken_as_they_are() -> None:
    q = HOME + 0.1
    answer = checked(JointTarget(q=q, width=0.03, grip_force=20.0))
    assert isinstance(answer, JointTarget)
    np.testing.assert_array_equal(answer.q, q)
    assert (answer.width, answer.grip_force) == (0.03, 20.0)
    tau = np.arange(7.0)
    torques = checked(Torques(tau=tau))
    assert isinstance(torques, Torques)
    np.testing.assert_array_equal(torques.tau, tau)
    tool = checked(ToolTarget(pose=DOWN))
    assert isinstance(tool, ToolTarget)
    np.testing.assert_allclose(tool.pose, DOWN, atol=1e-15)


def test_what_is_checked_is_a_copy() -> None:
    q, pose, tau = HOME.copy(), DOWN.copy(), np.zeros(7)
    before = checked(JointTarget(q=q)), checked(ToolTarget(pose=pose)), checked(Torques(tau=tau))
    for array in (q, pose, tau):
        array[:] = np.nan
    for action in before:
        vectors = [value for value in vars(action).values() if isinstance(value, np.ndarray)]
        assert len(vectors) == 1
        assert np.isfinite(vectors[0]).all()


def test_lists_and_arrays_of_single_precision_will_do() -> None:
    answer = checked(JointTarget(q=HOME.tolist(), width=np.float32([0.08])))  # type: ignore[arg-type]
    assert isinstance(answer, JointTarget)
    np.testing.assert_array_equal(answer.q, HOME)
    assert answer.width == pytest.approx(0.08, abs=1e-8)
    most = PANDA.tau_max.astype(np.float32) * np.float32(1.0 + 1e-7)
    torques = checked(Torques(tau=most))  # type: ignore[arg-type]
    assert isinstance(torques, Torques)
    assert (torques.tau <= PANDA.tau_max).all()
    tool = checked(ToolTarget(pose=DOWN.astype(np.float32)))
    assert isinstance(tool, ToolTarget)
    assert np.linalg.norm(tool.pose[3:]) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("side", ["q_min", "q_max"])
def test_a_target_at_a_limit_is_brought_to_its_margin(side: str) -> None:
    limit: Vector = getattr(PANDA_ARM, side)
    answer = checked(JointTarget(q=limit))
    assert isinstance(answer, JointTarget)
    share = np.abs(answer.q - limit) / (PANDA_ARM.q_max - PANDA_ARM.q_min)
    np.testing.assert_allclose(share, JOINT_MARGIN, rtol=1e-9)
    assert ((answer.q > PANDA_ARM.q_min) & (answer.q < PANDA_ARM.q_max)).all()


def with_one(vector: Vector, i: int, value: float) -> Vector:
    changed = vector.copy()
    changed[i] = value
    return changed


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (JointTarget(q=with_one(HOME, 2, np.nan)), "q of the action must be a vector of 7 finite"),
        (JointTarget(q=HOME[:6]), "q of the action must be .* found shape (6,)"),
        (JointTarget(q=HOME[None]), "q of the action must be .* found shape (1, 7)"),
        (JointTarget(q="far"), "q of the action must be .* found 'far'"),  # type: ignore[arg-type]
        (
            JointTarget(q=with_one(HOME, 3, 0.2)),
            "q[3] of the action must be from -3.0718 to -0.0698; found 0.2",
        ),
        (
            JointTarget(q=with_one(HOME, 0, -2.9)),
            "q[0] of the action must be from -2.8973 to 2.8973; found -2.9",
        ),
        (Torques(tau=np.full(7, np.inf)), "tau of the action must be a vector of 7 finite"),
        (
            Torques(tau=with_one(np.zeros(7), 4, 12.1)),
            "tau[4] of the action must be from -12 to 12; found 12.1",
        ),
        (ToolTarget(pose=DOWN[:3]), "pose of the action must be .* found shape (3,)"),
        (
            ToolTarget(pose=with_one(DOWN, 0, np.nan)),
            "pose of the action must be a vector of 7 finite",
        ),
        (
            ToolTarget(pose=2.0 * DOWN),
            "pose of the action must be x, y, z [m], then a unit quaternion",
        ),
        (
            JointTarget(q=HOME, width=0.0801),
            "width of the action must be from 0 to 0.08; found 0.0801",
        ),
        (JointTarget(q=HOME, width=-0.001), "width of the action must be from 0 to 0.08"),
        (JointTarget(q=HOME, width=np.nan), "width of the action must be a vector of 1 finite"),
        (
            JointTarget(q=HOME, width=np.zeros(2)),  # type: ignore[arg-type]
            "width of the action must be .* found shape (2,)",
        ),
        (
            JointTarget(q=HOME, width=0.0, grip_force=71.0),
            "grip_force of the action must be from 0 to 70; found 71",
        ),
        (
            JointTarget(q=HOME, width=0.0, grip_force=0.0),
            "grip_force of the action must be above 0 [N]; found 0.0",
        ),
        (
            HOME,
            "the action must be a JointTarget, a ToolTarget, Torques, or None; found a ndarray",
        ),
        ({"q": HOME}, "the action must be a JointTarget, .* found a dict"),
    ],
)
def test_what_cannot_be_carried_out_is_refused(action: object, message: str) -> None:
    pattern = re.escape(message).replace(r"\.\*", ".*")
    with pytest.raises(InvalidValueError, match=pattern):
        checked(action)


def test_a_robot_without_a_gripper_has_no_width() -> None:
    arm = Arm(robot_named("hinge6"))
    checked_action(JointTarget(q=arm.home), arm)
    with pytest.raises(InvalidValueError, match="width of the action must be None: the robot"):
        checked_action(JointTarget(q=arm.home, width=0.02), arm)


def test_the_grip_is_half_of_what_the_gripper_can_unless_it_is_said() -> None:
    gripper, action = the_gripper(PANDA), JointTarget(q=HOME, width=0.03)
    assert grip_of(JointTarget(q=HOME), gripper) is None
    grip = grip_of(action, gripper)
    assert grip is not None
    assert (grip.width, grip.force) == (0.03, 35.0)
    grip = grip_of(replace(action, grip_force=8.0), gripper)
    assert grip is not None
    assert grip.force == 8.0


def test_poses_survive_the_way_there_and_back() -> None:
    pose = tool_down([0.3, -0.2, 0.1], 1.1)
    np.testing.assert_allclose(pose_of(vector_of(pose)).as_matrix(), pose.as_matrix(), atol=1e-12)
    np.testing.assert_array_equal(vector_of(pose)[:3], [0.3, -0.2, 0.1])
    # Quaternion (qw, qx, qy, qz) of half a turn about x.
    np.testing.assert_allclose(np.abs(vector_of(tool_down([0, 0, 0]))[3:]), [0, 1, 0, 0], atol=1e-9)
