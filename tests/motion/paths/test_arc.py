import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from mink import SE3, SO3
from scipy.spatial.transform import Rotation

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.motion.paths.segments import Arc, arc_about, arc_through

TURN = np.array([0.3, -0.2, 0.5])


def pose(x: float, y: float, z: float, turn: Vector | None = None) -> SE3:
    rotation = SO3.identity() if turn is None else SO3.exp(turn)
    return SE3.from_rotation_and_translation(rotation, np.array([x, y, z]))


def at(place: Vector) -> SE3:
    return SE3.from_rotation_and_translation(SO3.exp(TURN), place)


def half_turn() -> Arc:
    return arc_through(pose(1.0, 0.0, 0.2), pose(-1.0, 0.0, 0.2, TURN), np.array([0.0, 1.0, 0.2]))


def places(arc: Arc, s: Vector) -> Matrix:
    return np.array([arc.at(float(x)).translation() for x in s])


coordinate = st.floats(-0.5, 0.5)
point = st.tuples(coordinate, coordinate, coordinate).map(np.array)


@given(a=point, b=point, c=point)
def test_it_starts_ends_and_passes_where_asked_on_one_circle(
    a: Vector, b: Vector, c: Vector
) -> None:
    area = np.linalg.norm(np.cross(b - a, c - a))
    assume(area > 0.02)
    arc = arc_through(at(a), at(c), b)
    assert arc.at(0.0).translation() == pytest.approx(a, abs=1e-9)
    assert arc.at(1.0).translation() == pytest.approx(c, abs=1e-9)
    points = places(arc, np.linspace(0.0, 1.0, 401))
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    nearest = int(np.linalg.norm(points - b, axis=1).argmin())
    closer = places(arc, np.clip((nearest + np.linspace(-1.0, 1.0, 41)) / 400, 0.0, 1.0))
    assert np.linalg.norm(closer - b, axis=1).min() <= 0.1 * steps.max()
    # The circle of three points by its sides and its area.
    sides = [float(np.linalg.norm(x)) for x in (b - a, c - b, a - c)]
    assert arc.radius == pytest.approx(np.prod(sides) / (2.0 * area), rel=1e-6)
    np.testing.assert_allclose(steps, arc.length / 400, rtol=1e-4)
    assert np.abs((points - a) @ np.cross(b - a, c - a)).max() < 1e-9


def test_the_longer_way_is_taken_where_the_point_lies_on_it() -> None:
    start, goal = pose(1.0, 0.0, 0.0), pose(0.0, 1.0, 0.0)
    short = arc_through(start, goal, np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0))
    far = arc_through(start, goal, np.array([-1.0, 0.0, 0.0]))
    assert short.length == pytest.approx(0.5 * np.pi)
    assert far.length == pytest.approx(1.5 * np.pi)


def test_the_orientation_turns_steadily_about_one_axis() -> None:
    arc = half_turn()
    for s in (0.0, 0.3, 1.0):
        R = arc.at(s).rotation().as_matrix()
        assert Rotation.from_matrix(R).as_rotvec() == pytest.approx(s * TURN, abs=1e-9)
    assert arc.angle == pytest.approx(np.linalg.norm(TURN))
    assert arc.turn == pytest.approx(TURN)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_derivatives_are_those_of_the_position(order: int) -> None:
    arc, h = half_turn(), 1e-3
    for s in (0.2, 0.7):
        around = [arc.position(s + k * h, order - 1) for k in (-1, 1)]
        slope = (around[1] - around[0]) / (2 * h)
        assert arc.position(s, order) == pytest.approx(slope, rel=1e-4, abs=1e-4)


def test_about_a_centre_the_shorter_way_is_taken() -> None:
    arc = arc_about(pose(1.0, 0.0, 0.0), pose(0.0, 1.0, 0.0, TURN), np.zeros(3))
    assert arc.at(0.5).translation() == pytest.approx([np.sqrt(0.5), np.sqrt(0.5), 0.0])
    assert arc.length == pytest.approx(0.5 * np.pi)


def test_a_centre_that_is_rounded_off_still_leads_to_the_goal() -> None:
    arc = arc_about(pose(1.0, 0.0, 0.0), pose(0.0, 1.0, 0.0), np.array([4e-5, -2e-5, 3e-5]))
    assert arc.at(0.0).translation() == pytest.approx([1.0, 0.0, 0.0], abs=1e-12)
    assert arc.at(1.0).translation() == pytest.approx([0.0, 1.0, 0.0], abs=1e-9)


def test_distances_are_those_to_the_nearest_point() -> None:
    arc = arc_through(pose(1.0, 0.0, 0.0), pose(0.0, 1.0, 0.0), np.array([0.8, 0.6, 0.0]))
    fine = np.array([arc.at(s).translation() for s in np.linspace(0.0, 1.0, 20001)])
    around = np.random.default_rng(1).uniform(-2.0, 2.0, (40, 3))
    nearest = [np.linalg.norm(fine - place, axis=1).min() for place in around]
    assert arc.distances(around) == pytest.approx(nearest, abs=1e-5)


def test_along_the_axis_of_its_circle_a_point_may_be_anywhere() -> None:
    start, goal = pose(1.0, 0.2, 0.1), pose(0.1, 1.1, 0.3)
    arc = arc_through(start, goal, np.array([0.9, 0.8, 0.0]))
    begin, middle, end = places(arc, np.array([0.0, 0.5, 1.0]))
    axis = np.cross(middle - begin, end - begin)
    axis /= np.linalg.norm(axis)
    across = np.eye(3) - np.outer(axis, axis)
    fine = places(arc, np.linspace(0.0, 1.0, 20001)) @ across
    around = np.random.default_rng(1).uniform(-2.0, 2.0, (40, 3))
    nearest = [np.linalg.norm(fine - place, axis=1).min() for place in around @ across]
    assert arc.distances(around, axis) == pytest.approx(nearest, abs=1e-5)
    assert (arc.distances(around) > arc.distances(around, axis) + 1e-3).all()


@pytest.mark.parametrize("along", [0.0, 0.3, 1.0, 2.0, -1.0])
def test_three_points_on_a_line_are_refused(along: float) -> None:
    through = np.array([along, 0.0, 0.0])
    with pytest.raises(InvalidValueError, match="off the line through start"):
        arc_through(pose(0.0, 0.0, 0.0), pose(1.0, 0.0, 0.0), through)


def test_a_way_back_to_the_start_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="off the line"):
        arc_through(pose(0.1, 0.2, 0.3), pose(0.1, 0.2, 0.3), np.array([0.5, 0.0, 0.0]))


def test_a_centre_that_is_none_is_refused_with_its_distances() -> None:
    with pytest.raises(InvalidValueError, match=r"1\.000000 m from the start and 2\.000000 m"):
        arc_about(pose(1.0, 0.0, 0.0), pose(0.0, 2.0, 0.0), np.zeros(3))
    with pytest.raises(InvalidValueError, match="in line with start and goal"):
        arc_about(pose(1.0, 0.0, 0.0), pose(-1.0, 0.0, 0.0), np.zeros(3))
