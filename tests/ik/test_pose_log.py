"""The logarithm and its slope against the exponential of matrices, and against mink."""

from itertools import product

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from mink import SE3, SO3
from scipy.linalg import expm

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.ik.pose_log import PoseLog
from tests.examples import rotations

SWITCH = 0.1
"""Where the series ends: θ² = 1e-2."""
ANGLES = (
    *(0.0, 1e-12, 1e-9, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.05),
    *(SWITCH - 1e-3, SWITCH - 1e-9, SWITCH, SWITCH + 1e-9, SWITCH + 1e-3),
    *(0.3, 1.0, 2.0, 3.0, np.pi - 1e-3, np.pi - 1e-9, np.pi),
)
AXES = [*np.eye(3), *-np.eye(3), np.array([2.0, -1.0, 2.0]) / 3.0]
PLACES = (np.zeros(3), np.array([0.4, -0.7, 0.2]), np.array([-3.0, 0.0, 5.0]))


def cross(w: Vector) -> Matrix:
    x, y, z = w
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def exponential(twist: Vector) -> Matrix:
    """The pose (4, 4) at the end of a steady twist."""
    generator = np.zeros((4, 4))
    generator[:3, :3], generator[:3, 3] = cross(twist[3:]), twist[:3]
    return np.asarray(expm(generator))


def left_jacobian(twist: Vector) -> Matrix:
    """∫₀¹ exp(s ad) ds, from the exponential of [[ad, I], [0, 0]]."""
    ad = np.zeros((6, 6))
    ad[:3, :3] = ad[3:, 3:] = cross(twist[3:])
    ad[:3, 3:] = cross(twist[:3])
    both = np.zeros((12, 12))
    both[:6, :6], both[:6, 6:] = ad, np.eye(6)
    return np.asarray(expm(both))[:6, 6:]


def pose_of(e: Vector) -> SE3:
    """Displacement and rotation vector as mink's pose."""
    angle = float(np.linalg.norm(e[3:]))
    axis = e[3:] / angle if angle > 0.0 else np.zeros(3)
    wxyz = np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * axis])
    return SE3.from_rotation_and_translation(SO3(wxyz), e[:3])


@pytest.mark.parametrize("angle", ANGLES)
def test_the_twist_leads_there_and_its_slope_is_the_inverse_jacobian(angle: float) -> None:
    for axis, p in product(AXES, PLACES):
        e = np.concatenate([p, angle * axis])
        twist, slope = PoseLog().expand(e)
        there = np.eye(4)
        there[:3, :3], there[:3, 3] = expm(cross(e[3:])), p
        size = 1.0 + np.linalg.norm(p)
        assert np.abs(exponential(twist) - there).max() < 1e-13 * size
        expected = np.linalg.inv(left_jacobian(twist))
        assert np.abs(slope - expected).max() < 3e-12 * size


@given(
    p=arrays(np.float64, 3, elements=st.floats(-2.0, 2.0)),
    axis=arrays(np.float64, 3, elements=st.floats(-1.0, 1.0)).filter(lambda a: a @ a > 1e-2),
    angle=st.floats(0.0, np.pi),
)
def test_any_displacement_and_turn(p: Vector, axis: Vector, angle: float) -> None:
    e = np.concatenate([p, angle * axis / np.linalg.norm(axis)])
    twist, slope = PoseLog().expand(e)
    there = np.eye(4)
    there[:3, :3], there[:3, 3] = expm(cross(e[3:])), p
    assert np.abs(exponential(twist) - there).max() < 1e-12
    assert np.abs(slope @ left_jacobian(twist) - np.eye(6)).max() < 1e-10


@pytest.mark.parametrize("angle", [1e-3, 0.0999, 0.1001, 1.0, 2.5, 3.1])
def test_the_slope_is_how_the_twist_falls(angle: float) -> None:
    """By differences: a tool that moves by a small twist of its own has less to go."""
    e = np.concatenate([[0.3, -0.5, 0.2], angle * np.array([0.6, 0.0, -0.8])])
    twist, slope = (part.copy() for part in PoseLog().expand(e))
    h = 1e-6
    for direction, expected in zip(np.eye(6), slope.T, strict=True):
        # In world axes at the tool: the way left after a small step δ is exp(-δ) T.
        ends = []
        for step in (h, -h):
            left = exponential(-step * direction) @ exponential(twist)
            rotation = SO3.from_matrix(left[:3, :3]).log()
            ends.append(PoseLog().expand(np.concatenate([left[:3, 3], rotation]))[0].copy())
        assert (ends[1] - ends[0]) / (2 * h) == pytest.approx(expected, abs=1e-7)


@given(rotation=rotations, p=arrays(np.float64, 3, elements=st.floats(-1.0, 1.0)))
def test_it_is_the_logarithm_and_slope_of_mink(rotation: SO3, p: Vector) -> None:
    turn = rotation.log()
    angle = float(np.linalg.norm(turn))
    # Close to none, mink's slope is another: see below. At half a turn, its logarithm is.
    assume(1e-3 < angle < np.pi - 1e-3)
    pose = SE3.from_rotation_and_translation(rotation, p)
    twist, slope = PoseLog().expand(np.concatenate([p, turn]))
    assert twist == pytest.approx(pose.log(), abs=1e-9)
    # The slope of the way left is that of the inverse pose's logarithm, of which jlog is one.
    assert np.abs(slope - pose.inverse().jlog()).max() < 1e-7


@pytest.mark.parametrize("angle", [1e-7, 1e-6, 9e-6])
def test_below_1e_5_rad_mink_leaves_half_the_displacement_out_of_its_slope(angle: float) -> None:
    """A fact about mink 1.3: its jlog jumps to the identity there, and ours does not."""
    e = np.concatenate([[0.3, -0.5, 0.2], angle * np.array([0.6, 0.0, -0.8])])
    twist, slope = PoseLog().expand(e)
    pose = pose_of(e)
    assert twist == pytest.approx(pose.log(), abs=1e-12)
    assert np.abs(slope - np.linalg.inv(left_jacobian(twist))).max() < 1e-14
    assert np.abs(pose.inverse().jlog() - np.eye(6)).max() < 1e-14
    assert np.abs(pose.inverse().jlog() - slope).max() == pytest.approx(0.25, abs=1e-5)
    # Just above, both agree.
    e[3:] *= 2e-5 / angle
    assert np.abs(PoseLog().expand(e)[1] - pose_of(e).inverse().jlog()).max() < 1e-6


def test_memory_is_used_again_and_nothing_of_the_last_call_is_left() -> None:
    twist = PoseLog()
    e = np.array([0.3, -0.5, 0.2, 0.7, 0.1, -0.4])
    asked = e.copy()
    first = [part.tobytes() for part in twist.expand(e)]
    twist.expand(np.array([5.0, 4.0, -3.0, 1.0, 2.0, 0.5]))
    twist.expand(np.zeros(6))
    assert [part.tobytes() for part in twist.expand(e)] == first
    assert e.tolist() == asked.tolist()


def test_without_a_turn_the_twist_is_the_displacement() -> None:
    e = np.array([0.3, -0.5, 0.2, 0.0, 0.0, 0.0])
    twist, slope = PoseLog().expand(e)
    assert twist.tolist() == e.tolist()
    expected = np.eye(6)
    expected[:3, 3:] = -0.5 * cross(e[:3])
    assert slope.tolist() == pytest.approx(expected)
