"""Handling: what is tried again, and what is not."""

from collections.abc import Generator

import pytest

from robo47_qp.failure import Cause, Failure, StepFailed
from robo47_qp.robots.panda import PANDA
from robo47_qp.simulation import Simulation
from robo47_qp.steps import Move, Step, as_action
from tasks.handling import Handling
from tasks.headings import upright
from tasks.pick_place import PickPlace


def test_a_line_down_that_cannot_be_planned_is_tried_once_from_another_branch() -> None:
    program = _place()
    assert [_name(next(program)), _name(next(program))] == ["carry", "lower"]
    assert _name(program.throw(_failed(Cause.PLAN))) == "carry"
    assert _name(next(program)) == "lower"
    with pytest.raises(StepFailed, match="as a test"):
        program.throw(_failed(Cause.PLAN))


@pytest.mark.parametrize("cause", [Cause.DROP, Cause.TRACK])
def test_a_line_down_that_has_begun_is_not_tried_again(cause: Cause) -> None:
    program = _place()
    next(program)
    next(program)
    with pytest.raises(StepFailed, match="as a test"):
        program.throw(_failed(cause))


def _failed(cause: Cause) -> StepFailed:
    return StepFailed(Failure(cause=cause, evidence="as a test"))


def _name(step: Step) -> str:
    action = as_action(step)
    assert isinstance(action, Move)
    return action.waypoints[0].name


def _place() -> Generator[Step, None, None]:
    world = Simulation(PANDA, PickPlace().build_scene)
    hand = Handling(simulation=world, item=PickPlace().item, above=0.2)
    return hand.place(upright([0.4, -0.2, 0.02], 0.0))
