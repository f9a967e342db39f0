"""An arm with a payload: weight, kinetic energy, frame."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given

from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import Robot
from tests.examples import fractions, rates
from tests.plain_arm import PlainArm
from tests.robots import HELD, both, edited


@given(at=fractions)
def test_a_payload_does_not_move_the_tool(robot: Robot, arm: Arm, at: Vector) -> None:
    loaded, plain = both(robot, HELD)
    q = plain.at(at)
    assert loaded.pose(q).wxyz_xyz.tolist() == arm.pose(q).wxyz_xyz.tolist()
    assert np.abs(loaded.jacobian(q) - arm.jacobian(q)).max() < 1e-12
    assert loaded.limit_margin(q) == arm.limit_margin(q)


@given(at=fractions)
def test_a_payload_weighs_on_the_joints_through_its_centre_of_mass(
    robot: Robot, arm: Arm, at: Vector
) -> None:
    loaded, plain = both(robot, HELD)
    q, still = plain.at(at), np.zeros(plain.n)

    def com(q: Vector) -> Vector:
        position, R = plain.tool(q)
        centre: Vector = position + R @ HELD.T_tcp_com.translation()
        return centre

    h = 1e-5
    J_com = np.array([(com(q + h * e) - com(q - h * e)) / (2 * h) for e in np.eye(arm.n)]).T
    weight = HELD.mass * plain.full.opt.gravity
    more = loaded.inverse_dynamics(q, still, still) - arm.inverse_dynamics(q, still, still)
    assert np.abs(more + J_com.T @ weight).max() < 1e-7


@given(at=fractions, v=rates)
def test_a_payload_adds_the_kinetic_energy_of_a_rigid_body(
    robot: Robot, at: Vector, v: Vector
) -> None:
    loaded, plain = both(robot, HELD)
    q, v = plain.at(at), v[: plain.n]
    energy = 0.5 * float(v @ loaded.mass_matrix(q) @ v)
    assert energy == pytest.approx(plain.kinetic_energy(q, v), rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("turn", ['quat="0.5 0.1 -0.7 0.2"', 'euler="0.3 -0.8 1.1"'])
def test_a_payload_is_held_in_the_tool_frame_however_that_is_turned(
    robot: Robot, tmp_path: Path, turn: str
) -> None:
    tilted = edited(robot, tmp_path, f'name="{robot.tcp}"', f'name="{robot.tcp}" {turn}')
    plain = PlainArm(tilted, HELD)
    loaded = Arm(tilted, HELD)
    still = np.zeros(loaded.n)
    assert loaded.pose(robot.home).rotation().as_matrix() == pytest.approx(
        plain.tool(robot.home)[1], abs=1e-9
    )
    for q in (robot.home, plain.at(np.full(8, 0.3))):
        torque = loaded.inverse_dynamics(q, still, still)
        assert np.abs(torque - plain.gravity_torque(q)).max() < 1e-6
        v = np.ones(loaded.n)
        energy = 0.5 * float(v @ loaded.mass_matrix(q) @ v)
        assert energy == pytest.approx(plain.kinetic_energy(q, v), rel=1e-6)


@pytest.mark.parametrize("pose", [None, 3.0, "here", np.eye(4)])
def test_a_payload_at_what_is_no_pose_is_refused(pose: Any) -> None:
    with pytest.raises(InvalidValueError, match=r"payload T_tcp_com must be a mink\.SE3; found"):
        replace(HELD, T_tcp_com=pose)


@pytest.mark.parametrize(
    "inertia", [None, (None, None, None), "abc", ("1", "1", "1"), 1.0, ((1.0,), (1.0, 2.0), 3.0)]
)
def test_moments_that_are_no_numbers_are_refused(inertia: Any) -> None:
    with pytest.raises(InvalidValueError, match=r"payload inertia must be .*finite number"):
        replace(HELD, inertia=inertia)
