"""The way to a target and the Jacobian, against MuJoCo and differences of poses alone."""

import numpy as np
import pytest
from hypothesis import given
from mink import SE3, SO3
from scipy.spatial.transform import Rotation

from robo47_qp.arrays import Vector
from robo47_qp.ik.tool_error import ToolError
from robo47_qp.model.arm import Arm
from tests.examples import fractions, poses, shifted, turned
from tests.plain_arm import PlainArm


def way(plain: PlainArm, q: Vector, target: SE3) -> Vector:
    """Displacement and rotation vector from the tool to a pose, in world axes."""
    position, R = plain.tool(q)
    turn = Rotation.from_matrix(target.rotation().as_matrix()) * Rotation.from_matrix(R).inv()
    return np.concatenate([target.translation() - position, turn.as_rotvec()])


@given(at=fractions, target=poses)
def test_the_error_leads_from_the_tool_to_the_target(
    arm: Arm, plain: PlainArm, at: Vector, target: SE3
) -> None:
    q, error = plain.at(at), ToolError(arm)
    error.set_target(target)
    distance2, angle2 = error.move(q)
    expected = way(plain, q, target)
    assert error.e[:3] == pytest.approx(expected[:3], abs=1e-12)
    # A half turn has two rotation vectors.
    turn = error.e[3:] if np.linalg.norm(expected[3:]) < np.pi - 1e-6 else np.abs(error.e[3:])
    aside = expected[3:] if np.linalg.norm(expected[3:]) < np.pi - 1e-6 else np.abs(expected[3:])
    assert turn == pytest.approx(aside, abs=1e-7)
    assert distance2 == pytest.approx(expected[:3] @ expected[:3], abs=1e-12)
    assert angle2 == pytest.approx(expected[3:] @ expected[3:], abs=1e-9)


@given(at=fractions)
def test_the_jacobian_is_the_slope_of_the_tool(arm: Arm, plain: PlainArm, at: Vector) -> None:
    q, error = plain.at(at), ToolError(arm)
    error.move(q)
    error.update_jacobian()
    _, R = plain.tool(q)
    in_tool_axes = plain.jacobian(q)
    expected = np.vstack([R @ in_tool_axes[:3], R @ in_tool_axes[3:]])
    assert np.abs(error.J - expected).max() < 1e-8


def test_a_step_along_the_jacobian_shortens_the_error(arm: Arm, plain: PlainArm) -> None:
    """Signs and axes of both together: e falls by J dq."""
    error = ToolError(arm)
    error.set_target(turned(shifted(arm.pose(arm.home), np.array([0.02, -0.03, 0.01])), 1, 0.05))
    error.move(arm.home)
    error.update_jacobian()
    before, J = error.e.copy(), error.J.copy()
    dq = 1e-5 * np.arange(1.0, arm.n + 1)
    error.move(arm.home + dq)
    assert (before - error.e)[:3] == pytest.approx((J @ dq)[:3], abs=1e-8)
    # The rotation vector falls by the turn but for terms of its own size.
    assert (before - error.e)[3:] == pytest.approx((J @ dq)[3:], abs=0.05 * np.abs(J @ dq).max())


def test_a_quaternion_and_its_negative_are_one_target(arm: Arm) -> None:
    target = turned(arm.pose(arm.home), 0, 2.0)
    signs = np.array([-1.0] * 4 + [1.0] * 3)
    ways = []
    for same in (target, SE3(target.wxyz_xyz * signs)):
        error = ToolError(arm)
        error.set_target(same)
        assert error.move(arm.home)[1] == pytest.approx(4.0)
        ways.append(error.e.copy())
    assert ways[0] == pytest.approx(ways[1], abs=1e-12)


def test_half_a_turn_is_not_taken_for_none(arm: Arm) -> None:
    error = ToolError(arm)
    for half_turn in np.eye(4)[1:]:
        error.set_target(arm.pose(arm.home) @ SE3.from_rotation(SO3(half_turn)))
        distance2, angle2 = error.move(arm.home)
        assert distance2 < 1e-20
        assert angle2 == pytest.approx(np.pi**2)


def test_it_keeps_its_own_state(arm: Arm) -> None:
    """Two of one arm, the arm itself, the target and q do not touch one another."""
    one, other = ToolError(arm), ToolError(arm)
    q = arm.home.copy()
    numbers = arm.pose(arm.home + 0.1).wxyz_xyz.copy()
    one.set_target(SE3(numbers))
    numbers[:] = 0.0
    one.move(q)
    e = one.e.copy()
    q[:] = 9.0
    other.set_target(SE3.identity())
    other.move(arm.home + 0.4)
    arm.pose(arm.home + 0.2)
    one.update_jacobian()
    assert one.e.tolist() == e.tolist()
    fresh = ToolError(arm)
    fresh.move(arm.home)
    fresh.update_jacobian()
    assert one.J.tolist() == fresh.J.tolist()
    assert one.data.qpos.tolist() == arm.home.tolist()
    assert one.data.site_xpos[arm.model.site(arm.robot.tcp).id] == pytest.approx(
        arm.pose(arm.home).translation()
    )
