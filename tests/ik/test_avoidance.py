"""DistanceRows against differences of distances, and against what a step along them does."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linprog

from robo47_qp.arrays import Vector
from robo47_qp.collision.clearance import Clearance
from robo47_qp.errors import InvalidValueError
from robo47_qp.ik.avoidance import Avoidance, DistanceRows
from robo47_qp.model.arm import Arm
from robo47_qp.model.obstacle import Obstacle, Shape
from robo47_qp.model.robots.panda import PANDA
from tests.small_robots import at, cell, gantry, vector

D_MIN = 0.01
SPHERE = 'type="sphere" size="0.1"'


@pytest.fixture(scope="module")
def crowded() -> Clearance:
    return Clearance(Arm(PANDA, obstacles=cell()), D_MIN)


def near_something(clearance: Clearance, count: int, low: float, high: float) -> list[Vector]:
    """Configurations whose smallest distance lies between two bounds."""
    rng, arm = np.random.default_rng(4), clearance.arm
    found: list[Vector] = []
    while len(found) < count:
        q = rng.uniform(arm.q_min, arm.q_max)
        if low < clearance.nearest(q)[0] < high:
            found.append(q)
    return found


def closing(clearance: Clearance, pair: int, q: Vector) -> tuple[Vector, bool]:
    """Minus the slope of a distance by central differences, and whether it is smooth there."""
    slopes = []
    for h in (1e-5, 1e-6):
        steps = h * np.eye(len(q))
        of = clearance.distance_of
        change = [of(pair, q + step) - of(pair, q - step) for step in steps]
        slopes.append(-np.array(change) / (2 * h))
    return slopes[1], bool(np.abs(slopes[0] - slopes[1]).max() < 1e-5)


@pytest.mark.parametrize(("low", "high"), [(0.0, 0.05), (-0.08, 0.0)])
def test_rows_are_the_slopes_of_the_distances(crowded: Clearance, low: float, high: float) -> None:
    avoidance = Avoidance(crowded, d_min=D_MIN, detection=0.06)
    smooth = 0
    for q in near_something(crowded, 25, low, high):
        rows = avoidance.rows(q)
        for A, distance, pair in zip(rows.A, rows.distance, rows.pair.tolist(), strict=True):
            slope, is_smooth = closing(crowded, pair, q)
            if is_smooth:
                # Depths of cylinders are iterated to 1e-6 m or so, and so are their directions.
                assert pytest.approx(slope, abs=1e-5 if distance > 0.0 else 5e-3) == A
                smooth += 1
    assert smooth > 100


def test_a_slide_and_a_hinge_by_hand(tmp_path: Path) -> None:
    wall = Obstacle(name="wall", shape=Shape.PLANE, T_world_obstacle=at(0, 0, 0))
    arm = Arm(gantry(tmp_path, 'type="sphere" size="0.1" pos="0.4 0 0"'), obstacles=[wall])
    avoidance = Avoidance(Clearance(arm, 0.05), d_min=0.05, detection=0.5)
    rows = avoidance.rows(vector(0.3, -0.2, 0.25, 0.0))
    # Down by 1 m is closer by 1 m; 1 rad about y takes the tip, 0.4 m out, down by 0.4 m.
    assert pytest.approx(np.array([[0.0, 0.0, -1.0, 0.4]]), abs=1e-9) == rows.A
    assert rows.distance == pytest.approx([0.15], abs=1e-9)
    assert rows.upper == pytest.approx([0.10], abs=1e-9)


@pytest.mark.parametrize("recovery", [0.0, 0.3, 1.0])
def test_inside_a_pair_has_to_part_by_a_share(tmp_path: Path, recovery: float) -> None:
    wall = Obstacle(name="wall", shape=Shape.PLANE)
    arm = Arm(gantry(tmp_path, SPHERE), obstacles=[wall])
    clearance = Clearance(arm, 0.05)
    avoidance = Avoidance(clearance, d_min=0.05, detection=0.5, recovery=recovery)
    rows = avoidance.rows(vector(0.0, 0.0, 0.12, 0.0))
    assert rows.upper == pytest.approx([-0.03 * recovery], abs=1e-9)
    for _ in range(60):
        rows = avoidance.rows(vector(0.0, 0.0, 0.1 + rows.distance[0], 0.0))
        risen = 0.1 + rows.distance[0] + max(0.0, -rows.upper[0])
        rows = avoidance.rows(vector(0.0, 0.0, risen, 0.0))
    kept = 0.02 if recovery == 0.0 else 0.05
    assert rows.distance == pytest.approx([kept], abs=1e-9)


def test_a_step_along_the_rows_keeps_the_distance_to_second_order(crowded: Clearance) -> None:
    """The step that the rows allow furthest towards a collision, cut shorter and shorter."""
    avoidance = Avoidance(crowded, d_min=D_MIN, detection=0.3, max_rows=500)
    for q in near_something(crowded, 12, D_MIN, 0.04):
        rows = avoidance.rows(q)
        for size in (1e-2, 1e-3):
            box = [(-size, size)] * len(q)
            dq = linprog(-rows.A[0], A_ub=rows.A, b_ub=rows.upper, bounds=box).x
            worst = crowded.nearest(q + dq)[0]
            assert worst > D_MIN - 5.0 * size**2 * len(q)
            # And it is not kept from coming close: the nearest pair closes as it may.
            room = rows.distance[0] - min(rows.upper[0], np.abs(rows.A[0]).sum() * size)
            assert worst < room + 5.0 * size**2 * len(q) + 1e-3


def test_the_nearest_pairs_get_the_rows(crowded: Clearance) -> None:
    q = near_something(crowded, 1, 0.0, 0.02)[0]
    every = Avoidance(crowded, d_min=D_MIN, detection=0.2, max_rows=500).rows(q)
    assert len(every.distance) > 8
    few = Avoidance(crowded, d_min=D_MIN, detection=0.2, max_rows=5).rows(q)
    assert few.pair.tolist() == every.pair[:5].tolist()
    assert few.A.tolist() == every.A[:5].tolist()
    assert every.distance.tolist() == sorted(every.distance.tolist())
    assert (every.distance < 0.2).all()


def test_nothing_near_gives_no_rows(tmp_path: Path) -> None:
    ball = Obstacle(name="ball", shape=Shape.SPHERE, size=(0.1,), T_world_obstacle=at(0, 0, 1.9))
    arm = Arm(gantry(tmp_path, SPHERE), obstacles=[ball])
    rows = Avoidance(Clearance(arm, 0.01), d_min=0.01, detection=0.1).rows(np.zeros(4))
    assert rows.A.shape == (0, 4)
    assert rows.upper.shape == rows.distance.shape == (0,)


def test_geoms_that_just_touch_still_have_a_direction(tmp_path: Path) -> None:
    wall = Obstacle(name="wall", shape=Shape.PLANE)
    arm = Arm(gantry(tmp_path, SPHERE), obstacles=[wall])
    rows = Avoidance(Clearance(arm, 0.02), d_min=0.02, detection=0.1).rows(vector(0, 0, 0.1, 0))
    assert abs(rows.distance[0]) < 1e-9
    assert pytest.approx(np.array([[0.0, 0.0, -1.0, 0.0]]), abs=1e-6) == rows.A
    assert rows.upper == pytest.approx([-0.01], abs=1e-9)


def test_the_unit_is_a_step_and_no_time_is_in_it(tmp_path: Path) -> None:
    """A body that heads for a wall at 2 m/s, 20 ms at a time, stops at the asked distance."""
    wall = Obstacle(name="wall", shape=Shape.PLANE)
    arm = Arm(gantry(tmp_path, SPHERE), obstacles=[wall])
    clearance = Clearance(arm, 0.03)
    avoidance = Avoidance(clearance, d_min=0.03, detection=0.1)
    dt, q = 0.02, vector(0.0, 0.0, 0.5, 0.0)
    for _ in range(40):
        rows: DistanceRows = avoidance.rows(q)
        v = -2.0
        for A, upper in zip(rows.A, rows.upper, strict=True):
            v = max(v, upper / (A[2] * dt))
        q = q + dt * vector(0.0, 0.0, v, 0.0)
        assert clearance.nearest(q)[0] > 0.03 - 1e-9
    assert clearance.nearest(q)[0] == pytest.approx(0.03, abs=1e-9)


def test_what_is_returned_is_the_callers_own(crowded: Clearance) -> None:
    first_q, second_q = near_something(crowded, 2, 0.0, 0.04)
    avoidance = Avoidance(crowded, d_min=D_MIN, detection=0.06)
    first = avoidance.rows(first_q)
    before = [part.copy() for part in first]
    avoidance.rows(second_q)
    assert all((a == b).all() for a, b in zip(first, before, strict=True))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"d_min": 0.2}, "d_min and detection must be 0 <= d_min < detection"),
        ({"d_min": -0.1}, "d_min and detection"),
        ({"detection": np.inf}, "finite"),
        ({"recovery": 1.5}, r"recovery must be at least 0 and at most 1; found 1.5"),
        ({"max_rows": 0}, "max_rows must be a whole number, 1 or more; found 0"),
    ],
)
def test_numbers_out_of_range_are_refused(
    crowded: Clearance, change: dict[str, float], message: str
) -> None:
    good = {"d_min": 0.01, "detection": 0.1}
    with pytest.raises(InvalidValueError, match=message):
        Avoidance(crowded, **(good | change))  # type: ignore[arg-type]
