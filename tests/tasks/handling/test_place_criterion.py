"""What is on its side, on an edge, turned or not yet at rest is not placed, whatever the task."""

from dataclasses import replace

import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.model.robots import load_robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.robots.panda_pair import panda_pair
from robo47_qp.run.failure import Failure
from robo47_qp.run.task import Task
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.carry_tray.carry_tray import CarryTray
from robo47_qp.tasks.conveyor_pick.conveyor_pick import ConveyorPick
from robo47_qp.tasks.handling.place_criterion import PlaceCriterion, miss, unfinished
from robo47_qp.tasks.handover.handover import Handover
from robo47_qp.tasks.heading import upright
from robo47_qp.tasks.item import Item
from robo47_qp.tasks.peg_insert.peg import DEPTH, LENGTH
from robo47_qp.tasks.peg_insert.peg_insert import PegInsert
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from robo47_qp.tasks.sort.sort import Sort
from robo47_qp.tasks.stack.stack import Stack
from robo47_qp.tasks.task_state import moved_last, task_state
from robo47_qp.tasks.wipe.board import MARKS, mark
from robo47_qp.tasks.wipe.wipe import Wipe
from tests.runs import Holder, at_rest

PAIR = panda_pair()


def rolled(degrees: float) -> SO3:
    return SO3.from_x_radians(np.radians(degrees))


def turned(degrees: float) -> SO3:
    return SO3.from_z_radians(np.radians(degrees))


def placed(task: Task) -> tuple[Simulation, str, SE3]:
    """A world that is as the task wants it at the end, an object that is judged, and its pose."""
    simulation = Simulation(PAIR if task.tools_needed == 2 else PANDA, task.build_scene)
    task.reset(simulation, None)
    match task:
        case PickPlace() | ConveyorPick():
            x, y = task.place if isinstance(task, PickPlace) else task.goal
            name, pose = task.item.name, upright([x, y, 0.5 * task.item.height], 0.0)
        case Handover():
            name, pose = "bar", upright([*task.end, 0.5 * task.bar.height], 0.0)
            task_state(simulation)[0] = 1.0
        case Stack():
            name = task.cubes[0].name
            poses = [upright([*task.goal, (i + 0.5) * task.edge], 0.0) for i in range(3)]
            for cube, at in zip(task.cubes, poses, strict=True):
                simulation.place_object(cube.name, at)
            pose = poses[0]
        case Sort():
            for i, item in enumerate(task.items):
                x, y = next(b for b in task.bins if b.rgba == item.rgba).slots[i // 2]
                simulation.place_object(item.name, upright([x, y, 0.5 * item.height], 0.0))
            name = task.items[0].name
            pose = simulation.object_pose(name)
        case Wipe():
            for i in range(MARKS):
                simulation.place_marker(mark(i), SE3.from_translation(np.array([0.0, 0.0, -1.0])))
            task_state(simulation)[:] = [10.0, 0.0, 0.0, 20.0]
            name, pose = "sponge", simulation.object_pose("sponge")
        case PegInsert():
            up = SE3.from_translation(np.array([0.0, 0.0, 0.5 * LENGTH - DEPTH]))
            name, pose = "peg", simulation.marker_pose("hole") @ up
        case CarryTray():
            name, pose = "tray", simulation.marker_pose("goal")
            task.tray.place(simulation, pose)
            task_state(simulation)[3] = 1.0
        case _:
            raise NotImplementedError(task)
    simulation.place_object(name, pose)
    at_rest(simulation)
    return simulation, name, pose


ALL: tuple[Task, ...] = (
    *(PickPlace(), ConveyorPick(), Handover(), Stack(), Sort(), Wipe(), PegInsert(), CarryTray()),
)
"""Every task that places something; the others judge the pose of the tool."""
IDS = [task.name for task in ALL]
CUBES = (PickPlace(), ConveyorPick())


def judged(task: Task, rotation: SO3, lift: float = 0.0) -> Failure | None:
    """The verdict on what is turned where it is, in its own frame."""
    simulation, name, pose = placed(task)
    up = SE3.from_translation(np.array([0.0, 0.0, lift]))
    simulation.place_object(name, up @ pose @ SE3.from_rotation(rotation))
    return task.verdict(simulation)


@pytest.mark.parametrize("task", ALL, ids=IDS)
def test_what_is_placed_is_success_once_it_has_been_at_rest_for_half_a_second(task: Task) -> None:
    simulation, name, _ = placed(task)
    assert task.verdict(simulation) is None
    twist = simulation.data.joint(simulation.model.body(name).jntadr[0]).qvel
    twist[3:] = [0.0, 0.0, 0.021]
    failure = task.verdict(simulation)
    assert failure is not None
    assert "turns at 0.021 rad/s (allowed are 1 mm/s, 0.02 rad/s)" in failure.evidence
    task.monitor(simulation)
    twist[:] = 0.0
    simulation.data.time += 0.49
    failure = task.verdict(simulation)
    assert failure is not None
    assert "been at rest for 0.5 s, but for 0.49 s" in failure.evidence
    task.monitor(simulation)
    simulation.data.time += 0.01
    assert task.verdict(simulation) is None


@pytest.mark.parametrize(("part", "size"), [(2, 1.1e-3), (3, 0.021)])
def test_what_moved_between_two_looks_was_not_at_rest(part: int, size: float) -> None:
    task = PickPlace()
    simulation, name, _ = placed(task)
    rows = {
        f"motion/{name} velocity": np.zeros((20, 6)),
        "time": 0.98 + 1e-3 * np.arange(20.0)[:, None],
    }
    simulation.data.time, simulation.lately = 1.0, rows.__getitem__
    task.monitor(simulation)
    assert task.verdict(simulation) is None
    rows[f"motion/{name} velocity"][4, part] = -size
    task.monitor(simulation)
    failure = task.verdict(simulation)
    assert failure is not None
    assert "been at rest for 0.5 s, but for 0.02 s" in failure.evidence
    # Earlier rows do not take back what was seen.
    moved_last(simulation)[0] = 0.995
    task.monitor(simulation)
    assert moved_last(simulation)[0] == 0.995


@pytest.mark.parametrize("task", CUBES, ids=lambda task: task.name)
@pytest.mark.parametrize(
    ("rotation", "lift", "told"),
    [
        (rolled(90.0), 0.0, "is tilted by 90.0° (allowed are 3°)"),
        (rolled(180.0), 0.0, "is tilted by 180.0°"),
        (rolled(45.0), 0.0083, "is tilted by 45.0°"),
        (turned(45.0), 0.0, "is turned by 45.0° from its heading (allowed are 5°)"),
        (turned(-5.1), 0.0, "is turned by 5.1°"),
        (turned(4.9), 0.0, None),
        (turned(85.1), 0.0, None),
        (rolled(3.1), 0.0, "is tilted by 3.1°"),
        (rolled(-2.9), 0.0, None),
    ],
)
def test_a_cube_on_its_side_on_an_edge_or_turned_is_not_placed(
    task: Task, rotation: SO3, lift: float, told: str | None
) -> None:
    failure = judged(task, rotation, lift)
    assert (failure is None) == (told is None)
    if failure is not None:
        assert told is not None
        assert told in failure.evidence


@pytest.mark.parametrize(
    ("task", "rotation", "told"),
    [
        (Stack(), turned(45.0), "red cube, number 1 from below, is turned by 45.0°"),
        (Stack(), turned(-94.9), None),
        (Stack(), turned(-95.1), "is turned by 5.1°"),
        (Stack(), rolled(3.1), "is tilted by 3.1°"),
        (Stack(), rolled(90.0), "is tilted by 90.0°"),
        (Stack(), rolled(180.0), "is tilted by 180.0°"),
        (Handover(), turned(175.1), None),
        (Handover(), turned(174.9), "is turned by 5.1°"),
        (Handover(), turned(90.0), "is turned by 90.0°"),
        (Wipe(), turned(5.1), "is turned by 5.1°"),
        (Wipe(), rolled(3.1), "is tilted by 3.1°"),
        (Sort(), rolled(3.1), "is tilted by 3.1°"),
        (Sort(), rolled(90.0), "is tilted by 90.0°"),
        # In its bin, either end is up.
        (Sort(), rolled(180.0), None),
        (Sort(), turned(45.0), None),
        (PegInsert(), turned(77.0), None),
        (PegInsert(), rolled(180.0), "is tilted by 3.142 rad"),
        (CarryTray(), turned(5.1), "is turned by 5.1°"),
        (CarryTray(), turned(4.9), None),
    ],
    ids=str,
)
def test_the_heading_is_judged_by_symmetry_and_the_tilt_by_what_has_a_top(
    task: Task, rotation: SO3, told: str | None
) -> None:
    if isinstance(task, CarryTray):
        simulation, _, pose = placed(task)
        task.tray.place(simulation, pose @ SE3.from_rotation(rotation))
        failure = task.verdict(simulation)
    else:
        failure = judged(task, rotation)
    assert (failure is None) == (told is None)
    if failure is not None:
        assert told is not None
        assert told in failure.evidence


def test_an_item_that_rests_on_the_rim_or_reaches_over_a_wall_is_not_sorted() -> None:
    task = Sort()
    simulation, name, pose = placed(task)
    item, home = task.items[0], task.bins[0]
    edge = home.centre[1] + 0.5 * home.size[1] - 0.5 * item.size[1]
    x, _, z = pose.translation()
    simulation.place_object(name, upright([x, edge, z], 0.0))
    assert task.verdict(simulation) is None
    simulation.place_object(name, upright([x, edge, z], np.radians(20.0)))
    failure = task.verdict(simulation)
    assert failure is not None
    assert "not all of it is in the red bin" in failure.evidence


@pytest.mark.parametrize("round_", [False, True])
def test_all_of_an_item_is_its_corners(round_: bool) -> None:
    """Against a cloud of points on the item's surface."""
    rng = np.random.default_rng(70_000)
    home = Sort.bins[0]
    item = Item(name="it", size=(0.04, 0.04 if round_ else 0.025, 0.05), round=round_)
    directions = rng.uniform(-1.0, 1.0, (20_000, 3))
    points = np.sign(directions) * 0.5 * np.array(item.size)
    if round_:
        angle = np.pi * directions[:, 0]
        points[:, :2] = 0.5 * item.size[0] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    agreed = []
    for _ in range(200):
        shift = rng.uniform([-0.11, -0.08, 0.0], [0.11, 0.08, 0.03])
        pose = SE3.from_rotation_and_translation(
            SO3.exp(rng.normal(size=3)), shift + np.array([*home.centre, 0.0])
        )
        cloud = np.abs((points @ pose.rotation().as_matrix().T + shift)[:, :2])
        beyond = float((cloud - 0.5 * np.array(home.size)).max())
        if abs(beyond - 1e-3) > 2e-4:
            agreed.append(home.holds_all(item, pose))
            assert agreed[-1] == (beyond <= 1e-3 and home.holds(pose.translation()))
    assert {True, False} == set(agreed)


def test_what_falls_and_rocks_comes_to_rest_later_than_it_stops_falling() -> None:
    """With physics: the time at rest is counted from when the last wobble is over."""
    task = PickPlace()
    simulation, name, pose = placed(task)
    simulation.place_object(name, SE3.from_translation(np.array([0.0, 0.0, 0.01])) @ pose)
    holder = Holder(simulation)
    started, since = simulation.time, []
    for _ in range(40):
        holder.hold(20)
        task.monitor(simulation)
        twist = simulation.object_twist(name)
        if np.linalg.norm(twist[:3]) > 1e-3 or np.linalg.norm(twist[3:]) > 0.02:
            since.append(simulation.time)
        failure = task.verdict(simulation)
        resting = since and simulation.time - since[-1] >= 0.5 - 1e-6
        assert (failure is None) == bool(resting)
    assert 0.04 < since[-1] - started < 0.3
    assert task.verdict(simulation) is None


def test_a_stricter_criterion_is_not_met() -> None:
    item = Item(name="bar", size=(0.03, 0.05, 0.04))
    goal = upright([0.4, 0.1, 0.02], 0.3)
    pose = upright([0.4, 0.103, 0.02], 0.3 + np.pi - 0.02)
    off = miss(item, pose, goal)
    assert off.distance == pytest.approx(3e-3)
    assert off.turn == pytest.approx(0.02)
    assert off.tilt == pytest.approx(0.0, abs=1e-9)
    assert not PlaceCriterion().against_pose(off)
    assert len(PlaceCriterion(distance=2e-3, turn=0.01).against_pose(off)) == 2
    assert miss(replace(item, size=(0.03, 0.03, 0.04), round=True), pose, goal).turn == 0.0


def test_how_far_a_slide_is_from_home_is_told_in_metres() -> None:
    world = Simulation(load_robot("panda_rail"), PickPlace().build_scene)
    world.data.joint("rail").qpos[0] = 0.05
    failure = unfinished(world)
    assert failure is not None
    assert "a joint is 0.050 m from home (allowed are 0.01 m)" in failure.evidence
