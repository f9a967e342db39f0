"""A peg is picked by feel, from the table and out of the hole."""

from collections.abc import Generator
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.evaluation.perturbation import PRESETS
from robo47_qp.evaluation.task_episode import TaskEpisode
from robo47_qp.model.payload import Payload
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.waypoint import Waypoint
from robo47_qp.report.audit.tool import tool_paths
from robo47_qp.run.contact_steps import Press
from robo47_qp.run.failure import Cause, Failure, StepFailed
from robo47_qp.run.runner import Runner
from robo47_qp.run.scenario import Run
from robo47_qp.run.steps import Move, StepLike, Wait
from robo47_qp.tasks.handling.wrist import FreeWrist
from robo47_qp.tasks.heading import heading
from robo47_qp.tasks.peg_insert.peg_insert import PegInsert
from tests.tasks.peg_insert.felt import Tool, feeling, performed, rows_of


def begun(seed: int, time_limit: float) -> Run:
    """Return an episode where camera and wrist err, until its time limit [s]."""
    episode = TaskEpisode(
        robot=PANDA, task=PegInsert(), perturbation=PRESETS["moderate"], time_limit=time_limit
    )
    scenario = episode.scenario(seed)
    return Runner(scenario, episode.simulation(scenario, seed)).run()


@pytest.mark.parametrize(
    ("push", "rights"),
    [((0.3, 0.0, 0.1), 0), ((0.0, 0.9, 0.0), 3), ((-0.6, 0.3, 0.0), 3), ((0.1, 0.0, 2.3), 3)],
)
def test_a_peg_that_leans_or_is_pressed_is_let_stand_before_it_is_lifted(
    push: tuple[float, float, float], rights: int
) -> None:
    """The tool goes to where what pushes it goes, until that pushes no more."""
    tool, free, size = Tool(), np.array([1.0, 8.0, 2.0]), np.linalg.norm(push)
    pressed = []
    tool.felt = free + push
    # The wrist is read twenty times before each.
    for step in islice(feeling(tool)._weighed(FreeWrist(force=free, time=0.0)), 60 + rights):
        if isinstance(step, Press):
            pressed.append(step)
            np.testing.assert_allclose(step.axis, np.array(push) / size)
            assert step.felt() == pytest.approx(-size)
            assert 0.0 < step.force <= 0.05
    assert [step.name for step in pressed] == ["right"] * rights
    tool.felt = free
    assert [step.felt() for step in pressed] == pytest.approx([0.0] * rights)
    # It stands: nothing is left to do.
    steps = feeling(tool)._weighed(FreeWrist(force=free, time=0.0))
    assert not any(isinstance(step, Press) for step in islice(steps, 60))


@pytest.mark.parametrize("again", [False, True])
def test_a_peg_that_is_drawn_out_is_told_to_the_controller(again: bool) -> None:
    """Also one that is picked again: it stands in the hole, which may hold it with any force."""
    tool = Tool()
    hand = feeling(tool)
    steps = hand._weighed(FreeWrist(force=np.zeros(3), time=0.0)) if again else hand.draw_out()
    passed = [step for step in steps if not isinstance(step, Wait)]
    pull, leave = passed
    assert isinstance(pull, Press)
    np.testing.assert_array_equal(pull.axis, [0.0, 0.0, 1.0])
    assert 10.0 <= pull.force <= 15.0
    tool.felt = np.array([0.0, 0.0, -40.0])
    assert pull.felt() == pytest.approx(40.0 - 9.81 * hand.item.mass)
    assert isinstance(leave, Waypoint)
    assert isinstance(leave.carried, Payload)
    assert leave.carried.mass == hand.item.mass
    np.testing.assert_allclose(leave.carried.T_tcp_com.translation(), [0.0, 0.0, -0.03])


def test_a_peg_that_was_let_go_and_sticks_in_the_hole_is_not_lifted() -> None:
    steps = feeling(Tool())._weighed(FreeWrist(force=np.zeros(3), time=0.0))
    assert isinstance(next(step for step in steps if not isinstance(step, Wait)), Press)
    sticks = Failure(cause=Cause.TIMEOUT, evidence="it sticks", step="draw out")
    with pytest.raises(StepFailed, match="it sticks"):
        steps.throw(StepFailed(sticks))


def test_a_peg_on_the_table_is_weighed_and_then_lifted_from_rest() -> None:
    """A springy arm stops where friction lets it; from there, a line was left by 0.3 mm."""
    run = begun(8_900_033, 25.5)
    names = [phase.name for phase in run.phases]
    assert names[-5:-1] == ["weigh", "stop", "settle", "lift"]
    off = [f.extreme for f in tool_paths(run) if f.signal == "LIN measured (tool)"]
    assert 0.0 < max(off) < 0.2e-3


def test_a_peg_that_is_seen_beside_the_fingers_middle_is_centred_between_them() -> None:
    """It is seen 9 mm beside where it is; along the fingers, they would hold it by their edge."""
    run = begun(9_100_142, 21.0)
    names = [phase.name for phase in run.phases]
    assert names.index("close across") < names.index("turn") < names.index("close gripper")

    def off(name: str) -> np.ndarray:
        """Return where the peg is in the plane of the tool when a phase ends (2,) [m]."""
        tool, peg = (rows_of(run, name, signal)[-1] for signal in ("tool/pose", "objects/peg"))
        return SO3(tool[3:]).inverse().apply(peg[:3] - tool[:3])[:2]

    assert np.linalg.norm(off("descend")) > 7e-3
    assert np.abs(off("close gripper")).max() < 0.5e-3
    # They open no further than they need to, and turn by a quarter.
    assert rows_of(run, "turn", "gripper/fingers").max() < 0.025
    quarter = [
        heading(SE3(np.roll(rows_of(run, name, "tool/pose")[-1], 4)))
        for name in ("close across", "close gripper")
    ]
    assert abs(quarter[0] - quarter[1]) == pytest.approx(0.5 * np.pi, abs=0.02)


def approaches(steps: Generator[StepLike, None, None], tries: int) -> list[float]:
    """Return the headings of the tool [rad] with which it is tried; none is in its reach."""
    failure = Failure(cause=Cause.IK, evidence="it is too far", step="approach")
    step, turns = next(steps), list[float]()
    for k in range(tries):
        assert isinstance(step, Move)
        (approach,) = step.waypoints
        assert approach.name == "approach"
        assert isinstance(approach.target, SE3)
        turns.append(heading(approach.target))
        if k < tries - 1:
            step = steps.throw(StepFailed(failure))
    with pytest.raises(StepFailed, match="it is too far"):
        steps.throw(StepFailed(failure))
    return turns


def test_fingers_turn_the_way_that_the_wrist_can_or_not_at_all() -> None:
    hand = replace(feeling(Tool(pose_bias=2e-3)), resting=0.03)
    turns = approaches(hand._come_around(SE3.identity()), 3)
    np.testing.assert_allclose(turns, [0.5 * np.pi, -0.5 * np.pi, 0.0], atol=1e-9)


@pytest.mark.parametrize(("bias", "resting"), [(0.0, 0.03), (2e-3, None)])
def test_a_peg_that_is_seen_right_or_that_the_hole_holds_is_not_centred(
    bias: float, resting: float | None
) -> None:
    hand = replace(feeling(Tool(pose_bias=bias)), resting=resting)
    assert approaches(hand._come_around(SE3.identity()), 1) == [0.0]


@pytest.mark.parametrize("bias", [0.0, 2e-3])
def test_a_peg_that_has_tipped_over_is_not_grasped(bias: float) -> None:
    """The errors of a camera tilt what it sees by a few degrees, a peg on the table lies by 90."""
    hand = replace(feeling(Tool(pose_bias=bias)), resting=0.03)
    leans, lies = (SE3.from_rotation(SO3.from_x_radians(angle)) for angle in (0.1, 1.55))
    assert isinstance(next(hand._come_around(leans)), Move)
    with pytest.raises(StepFailed, match="the peg lies: 89° from upright"):
        next(performed(hand._come_around(lies)))
    given_up = next(hand._come_around(lies))
    assert isinstance(given_up, Wait)
    assert given_up.until is not None
    assert (given_up.until.cause, given_up.seconds) == (Cause.GRASP, 0.0)


def test_a_jammed_peg_is_eased_along_all_that_pushes_it() -> None:
    """One that is eased aside alone leaps along the hole, where the arm still pulls at it."""
    tool, free = Tool(), FreeWrist(force=np.array([0.5, 0.0, 1.0]), time=0.0)
    push = np.array([9.0, 0.0, -12.0])
    tool.felt = free.force + push
    stiff = Press(axis=np.array([0.0, 0.0, -1.0]), force=4.0, felt=lambda: 0.0, seconds=1.0)
    steps = [step for step in feeling(tool)._ease(stiff, free) if isinstance(step, Press)]
    aside, ease = steps
    # Friction goes with what presses: as long as the arm pulls, that is not less than it was.
    assert [step.name for step in steps] == ["ease aside", "ease"]
    np.testing.assert_allclose(aside.axis, push / 15.0)
    assert aside.felt() == pytest.approx(-15.0)
    # It goes with the push, and by no more than that takes.
    assert aside.force > aside.felt()
    tool.felt = free.force.copy()
    assert aside.felt() == pytest.approx(0.0)
    assert aside.force <= 0.2
    np.testing.assert_array_equal(ease.axis, stiff.axis)
    assert ease.force <= 0.5
