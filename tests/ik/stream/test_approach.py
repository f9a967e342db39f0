"""How fast to go to a target, and what its own motion is taken to be."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mink import SE3, SO3
from scipy.spatial.transform import Rotation

from robo47_qp.arrays import Vector
from robo47_qp.ik.stream.target_velocity import TargetMotion, approach_rate, shortened
from tests.examples import rotations

DT = 1e-3
ANYWHERE = np.full(6, 1e9)


def follow(way: Vector, v_max: Vector, a_max: Vector, gain: float) -> tuple[Vector, Vector]:
    """Ways and velocities of joints that do at each tick what the law says."""
    ways, velocities = [way], [np.zeros_like(way)]
    for _ in range(12000):
        v = approach_rate(ways[-1], v_max, a_max, gain) * ways[-1]
        ways.append(ways[-1] - DT * (v + velocities[-1]) / 2)
        velocities.append(v)
    return np.array(ways), np.array(velocities)


@settings(max_examples=20)  # of thousands of periods each
@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3).map(np.array), st.floats(5.0, 100.0))
def test_joints_arrive_together_and_without_overshoot(way: Vector, gain: float) -> None:
    v_max, a_max = np.array([2.0, 1.5, 1.0]), np.array([5.0, 8.0, 3.0])
    ways, velocities = follow(way, v_max, a_max, gain)
    assert (np.abs(velocities) <= v_max + 1e-12).all()
    # The start jumps; from then on the brakes suffice (one tick's worth of sampling beside).
    a = np.diff(velocities[1:], axis=0) / DT
    assert (np.abs(a) <= a_max * (1 + 2 * gain * DT) + 1e-9).all()
    assert np.abs(ways[-1]).max() < 1e-3
    assert (ways * np.sign(way) >= -1e-12).all()
    straight = np.outer(ways[:, 0], way) - np.outer(ways @ np.array([1.0, 0, 0]), way)
    assert np.abs(straight).max() < 1e-12
    for i in range(3):
        np.testing.assert_allclose(ways[:, i] * way[0], ways[:, 0] * way[i], atol=1e-9)


def test_close_by_the_way_shrinks_by_the_gain() -> None:
    way, bounds = np.array([1e-4, -2e-4]), np.full(2, 5.0)
    assert approach_rate(way, bounds, bounds, 40.0) == 40.0
    assert approach_rate(np.zeros(2), bounds, bounds, 40.0) == 40.0


def test_far_away_the_slowest_joint_sets_the_pace() -> None:
    v_max, a_max = np.array([2.0, 0.5]), np.array([1e3, 1e3])
    assert approach_rate(np.array([4.0, 2.0]), v_max, a_max, 50.0) == pytest.approx(0.25)
    # Half way to the end, braking decides: v² = 2 a d but for the soft end.
    rate = approach_rate(np.array([0.5]), np.array([100.0]), np.array([4.0]), 1e4)
    assert 0.5 * rate == pytest.approx(2.0, rel=1e-3)


@given(st.lists(st.floats(-1e300, 1e300), min_size=3, max_size=3).map(np.array))
def test_a_long_way_is_shortened_in_its_direction(displacement: Vector) -> None:
    short = shortened(displacement, 0.5)
    assert np.linalg.norm(short) <= 0.5 * (1 + 1e-12)
    largest = np.abs(displacement).max()
    if largest > 1.0:
        assert np.linalg.norm(short) == pytest.approx(0.5)
        unit = displacement / largest
        np.testing.assert_allclose(short, 0.5 * unit / np.linalg.norm(unit), atol=1e-12)


def test_a_short_way_stays_as_it_is() -> None:
    way = np.array([0.1, -0.2, 0.3])
    assert (shortened(way, 0.5) == way).all()


def target(R: Rotation, p: Vector) -> Vector:
    pose: Vector = np.concatenate([R.as_quat(scalar_first=True), p])
    return pose


@given(rotations, st.floats(-6.0, 6.0))
def test_a_moving_target_has_the_twist_that_moved_it(start: SO3, rate: float) -> None:
    R0 = Rotation.from_quat(start.wxyz, scalar_first=True)
    v, w = np.array([0.3, -0.2, 0.1]), rate * np.array([0.48, -0.6, 0.64])
    motion = TargetMotion(DT)
    first, jumped = motion.twist(target(R0, np.zeros(3)), ANYWHERE)
    assert not jumped
    assert (first == 0.0).all()
    for k in range(1, 4):
        R = Rotation.from_rotvec(w * DT * k) * R0
        flip = (-1.0) ** k  # q and -q are the same rotation
        pose = target(R, v * DT * k)
        pose[:4] *= flip
        twist, jumped = motion.twist(pose, ANYWHERE)
        assert not jumped
        np.testing.assert_allclose(twist[:3], v, rtol=1e-9)
        np.testing.assert_allclose(twist[3:], w, atol=1e-9)


def test_a_jump_has_no_velocity_and_is_told() -> None:
    fastest = np.array([1.0, 1.0, 1.0, 3.0, 3.0, 3.0])
    motion, still = TargetMotion(DT), SE3.identity().wxyz_xyz
    motion.twist(still, fastest)
    near, far, turned = still.copy(), still.copy(), still.copy()
    near[4], far[5] = 0.9e-3, 0.1
    turned[:4] = [np.cos(0.01), np.sin(0.01), 0.0, 0.0]
    assert motion.twist(near, fastest)[0][0] == pytest.approx(0.9)
    for pose in (far, turned):
        motion.reset()
        motion.twist(still, fastest)
        twist, jumped = motion.twist(pose, fastest)
        assert jumped
        assert (twist == 0.0).all()
        again, jumped = motion.twist(pose, fastest)
        assert not jumped
        assert (again == 0.0).all()


def test_what_is_forgotten_is_no_jump() -> None:
    motion = TargetMotion(DT)
    a, b = SE3.identity().wxyz_xyz, SE3.from_translation(np.ones(3)).wxyz_xyz
    motion.twist(a, np.ones(6))
    motion.reset()
    twist, jumped = motion.twist(b, np.ones(6))
    assert not jumped
    assert (twist == 0.0).all()
