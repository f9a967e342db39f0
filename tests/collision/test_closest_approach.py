"""Closest approach against looking at every row."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp._core.library import using
from robo47_qp.collision.closest_approach import RESOLUTION, ClosestApproach
from robo47_qp.errors import ModelError
from robo47_qp.model.arm import Arm
from robo47_qp.model.obstacle import Obstacle, Shape
from robo47_qp.model.robots.panda import PANDA
from tests.robots import robot_named
from tests.small_robots import at, cell, gantry


def wandering(rng: np.random.Generator, count: int) -> np.ndarray:
    """A smooth way through random configurations of the Panda and its fingers."""
    knots = rng.uniform(-1.0, 1.0, (6, 7)) + PANDA.home
    fingers = rng.uniform(0.0, 0.04, (6, 2))
    s = np.linspace(0, 5, count)
    return np.stack([np.interp(s, range(6), c) for c in np.hstack([knots, fingers]).T], axis=1)


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_nothing_closer_is_missed(seed: int) -> None:
    obstacles = cell()[seed : seed + 2]
    closest = ClosestApproach(PANDA, obstacles)
    q = wandering(np.random.default_rng(seed), 1500)
    found = closest.along(q)
    every = np.array([closest.distances.at(row).min() for row in q])
    assert every.min() - 1e-12 <= found.distance <= every.min() + RESOLUTION
    assert every[found.row] == pytest.approx(found.distance, abs=1e-12)
    assert found.obstacle in {obstacle.name for obstacle in obstacles}


@pytest.mark.parametrize("own", [False, True])
def test_the_core_finds_the_same_to_the_bit(monkeypatch: pytest.MonkeyPatch, own: bool) -> None:
    q = wandering(np.random.default_rng(90_022), 700)
    crossings: list[int] = []
    # Through the arm and around it: capsules cross boxes, which MuJoCo gets wrong.
    turned = SE3.from_rotation(SO3.exp(np.array([0.9, -0.7, 0.6])))
    boxes = [
        Obstacle(
            name=f"box {x}", shape=Shape.BOX, size=size, T_world_obstacle=at(x, 0, 0.5) @ turned
        )
        for x, size in ((0.3, (0.02, 0.3, 0.08)), (0.7, (0.02, 0.4, 0.1)), (1.5, (0.1, 0.2, 0.1)))
    ]
    core = ClosestApproach(PANDA, boxes, own=own)
    with using("numpy"):
        plain = ClosestApproach(PANDA, boxes, own=own)
        far = ClosestApproach(PANDA, boxes[2:])
    between = core.distances.between

    def counted(pair: int, seen: float = np.inf) -> float:
        crossings.append(pair)
        return between(pair, seen)

    monkeypatch.setattr(core.distances, "between", counted)
    for rows in (q, q[::50], q[:1]):
        assert core.along(rows) == plain.along(rows)
        assert core.along(rows, resolution=0.0) == plain.along(rows, resolution=0.0)
    for row in q[::10]:
        for seen in (np.inf, 0.1, 0.01):
            found = core.distances.at(row, seen)
            np.testing.assert_array_equal(found, plain.distances.at(row, seen))
            np.testing.assert_array_equal(found, np.minimum(core.distances.at(row), seen))
    assert len(crossings) > 10
    assert ClosestApproach(PANDA, boxes[2:]).along(q) == far.along(q)


def test_a_moment_too_close_is_not_overlooked() -> None:
    """One row of thousands."""
    wall = Obstacle(name="wall", shape=Shape.BOX, size=(0.01, 2, 2), T_world_obstacle=at(0.9, 0, 1))
    closest = ClosestApproach(PANDA, (wall,))
    q = np.tile(np.append(PANDA.home, [0.04, 0.04]), (4000, 1))
    rest = closest.along(q)
    assert rest.row == 0
    q[2345, 1] += 0.4
    found = closest.along(q)
    assert found.row == 2345
    assert found.distance < rest.distance - 0.1


def test_the_distance_of_a_probe_is_known_by_hand(tmp_path: Path) -> None:
    robot = replace(gantry(tmp_path, 'type="sphere" size="0.1"'), gripper=None)
    wall = Obstacle(name="wall", shape=Shape.BOX, size=(0.5, 3, 3), T_world_obstacle=at(1.5, 0, 0))
    ball = Obstacle(name="ball", shape=Shape.SPHERE, size=(0.2,), T_world_obstacle=at(0, 0, 1.5))
    closest = ClosestApproach(robot, (wall, ball))
    q = np.zeros((1001, 4))
    q[:, 0] = np.linspace(-1.0, 0.6, 1001)
    found = closest.along(q)
    assert found.distance == pytest.approx(0.3, abs=RESOLUTION)
    assert (found.body, found.obstacle, found.row) == ("probe", "wall", 1000)
    q[500, :3] = 0.0, 0.0, 1.3
    found = closest.along(q)
    assert (found.obstacle, found.row) == ("ball", 500)
    assert found.distance == pytest.approx(-0.1, abs=1e-6)


@pytest.mark.parametrize(("dip", "seen"), [(5e-3, True), (0.5e-3, True), (0.05e-3, False)])
def test_what_may_be_hidden_is_as_little_as_said(tmp_path: Path, dip: float, seen: bool) -> None:
    robot = replace(gantry(tmp_path, 'type="sphere" size="0.1"'), gripper=None)
    wall = Obstacle(name="wall", shape=Shape.BOX, size=(0.5, 3, 3), T_world_obstacle=at(1.5, 0, 0))
    q = np.zeros((4000, 4))
    q[2345, 0] = dip
    closest = ClosestApproach(robot, (wall,))
    found = closest.along(q)
    assert found.distance == pytest.approx(0.9 - dip, abs=1e-9 if seen else RESOLUTION)
    assert (found.row == 2345) == seen
    exact = closest.along(q, resolution=0.0)
    assert exact.distance == pytest.approx(0.9 - dip, abs=1e-9)
    assert exact.row == 2345


def test_open_fingers_reach_further_than_closed_ones() -> None:
    T_world_tcp = Arm(PANDA).pose(PANDA.home)
    beside = T_world_tcp.translation() + T_world_tcp.rotation().as_matrix()[:, 1] * 0.08
    post = Obstacle(name="post", shape=Shape.SPHERE, size=(0.01,), T_world_obstacle=at(*beside))
    closest = ClosestApproach(PANDA, (post,))
    shut, opened = (
        closest.along(np.append(PANDA.home, [wide, wide])[None, :]) for wide in (0.0, 0.04)
    )
    # The hand is closer than closed fingers, which are 4 cm further away than open ones.
    assert (shut.body, "finger" in opened.body) == ("hand", True)
    assert opened.distance < shut.distance - 0.01


def test_a_robot_without_geoms_that_touch_is_refused() -> None:
    robot = robot_named("slider6")
    with pytest.raises(ModelError, match=r"can touch anything.*Give its links collision geoms"):
        ClosestApproach(robot, cell()[:1])
