"""What pick_place begins with, foresees and refuses, before anything moves."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mink import SE3

from robo47_qp.errors import InvalidValueError
from robo47_qp.model.payload import Payload
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.waypoint import Motion, Place, Waypoint
from robo47_qp.run.steps import Move, as_step
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from tests.runs import live
from tests.tasks.pick_place.test_pick_place import cube, heading


def motions(task: PickPlace, simulation: Simulation) -> dict[str, Waypoint]:
    """The foreseen waypoints by name."""
    found = {}
    for step in task.preview(live(simulation)):
        action = as_step(step)
        for waypoint in action.waypoints if isinstance(action, Move) else ():
            found[waypoint.name] = waypoint
    return found


def test_random_starts_and_goals_lie_in_the_area_and_apart() -> None:
    task, world, places = PickPlace(), _world(), []
    for seed in range(200):
        task.reset(world, np.random.default_rng(seed))
        start, end = (
            world.object_pose("cube").translation(),
            world.marker_pose("goal").translation(),
        )
        assert np.linalg.norm((start - end)[:2]) > 0.15
        places += [start[:2], end[:2]]
    low, high = np.array([0.35, -0.35]), np.array([0.60, 0.35])
    assert (places >= low).all()
    assert (places <= high).all()
    # All of it is made use of.
    assert np.ptp(places, axis=0) == pytest.approx(high - low, rel=0.1)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_the_foreseen_waypoints_make_sense(seed: int) -> None:
    task = PickPlace()
    world = _world()
    task.reset(world, np.random.default_rng(seed))
    T_world_cube, T_world_goal = world.object_pose("cube"), world.marker_pose("goal")
    preview = motions(task, world)
    grasp, lower = pose(preview["descend"]), pose(preview["lower"])
    # The tool points down at the cube's centre, its fingers along a side.
    np.testing.assert_allclose(grasp.translation(), T_world_cube.translation(), atol=1e-9)
    for T in (grasp, lower):
        np.testing.assert_allclose(T.rotation().as_matrix()[:, 2], [0, 0, -1], atol=1e-9)
    sides = T_world_cube.rotation().as_matrix().T @ grasp.rotation().as_matrix()
    np.testing.assert_allclose(np.abs(sides).max(axis=0), 1.0, atol=1e-9)
    # Held as it is held at the grasp, the cube lies on the goal after "lower".
    placed = lower @ grasp.inverse() @ T_world_cube
    np.testing.assert_allclose(
        placed.translation(),
        T_world_goal.translation() + np.array([0.0, 0.0, task.item.height / 2]),
        atol=1e-9,
    )
    off = heading(placed.rotation().wxyz) - heading(T_world_goal.rotation().wxyz)
    assert abs((off + np.pi / 4) % (np.pi / 2) - np.pi / 4) < 1e-9
    # Over the table the tool comes and goes from straight above.
    for above, at in (("approach", grasp), ("lift", grasp), ("carry", lower), ("retreat", lower)):
        T = pose(preview[above])
        np.testing.assert_allclose(T.translation()[:2], at.translation()[:2], atol=1e-9)
        assert T.translation()[2] == pytest.approx(0.02 + 0.12)
    assert [n for n, w in preview.items() if w.motion is Motion.LIN] == [
        "descend",
        "lift",
        "lower",
        "retreat",
    ]
    assert preview["home"].target is Place.HOME
    for name, waypoint in preview.items():
        assert (waypoint.carried is not None) == (name in ("lift", "carry", "lower"))
        assert waypoint.grip is None
    # The wrist never turns further than an eighth of a turn from pointing ahead.
    for T in (grasp, lower):
        x, y, _ = T.rotation().as_matrix()[:, 0]
        assert abs(np.arctan2(y, x)) <= np.pi / 4 + 1e-9


@cache
def _world() -> Simulation:
    return Simulation(PANDA, PickPlace().build_scene)


def pose(waypoint: Waypoint) -> SE3:
    assert isinstance(waypoint.target, SE3)
    return waypoint.target


def test_the_payload_is_the_cube() -> None:
    task = PickPlace(item=cube(mass=0.3, edge=0.05))
    simulation = Simulation(PANDA, task.build_scene)
    lift = motions(task, simulation)["lift"]
    assert isinstance(lift.carried, Payload)
    body = simulation.model.body("cube")
    assert lift.carried.mass == pytest.approx(body.mass[0])
    np.testing.assert_allclose(lift.carried.inertia, body.inertia, rtol=1e-9)
    np.testing.assert_allclose(lift.carried.T_tcp_com.translation(), 0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pick": (np.nan, 0.0)}, r"pick must be two finite numbers.*nan"),
        ({"place": (0.0, np.inf)}, r"place must be two finite numbers.*inf"),
        ({"pick": (0.4,)}, r"pick must be two finite numbers"),
        ({"grip_force": np.nan}, r"grip_force must be above 0 and finite; found nan"),
        ({"clearance": 0.0}, r"clearance must be above 0 and finite"),
        ({"place_tolerance": 0.0}, r"place_tolerance must be above 0 and finite"),
    ],
)
def test_impossible_settings_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        replace(PickPlace(), **change)  # type: ignore[arg-type]
