from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mink import SE3, SO3
from scipy.spatial.transform import Rotation

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.motion.paths.curves import BlendError, PoseSpline, ToolCurve
from robo47_qp.motion.paths.segments import Line, PathProfile, arc_through

PROFILE = PathProfile()


def poses(rng: np.random.Generator, count: int, turn: float = 0.6) -> list[SE3]:
    found = [SE3.identity()]
    while len(found) < count:
        shift = rng.normal(size=3)
        shift *= rng.uniform(0.1, 0.3) / np.linalg.norm(shift)
        rotation = found[-1].rotation() @ SO3.exp(rng.uniform(-turn, turn, 3))
        there = found[-1].translation() + shift
        found.append(SE3.from_rotation_and_translation(rotation, there))
    return found


def bent(rng: np.random.Generator, radii: tuple[float, ...]) -> ToolCurve:
    """Lines, and an arc in the middle."""
    visited = poses(rng, len(radii) + 2)
    segments = [Line(a, b) for a, b in pairwise(visited)]
    middle = 0.5 * (visited[1].translation() + visited[2].translation())
    through = middle + np.array([0.03, -0.04, 0.05])
    return ToolCurve(
        [segments[0], arc_through(visited[1], visited[2], through), *segments[2:]], radii, PROFILE
    )


def places(curve: ToolCurve | PoseSpline, s: Vector) -> tuple[Matrix, Rotation]:
    visited = [curve.at(float(x)) for x in s]
    quats = np.array([np.roll(pose.rotation().wxyz, -1) for pose in visited])
    return np.array([pose.translation() for pose in visited]), Rotation.from_quat(quats)


def rates(curve: ToolCurve | PoseSpline, at: float, h: float) -> Matrix:
    """Velocity and turn rate on a fine grid about a place (N, 6)."""
    p, R = places(curve, at + h * np.arange(-40.0, 41.0))
    turns = R[:-1].apply((R[:-1].inv() * R[1:]).as_rotvec())
    return np.hstack([np.diff(p, axis=0), turns]) / h


@settings(max_examples=8)
@given(seed=st.integers(0, 1000))
def test_speed_and_acceleration_of_the_path_have_no_jumps(seed: int) -> None:
    """Across each border, differences of first and second order fall with the step."""
    curve = bent(np.random.default_rng(seed), (0.03, 0.02, 0.025))
    for cut in curve.cuts[1:-1]:
        jumps, a = [], np.zeros(1)
        for h in (2e-5, 1e-5):
            v = rates(curve, float(cut), h)
            a = np.diff(v, axis=0) / h
            jumps.append(np.abs(a[45:].mean(axis=0) - a[:34].mean(axis=0)).max())
        # A jump would stay; what is smooth halves.
        assert jumps[1] < 0.6 * jumps[0] + 0.02 * np.abs(a).max()


@settings(max_examples=15)
@given(seed=st.integers(0, 1000), radius=st.floats(0.002, 0.045))
def test_it_keeps_to_the_segments_outside_the_radius_and_near_them_inside(
    seed: int, radius: float
) -> None:
    visited = poses(np.random.default_rng(seed), 4)
    lines = [Line(a, b) for a, b in pairwise(visited)]
    curve = ToolCurve(lines, (radius, radius), PROFILE)
    p, _ = places(curve, np.linspace(0.0, 1.0, 2001))
    off = np.min([line.distances(p) for line in lines], axis=0)
    corners = np.array([pose.translation() for pose in visited[1:-1]])
    near = np.linalg.norm(p[:, None] - corners, axis=2).min(axis=1)
    assert off[near > radius * (1 + 1e-9)].max() < 1e-12
    assert off.max() < 0.5 * radius
    # It does cut the corner, and not by stopping there.
    assert near.min() > 1e-4 * radius
    assert p[0] == pytest.approx(visited[0].translation(), abs=1e-12)
    assert p[-1] == pytest.approx(visited[-1].translation(), abs=1e-12)


def test_the_orientation_is_that_of_the_segments_outside_the_corners() -> None:
    visited = poses(np.random.default_rng(5), 3)
    lines = [Line(visited[0], visited[1]), Line(visited[1], visited[2])]
    curve = ToolCurve(lines, (0.02,), PROFILE)
    corner, (first, last) = float(curve.corners[0]), curve.cuts[1:3]
    for s in (0.0, 0.5 * first, first):
        expected = lines[0].at(s / corner)
        assert curve.at(s).wxyz_xyz == pytest.approx(expected.wxyz_xyz, abs=1e-9)
    for s in (last, 0.5 * (1 + last), 1.0):
        expected = lines[1].at((s - corner) / (1 - corner))
        assert curve.at(s).wxyz_xyz == pytest.approx(expected.wxyz_xyz, abs=1e-9)
    assert first < corner < last
    assert [curve.segment_at(s) for s in (0.0, corner - 1e-6, corner + 1e-6, 1.0)] == [0, 0, 1, 1]


def test_blends_that_do_not_fit_name_their_segment() -> None:
    visited = [
        SE3.from_translation(np.array([x, y, 0.0]))
        for x, y in ((0.0, 0.0), (0.1, 0.0), (0.1, 0.1), (0.3, 0.1))
    ]
    lines = [Line(a, b) for a, b in pairwise(visited)]
    with pytest.raises(BlendError, match=r"would take 120 % of it") as caught:
        ToolCurve(lines, (0.06, 0.06), PROFILE)
    assert caught.value.segment == 1
    with pytest.raises(BlendError, match="ends within the blend radius") as caught:
        ToolCurve(lines, (0.02, 0.15), PROFILE)
    assert caught.value.segment == 1
    ToolCurve(lines, (0.04, 0.05), PROFILE)


@settings(max_examples=10)
@given(seed=st.integers(0, 1000))
def test_poses_are_passed_exactly_on_a_smooth_way(seed: int) -> None:
    visited = poses(np.random.default_rng(seed), 4)
    way = PoseSpline(visited, PROFILE)
    for s, pose in zip(way.places, visited, strict=True):
        found = way.at(float(s))
        assert found.translation() == pytest.approx(pose.translation(), abs=1e-12)
        assert (found.rotation().inverse() @ pose.rotation()).log() == pytest.approx(
            np.zeros(3), abs=1e-7
        )
    for s in way.corners:
        bends, a = [], np.zeros(1)
        for h in (2e-4, 1e-4):
            v = rates(way, float(s), h)
            a = np.diff(v, axis=0) / h
            bends.append(np.abs(a[45:].mean(axis=0) - a[:34].mean(axis=0)).max())
        assert bends[1] < 0.6 * bends[0] + 0.02 * np.abs(a).max()
    p, R = places(way, np.linspace(0.0, 1.0, 801))
    assert way.length == pytest.approx(np.linalg.norm(np.diff(p, axis=0), axis=1).sum(), rel=1e-3)
    assert way.angle == pytest.approx((R[:-1].inv() * R[1:]).magnitude().sum(), rel=1e-2)
