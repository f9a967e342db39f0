import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from mink import SE3, SO3
from scipy.spatial.transform import Rotation, Slerp

from robo47_qp.arrays import Vector
from robo47_qp.motion.paths.segments import Line
from tests.examples import poses, shifted, turned

HERE = SE3.from_rotation_and_translation(
    SO3.from_rpy_radians(0.4, -1.1, 2.0), np.array([0.4, -0.2, 0.3])
)
HALF_TURN = SE3.from_rotation(SO3(np.array([0.0, 0.0, 1.0, 0.0])))


def rotation(pose: SE3) -> Rotation:
    w, x, y, z = pose.wxyz_xyz[:4]
    return Rotation.from_quat([x, y, z, w])


def apart(a: SE3, b: SE3) -> float:
    """Distance and angle together."""
    turn = (rotation(a).inv() * rotation(b)).magnitude()
    return float(np.linalg.norm(a.wxyz_xyz[4:] - b.wxyz_xyz[4:]) + turn)


@given(start=poses, goal=poses)
@example(start=HERE, goal=HERE @ HALF_TURN)
@example(start=HERE, goal=HERE)
def test_a_line_starts_at_its_start_and_ends_at_its_goal(start: SE3, goal: SE3) -> None:
    line = Line(start, goal)
    assert apart(line.at(0.0), start) < 1e-7
    assert apart(line.at(1.0), goal) < 1e-7


@given(start=poses, goal=poses, s=st.floats(0.0, 1.0))
def test_a_line_is_straight_and_turns_at_a_steady_rate(start: SE3, goal: SE3, s: float) -> None:
    ends = Rotation.concatenate([rotation(start), rotation(goal)])
    assume((ends[0].inv() * ends[1]).magnitude() < np.pi - 1e-3)
    pose = Line(start, goal).at(s)
    between = (1 - s) * start.wxyz_xyz[4:] + s * goal.wxyz_xyz[4:]
    assert pose.translation() == pytest.approx(between, abs=1e-12)
    assert (Slerp([0.0, 1.0], ends)(s).inv() * rotation(pose)).magnitude() < 1e-7


@given(start=poses, goal=poses)
@example(start=HERE, goal=HERE @ HALF_TURN)
def test_length_and_angle_are_those_between_the_ends(start: SE3, goal: SE3) -> None:
    line = Line(start, goal)
    assert line.length == pytest.approx(np.linalg.norm(start.wxyz_xyz[4:] - goal.wxyz_xyz[4:]))
    angle = (rotation(start).inv() * rotation(goal)).magnitude()
    assert line.angle == pytest.approx(angle, abs=1e-7)


def test_the_turn_is_the_shorter_one() -> None:
    line = Line(HERE, turned(HERE, 2, 1.5 * np.pi))
    assert line.angle == pytest.approx(0.5 * np.pi)
    assert apart(line.at(0.5), turned(HERE, 2, -0.25 * np.pi)) < 1e-9


def test_a_goal_with_the_negative_quaternion_is_the_same_goal() -> None:
    goal = turned(shifted(HERE, np.array([0.1, 0.0, 0.0])), 1, 0.5)
    mirrored = SE3(goal.wxyz_xyz * np.array([-1.0] * 4 + [1.0] * 3))
    for s in (0.0, 0.3, 1.0):
        assert apart(Line(HERE, mirrored).at(s), Line(HERE, goal).at(s)) < 1e-9


@given(start=poses, goal=poses, points=arrays(np.float64, (4, 3), elements=st.floats(-2.0, 2.0)))
def test_distances_are_those_from_the_closest_point_between_the_ends(
    start: SE3, goal: SE3, points: Vector
) -> None:
    found = Line(start, goal).distances(points)
    a, b = start.wxyz_xyz[4:], goal.wxyz_xyz[4:]
    between = a + np.linspace(0.0, 1.0, 4001)[:, None] * (b - a)
    for point, distance in zip(points, found, strict=True):
        closest = float(np.linalg.norm(between - point, axis=1).min())
        # The closest of 4001 points is at most half a step further along the line.
        assert distance <= closest + 1e-9
        assert distance >= closest - np.linalg.norm(b - a) / 8000 - 1e-9


@given(
    start=poses,
    goal=poses,
    free=arrays(np.float64, 3, elements=st.floats(-1.0, 1.0)),
    points=arrays(np.float64, (4, 3), elements=st.floats(-2.0, 2.0)),
)
def test_along_a_free_direction_a_point_may_be_anywhere(
    start: SE3, goal: SE3, free: Vector, points: Vector
) -> None:
    assume(np.linalg.norm(free) > 0.1)
    free = free / np.linalg.norm(free)
    across = np.eye(3) - np.outer(free, free)
    found = Line(start, goal).distances(points, free)
    a, b = start.wxyz_xyz[4:], goal.wxyz_xyz[4:]
    between = (a + np.linspace(0.0, 1.0, 4001)[:, None] * (b - a)) @ across
    for point, distance in zip(points @ across, found, strict=True):
        closest = float(np.linalg.norm(between - point, axis=1).min())
        assert distance <= closest + 1e-9
        assert distance >= closest - np.linalg.norm(b - a) / 8000 - 1e-9


def test_distances_beyond_the_ends_are_those_from_the_ends() -> None:
    start = SE3.identity()
    line = Line(start, SE3.from_translation(np.array([1.0, 0.0, 0.0])))
    points = np.array([[-3.0, 0.0, 4.0], [4.0, 4.0, 0.0], [0.5, 0.0, -2.0], [1.0, 0.0, 0.0]])
    assert line.distances(points) == pytest.approx([5.0, 5.0, 2.0, 0.0])


def test_distances_from_a_line_without_length_are_those_from_its_point() -> None:
    line = Line(HERE, turned(HERE, 0, 1.0))
    assert line.length == 0.0
    found = line.distances(HERE.translation() + np.array([[0.0, 3.0, 4.0], [0.0, 0.0, 0.0]]))
    assert found == pytest.approx([5.0, 0.0])
