"""ItemHandler: what is tried again, and what is not."""

from collections.abc import Generator

import numpy as np
import pytest
from mink import SE3

from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.waypoint import Waypoint, tool_down
from robo47_qp.run.contact_steps import Guarded
from robo47_qp.run.failure import Cause, Failure, StepFailed
from robo47_qp.run.runner import Runner
from robo47_qp.run.steps import Grasp, Look, Move, Release, StepLike, as_step
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from robo47_qp.tasks.handling.item_handler import ItemHandler
from robo47_qp.tasks.heading import upright
from robo47_qp.tasks.item import Item
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from tests.runs import live


def test_a_line_down_that_cannot_be_planned_is_tried_once_from_another_branch() -> None:
    program = _place()
    assert [_name(next(program)), _name(next(program))] == ["carry", "lower"]
    assert _name(program.throw(_failed(Cause.PLAN))) == "carry"
    assert _name(next(program)) == "lower"
    with pytest.raises(StepFailed, match="as a test"):
        program.throw(_failed(Cause.PLAN))


def test_where_the_camera_errs_so_is_the_line_down_beside_the_goal() -> None:
    """It begins near the goal, from where the item is seen beside it."""
    erring, rng = Disturbance(pose_bias=1e-3), np.random.default_rng(0)
    world = DisturbedSimulation(PANDA, PickPlace().build_scene, erring, rng)
    program, names = _place(world), []
    step = next(program)
    while not isinstance(step := as_step(step), Release):
        if isinstance(step, Move):
            names.append(step.waypoints[0].name)
        if names[-1:] == ["lower"] and names.count("lower") in (1, 3) and isinstance(step, Move):
            step = program.throw(_failed(Cause.PLAN))
        else:
            step = next(program)
    assert names == ["carry", *2 * ["lower", "carry", "lower"]]


@pytest.mark.parametrize("cause", [Cause.DROP, Cause.TRACK])
def test_a_line_down_that_has_begun_is_not_tried_again(cause: Cause) -> None:
    program = _place()
    next(program)
    next(program)
    with pytest.raises(StepFailed, match="as a test"):
        program.throw(_failed(cause))


@pytest.mark.parametrize("noise", [-0.02, 0.02])
def test_what_was_turned_to_its_goal_is_not_turned_to_another_side_of_it(noise: float) -> None:
    """The camera's errors turn with what it sees: near a tie it may be off by a little."""
    world = Simulation(PANDA, PickPlace().build_scene)
    hand = ItemHandler(sensed=live(world), item=PickPlace().item, above=0.2)
    tool = tool_down([0.45, 0.1, 0.1], np.pi / 4)
    goal = upright([0.4, -0.2, 0.02], 0.3)
    held = upright([0.45, 0.1, 0.1], 0.3 + noise)
    again = hand.release_pose(tool, held, goal, turned=True)
    assert (tool.inverse() @ again).rotation().log()[2] == pytest.approx(noise, abs=1e-9)
    placed = again @ tool.inverse() @ held
    np.testing.assert_allclose(placed.as_matrix(), goal.as_matrix(), atol=1e-9)
    first = [
        hand.release_pose(tool, upright([0.45, 0.1, 0.1], 0.3 + off), goal) for off in (-0.02, 0.02)
    ]
    apart = np.abs((first[0].inverse() @ first[1]).rotation().log()[2])
    assert apart > 1.5


def test_what_stops_the_fingers_on_their_way_down_must_do_so_twice() -> None:
    """A push is gone by then."""
    erring, rng = Disturbance(pose_bias=1e-3), np.random.default_rng(0)
    world = DisturbedSimulation(PANDA, PickPlace().build_scene, erring, rng)
    hand = ItemHandler(sensed=live(world), item=PickPlace().item, above=0.2)
    for times in (1, 2):
        program = hand.pick(upright([0.4, -0.2, 0.02], 0.0))
        while not isinstance(first := next(program), Guarded):
            pass
        assert program.throw(_failed(Cause.GRASP)) is first
        if times == 1:
            assert not isinstance(as_step(next(program)), Move)
            continue
        # It is then grasped along its other sides.
        assert _name(program.throw(_failed(Cause.GRASP))) == "back off"


def _failed(cause: Cause) -> StepFailed:
    return StepFailed(Failure(cause=cause, evidence="as a test"))


def _name(step: StepLike) -> str:
    action = as_step(step)
    assert isinstance(action, Move)
    return action.waypoints[0].name


def _place(world: Simulation | None = None) -> Generator[StepLike, None, None]:
    world = world or Simulation(PANDA, PickPlace().build_scene)
    hand = ItemHandler(sensed=live(world), item=PickPlace().item, above=0.2)
    return hand.place(upright([0.4, -0.2, 0.02], 0.0))


def test_ways_down_are_foreseen_with_the_way_back_up() -> None:
    task = PickPlace()
    simulation = Simulation(PANDA, task.build_scene)
    task.reset(simulation, None)
    hand = ItemHandler(sensed=live(simulation), item=task.item, above=0.16)
    T_world_item = simulation.object_pose(task.item.name)
    T_world_goal = SE3.from_translation(np.array([0.1, -0.2, 0.0])) @ T_world_item
    steps = hand.foreseen(T_world_item, T_world_goal)
    led = {step.name: step for step in steps if isinstance(step, Waypoint)}
    led |= {w.name: w for step in steps if isinstance(step, Move) for w in step.waypoints}
    for above, down, up in (("approach", "descend", "lift"), ("carry", "lower", "retreat")):
        assert [waypoint.name for waypoint in led[above].onward] == [down, up]
        for foreseen, later in zip(led[above].onward, (led[down], led[up]), strict=True):
            assert isinstance(foreseen.target, SE3)
            assert isinstance(later.target, SE3)
            np.testing.assert_allclose(
                foreseen.target.as_matrix(), later.target.as_matrix(), atol=1e-12
            )


@pytest.mark.parametrize(("went", "shifted"), [(8e-3, 0.01), (-8e-3, -0.01), (1e-3, 0.0)])
def test_what_was_squeezed_out_is_grasped_on_the_side_to_which_it_went(
    went: float, shifted: float
) -> None:
    """The camera errs by the same again: the fingers had closed beside the item."""
    erring, rng = Disturbance(pose_bias=1e-6), np.random.default_rng(0)
    world = DisturbedSimulation(PANDA, PickPlace().build_scene, erring, rng)
    item = PickPlace().item
    hand = ItemHandler(sensed=live(world), item=item, above=0.2)
    program, approaches = hand.pick(), list[SE3]()
    step = as_step(next(program))
    while len(approaches) < 2:
        if isinstance(step, Move) and step.name == "approach":
            target = step.waypoints[0].target
            assert isinstance(target, SE3)
            approaches.append(target)
        if len(approaches) == 1 and step.name == "close gripper":
            assert isinstance(step, Grasp)
            assert [one.name for one in step.during] == [f"the fingers are around the {item.name}"]
            # Along the fingers, as they close.
            along = approaches[0].rotation().as_matrix()[:, 0]
            seen = world.object_pose(item.name)
            moved = SE3.from_translation(went * along) @ seen
            world.place_object(item.name, moved)
            step = as_step(program.throw(_failed(Cause.GRASP)))
        else:
            step = as_step(next(program))
    first, second = approaches
    off = first.rotation().as_matrix().T @ (second.translation() - first.translation())
    assert off[:2] == pytest.approx([went + shifted, 0.0], abs=2e-5)
    # The other sides.
    turn = (first.inverse() @ second).rotation().log()[2]
    assert abs(turn) == pytest.approx(np.pi / 2, abs=1e-6)


@pytest.mark.parametrize("factor", [0.92, 1.08])
def test_a_data_sheet_tells_how_far_sizes_may_be_off(factor: float) -> None:
    """Fingers come down around the largest item, and hold one that is as wide as it may be."""
    task = PickPlace(item=Item(name="box", size=(0.06, 0.06, 0.05)), retries=0)
    failures = []
    for told in (None, 0.0):
        wrong = Disturbance(object_size_factor=factor, size_tolerance=told)
        world = DisturbedSimulation(PANDA, task.build_scene, wrong)
        run = Runner(ClassicalStack().scenario(PANDA, task), world).run()
        failures.append(run.failure)
        if told is None:
            assert live(world).sheet.noise["size_tolerance"] == pytest.approx(0.08)
            assert np.linalg.norm(run.rows["contact/tool"], axis=1).max() < 30.0
    assert failures[0] is None
    assert failures[1] is not None


@pytest.mark.parametrize("known", [True, False])
def test_an_item_that_has_just_been_seen_is_not_looked_at_again(known: bool) -> None:
    """Its height is known better than it is seen, as otherwise."""
    erring, rng = Disturbance(pose_noise=2e-3), np.random.default_rng(0)
    world = DisturbedSimulation(PANDA, PickPlace().build_scene, erring, rng)
    item, resting = PickPlace().item, 0.5 * PickPlace().item.height
    hand = ItemHandler(sensed=live(world), item=item, above=0.2, resting=resting)
    seen = SE3.from_translation(np.array([0.03, -0.02, 0.01])) @ world.object_pose(item.name)
    step = as_step(next(hand.pick(seen if known else None)))
    assert isinstance(step, Look) != known
    if isinstance(step, Move):
        target = step.waypoints[0].target
        assert isinstance(target, SE3)
        np.testing.assert_allclose(target.translation()[:2], seen.translation()[:2], atol=1e-9)
        (descend, *_) = step.waypoints[0].onward
        assert isinstance(descend.target, SE3)
        grasp = hand.item.grasp(seen, 0.08).translation()[2] - seen.translation()[2]
        assert descend.target.translation()[2] == pytest.approx(resting + grasp, abs=1e-9)
