"""A peg is inserted by feel, where camera and wrist err."""

from dataclasses import replace
from itertools import takewhile

import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.evaluation.perturbation import Perturbation
from robo47_qp.evaluation.task_episode import TaskEpisode
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.waypoint import Waypoint
from robo47_qp.run.contact_steps import Guarded, Press
from robo47_qp.run.failure import Cause, Failure, StepFailed
from robo47_qp.run.runner import Runner
from robo47_qp.run.steps import Release, StepLike, Wait
from robo47_qp.tasks.handling.held_item import HeldItem
from robo47_qp.tasks.handling.wrist import FreeWrist
from robo47_qp.tasks.peg_insert.feeling_inserter import FeelingInserter
from robo47_qp.tasks.peg_insert.peg import BELOW_TOP, DEPTH
from robo47_qp.tasks.peg_insert.peg_insert import PegInsert
from tests.tasks.peg_insert.felt import Tool, feeling, lanes_of, meet_edge, performed, rows_of


def test_where_camera_and_wrist_err_the_block_is_felt_and_the_peg_goes_in() -> None:
    """The hole is seen some millimetres beside where it is, and turned."""
    erring = Perturbation(
        pose_bias=2e-3, rotation_bias=0.0087, pose_noise=2e-3, noise_force=0.3, force_drift=1.0
    )
    episode = TaskEpisode(robot=PANDA, task=PegInsert(), perturbation=erring)
    scenario = episode.scenario(80092)
    # Another one of the same seed: looking draws noise.
    simulation = episode.simulation(scenario, 80092)
    off = simulation.seen_marker("hole seen").inverse() @ simulation.marker_pose("hole")
    assert np.linalg.norm(off.translation()) > 4e-3
    assert np.degrees(np.linalg.norm(off.rotation().log())) > 1.0
    run = Runner(scenario, episode.simulation(scenario, 80092)).run()
    assert run.failure is None
    names = [phase.name for phase in run.phases]
    assert {"draw out", "push"}.isdisjoint(names)
    # Three touches beside the hole, and one over it; it is lifted off where the wrist is read anew.
    assert names.count("touch") == names.count("lift off") + 1 >= 4
    level = rows_of(run, "insert", "objects/peg")[:, 3:]
    tilt = [SO3(wxyz).as_matrix()[2, 2] for wxyz in level]
    assert np.degrees(np.arccos(np.clip(min(tilt), -1.0, 1.0))) < 1.5
    assert np.linalg.norm(run.rows["contact/tool"], axis=1).max() < 30.0


@pytest.mark.parametrize("high", [-8e-3, 0.0, 11e-3])
def test_between_points_of_the_block_the_peg_moves_aside_where_it_was_felt(high: float) -> None:
    """The camera may err by as much as a peg that is let down stays above the block."""
    tool, aside = Tool(pose_bias=4e-3), list[float]()
    hand = feeling(tool)
    on_top = float(hand._tool_on_top(np.zeros(2)).translation()[2]) + high
    for step in hand._level(np.zeros(2)):
        if isinstance(step, Press) and step.name == "touch":
            tool.at = np.array([*tool.at[:2], on_top])
        elif isinstance(step, Guarded):
            assert isinstance(step.waypoint.target, SE3)
            tool.at = np.maximum(step.waypoint.target.translation(), [-1.0, -1.0, on_top])
        elif isinstance(step, Press):
            (up,) = step.waypoints
            assert isinstance(up.target, SE3)
            tool.at = up.target.translation()
        elif isinstance(step, tuple):
            (way,) = step
            assert isinstance(way.target, SE3)
            tool.at = way.target.translation()
            aside.append(float(tool.at[2]) - on_top)
    np.testing.assert_allclose(aside, 2 * [12e-3], atol=1e-6)


def test_fingers_let_go_of_a_peg_that_sticks_only_after_they_press_no_more() -> None:
    """Under load, the arm would spring back."""
    tool, pressed = Tool(), list[Press]()
    steps = performed(feeling(tool).insert(np.zeros(2), 1.2e-3, 0.4e-3))
    for step in steps:
        if isinstance(step, Release):
            break
        if not isinstance(step, Press):
            continue
        pressed.append(step)
        tool.felt = np.zeros(3)
        if step.name == "search":
            meet_edge(tool, step)
        elif step.name == "insert" and sum(one.name == "insert" for one in pressed) == 1:
            # It sinks once, deep enough to stand, and no further.
            tool.at = tool.at - [0.0, 0.0, 9e-3]
    else:
        pytest.fail("the fingers never let go")
    inserts = [one.force for one in pressed if one.name == "insert"]
    # What seems to be the hole is tried with less.
    assert inserts == [4.0] + 6 * [10.0]
    assert pressed[-1].force <= 0.1 * inserts[-1]
    # Before it goes over the peg, what the wrist reads is its zero: nothing is touched any more.
    # Then the arm comes back from where the peg had held it, before it goes on a line.
    *read, settle = takewhile(lambda step: not isinstance(step, Waypoint), steps)
    assert len(read) == 20
    assert all(isinstance(step, Wait) and step.untouched for step in read)
    assert isinstance(settle, Wait)
    assert settle.seconds >= 0.2
    assert not settle.untouched


@pytest.mark.parametrize("sinks", [False, True])
def test_a_peg_that_is_pushed_from_above_has_to_be_at_the_bottom(sinks: bool) -> None:
    """It sticks 9 mm deep, and closed fingers push it down or do not."""
    tool, pressed, pushed = Tool(), list[str](), list[str]()
    hand = feeling(tool)

    def insert() -> None:
        height = np.nan
        for step in performed(hand.insert(np.zeros(2), 1.2e-3, 0.4e-3)):
            if isinstance(step, Waypoint) and isinstance(step.target, SE3):
                tool.at = step.target.translation()
            elif isinstance(step, Press):
                pressed.append(step.name)
                tool.felt = np.zeros(3)
                if step.name == "search":
                    height = float(tool.at[2])
                    meet_edge(tool, step)
                elif step.name == "insert" and pressed.count("insert") == 1:
                    tool.at = tool.at - [0.0, 0.0, 9e-3]
                elif step.name == "touch" and "insert" in pressed:
                    pushed.append("touch")
                    # The fingers' ends are 9 mm below the tool, and the peg is 9 mm deep.
                    tool.at = np.array([0.0, 0.0, height + BELOW_TOP])
                elif step.name == "push" and sinks:
                    tool.at = tool.at - [0.0, 0.0, DEPTH - 9e-3]

    if sinks:
        insert()
    else:
        with pytest.raises(StepFailed, match=r"9\.0 mm deep, though it was pushed") as caught:
            insert()
        assert caught.value.failure.cause is Cause.DROP
    assert pushed == ["touch"]
    assert pressed[-2:] == ["push", "ease"]


def lined_up(
    hand: FeelingInserter, offset: np.ndarray, *, again: bool
) -> tuple[list[StepLike], FeelingInserter, np.ndarray]:
    """Return the steps of `FeelingInserter.lined_up`, and what it returns."""
    steps, passed = hand.lined_up(offset, again=again), list[StepLike]()
    while True:
        try:
            passed.append(next(steps))
        except StopIteration as end:
            return passed, *end.value


def test_a_hole_that_has_let_the_peg_in_is_searched_for_there_until_it_does_so_no_more() -> None:
    """Neither is its place seen again nor are its heights felt; only the peg is looked at."""
    tool, offset, sides = Tool(pose_bias=2e-3), np.zeros(2), list[float]()
    hand = feeling(tool)

    def attempt(sinks: float) -> str:
        """Return why a peg that sinks so far [m], and no further, is not in."""
        lanes = np.zeros((0, 3))
        try:
            for step in performed(hand.insert(offset, 3.2e-3, 0.4e-3)):
                if isinstance(step, Waypoint) and isinstance(step.target, SE3):
                    tool.at = step.target.translation()
                if isinstance(step, Press) and step.name == "search":
                    lanes = lanes if len(lanes) else lanes_of(step)
                    tool.at = lanes_of(step)[-2:].mean(axis=0)
                    meet_edge(tool, step)
                elif isinstance(step, Press) and step.name == "insert":
                    tool.at, sinks = tool.at - [0.0, 0.0, sinks], 0.0
        except StepFailed as error:
            sides.append(float(np.ptp(lanes[:, 1])))
            return error.failure.evidence
        pytest.fail("it is in")

    for again in (True, False):
        assert attempt(2e-3) == "the peg sticks 2.0 mm deep"
        caught, tool.at = tool.at, np.array([0.1, -0.2, 0.3])
        passed, hand, offset = lined_up(hand, offset, again=again)
        names = [way.name for step in passed if isinstance(step, tuple) for way in step]
        assert names == ([] if again else ["to the hole"])
        assert not any(isinstance(step, Press) for step in passed)
        above = hand.to_hole(offset)[0].target
        assert isinstance(above, SE3)
        np.testing.assert_allclose(above.translation()[:2], caught[:2])
    assert "does not go in there" in attempt(0.0)
    tool.at = np.array([0.1, -0.2, 0.3])
    _, hand, offset = lined_up(hand, offset, again=True)
    np.testing.assert_allclose(hand.T_world_hole.translation()[:2], tool.at[:2])
    assert "sticks" in attempt(2e-3)
    np.testing.assert_allclose(sides, [6.4e-3, 4e-3, 4e-3, 6.4e-3])


@pytest.mark.parametrize("taken", [0.5, 2.0])
def test_a_peg_that_fingers_hide_beside_the_hole_is_where_the_hand_has_it(taken: float) -> None:
    """The camera has seen it last before or after it was picked, at 1 s."""
    tool = Tool(pose_bias=2e-3)
    tool.at, tool.now, tool.taken = np.array([0.4, 0.1, 0.3]), 3.0, taken
    T_tcp_peg = SE3.from_translation(np.array([4e-3, 0.0, -0.03]))
    held = HeldItem(above=None, mass=0.1, T_tcp_item=T_tcp_peg, since=1.0)
    steps = replace(feeling(tool), in_hand=held).lined_up(np.zeros(2), again=True)
    offset = np.full(2, np.nan)
    while tool.now < 20.0:
        try:
            next(steps)
        except StopIteration as end:
            _, offset = end.value
            break
        tool.now += 0.1
    np.testing.assert_allclose(offset, [4e-3 if taken < 1.0 else 0.0, 0.0], atol=1e-9)


@pytest.mark.parametrize("cause", [Cause.TIMEOUT, Cause.DROP])
def test_a_peg_that_still_sinks_when_its_time_is_over_has_not_failed(cause: Cause) -> None:
    tool = Tool()
    touch = Press(
        name="touch",
        axis=np.array([0.0, 0.0, -1.0]),
        force=4.0,
        felt=lambda: 0.0,
        damping=1e3,
        seconds=1.0,
    )
    steps = feeling(tool)._press_in(touch, FreeWrist(force=np.zeros(3), time=0.0), 4.0)
    over = StepFailed(Failure(cause=cause, evidence="it is so", step="insert"))
    step = next(steps)
    while not (isinstance(step, Press) and step.name == "insert"):
        step = next(steps)
    with pytest.raises(StopIteration if cause is Cause.TIMEOUT else StepFailed):
        steps.throw(over)
