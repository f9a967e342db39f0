"""Keys move the target as their names say, and jumps become motion."""

import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.constants import TIMESTEP
from robo47_qp.run.teleop.steering import HOME_KEY, SmoothedPose, moved_by_key

START = SE3.from_rotation_and_translation(SO3.exp(np.array([3.0, 0.0, 0.0])), np.full(3, 0.3))
AWAY = SE3.from_rotation_and_translation(SO3.exp(np.array([2.5, 0.4, 0.1])), np.full(3, 0.5))
RIGHT, LEFT, DOWN, UP, PAGE_UP, PAGE_DOWN = range(262, 268)
"""Codes of keys in GLFW."""


@pytest.mark.parametrize(
    ("key", "direction"),
    [
        (UP, (1, 0, 0)),
        (DOWN, (-1, 0, 0)),
        (LEFT, (0, 1, 0)),
        (RIGHT, (0, -1, 0)),
        (PAGE_UP, (0, 0, 1)),
        (PAGE_DOWN, (0, 0, -1)),
    ],
)
def test_a_key_moves_the_target_by_two_centimetres(key: int, direction: tuple[int, ...]) -> None:
    moved = moved_by_key(key, AWAY, START)
    way = moved.translation() - AWAY.translation()
    np.testing.assert_allclose(way, 0.02 * np.array(direction), atol=1e-12)
    np.testing.assert_array_equal(moved.rotation().wxyz, AWAY.rotation().wxyz)


@pytest.mark.parametrize(("key", "sign"), [(ord(","), 1.0), (ord("."), -1.0)])
def test_a_key_turns_the_target_about_the_vertical(key: int, sign: float) -> None:
    moved = moved_by_key(key, AWAY, START)
    np.testing.assert_array_equal(moved.translation(), AWAY.translation())
    turned = (moved.rotation() @ AWAY.rotation().inverse()).log()
    np.testing.assert_allclose(turned, [0.0, 0.0, sign * np.deg2rad(10.0)], atol=1e-9)


def test_home_brings_it_back_and_other_keys_do_nothing() -> None:
    assert moved_by_key(HOME_KEY, AWAY, START) is START
    np.testing.assert_allclose(moved_by_key(ord("Q"), AWAY, START).wxyz_xyz, AWAY.wxyz_xyz)


def test_a_jump_is_followed_without_one_and_without_passing_it() -> None:
    smoothed = SmoothedPose(START)
    poses = [START, *(smoothed.step(AWAY) for _ in range(1500))]
    way = AWAY.translation() - START.translation()
    along = np.array([(p.translation() - START.translation()) @ way for p in poses]) / (way @ way)
    assert along.max() < 1.0 + 1e-9
    assert along[-1] == pytest.approx(1.0, abs=1e-6)
    turns = [
        (poses[k + 1].rotation() @ poses[k].rotation().inverse()).log() / TIMESTEP
        for k in range(0, 1500, 7)
    ]
    speeds = np.diff([p.translation() for p in poses], axis=0) / TIMESTEP
    assert np.linalg.norm(speeds, axis=1).max() < 1.0
    assert np.linalg.norm(turns, axis=1).max() < 3.0
    # No step of its velocity that a feed-forward would feel: ω² e at most.
    assert np.abs(np.diff(speeds, axis=0)).max() < 30.0**2 * 2.0 / 30.0 * TIMESTEP * 1.01
    last = (AWAY.rotation() @ poses[-1].rotation().inverse()).log()
    assert np.linalg.norm(last) < 1e-5
