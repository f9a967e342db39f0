"""What tells a hole from what else a peg feels: it sinks, and walls stop it."""

import numpy as np
import pytest

from robo47_qp.run.contact_steps import Press
from robo47_qp.tasks.handling.wrist import FreeWrist
from robo47_qp.tasks.peg_insert.hole_sense import HoleSense
from robo47_qp.tasks.peg_insert.sinking import Sinking
from tests.tasks.peg_insert.felt import Tool, feeling


def test_a_peg_that_creeps_between_the_fingers_has_not_sunk_into_a_hole() -> None:
    tool = Tool()
    sinking = Sinking(tool, np.array([0.0, 0.0, 1.0]))
    for _ in range(6000):
        tool.at = tool.at - np.array([0.0, 0.0, 5e-7])
        sinking.read()
    assert sinking.sunk == pytest.approx(5e-5, rel=0.02)
    before = tool.at
    for _ in range(30):
        tool.at = tool.at + np.array([4e-5, 0.0, -3e-5])
        sinking.read()
    assert sinking.sunk == pytest.approx(0.95e-3, abs=0.05e-3)
    # The hole has held its end since it was 0.3 mm deep.
    off = sinking.caught.translation() - before
    assert -0.3e-3 < off[2] < -0.2e-3
    assert off[0] < 0.4e-3


def hole_sense(tool: Tool, free: np.ndarray) -> HoleSense:
    """Return what is felt of a hole below, with a free wrist's reading (3,) [N]."""
    up = np.array([0.0, 0.0, 1.0])
    wrist = FreeWrist(force=free, time=0.0)
    return HoleSense(sensed=tool, axis=up, free=wrist, sinking=Sinking(tool, up))


@pytest.mark.parametrize(
    ("aside", "pressing", "found"),
    [(2.5, 0.0, False), (9.0, 8.0, False), (5.0, 4.0, False), (8.0, 4.0, True)],
)
def test_a_wall_of_the_hole_stops_a_peg_and_friction_does_not(
    aside: float, pressing: float, found: bool
) -> None:
    """In every direction; friction is at most 0.9 times what presses."""
    tool = Tool()
    free = np.array([1.0, 8.0, 2.0])
    for angle in np.linspace(0.0, 2.0 * np.pi, 7):
        condition = hole_sense(tool, free).found()
        push = [aside * np.cos(angle), aside * np.sin(angle), pressing]
        tool.felt = free + np.array(push)
        said = [condition.against() for _ in range(4)]
        assert None not in said[:-1]
        assert (said[-1] is None) == found


@pytest.mark.parametrize(
    ("aside", "pressing", "pace"),
    [(0.0, 0.4, 0.0), (8.0, 0.4, 0.0), (0.0, 0.6, 1.0), (1.9, 0.6, 1.0), (2.2, 0.6, 0.3)],
)
def test_the_search_waits_for_the_block_and_meets_walls_slowly(
    aside: float, pressing: float, pace: float
) -> None:
    """Friction is at most 0.9 times what presses; 1.5 N beyond that are of a wall."""
    tool = Tool()
    tool.felt = np.array([1.0 - aside, 8.0, 2.0 + pressing])
    assert hole_sense(tool, np.array([1.0, 8.0, 2.0])).pace() == pace


@pytest.mark.parametrize(("high", "pace"), [(4.0, 1.0), (9.5, 0.3)])
def test_a_peg_that_hops_over_the_block_goes_on_slowly_for_some_time(
    high: float, pace: float
) -> None:
    """Every hop ends with a knock, the harder the faster the peg is; little ones do no harm."""
    tool = Tool()
    sense = hole_sense(tool, np.zeros(3))
    paces = []
    for k in range(60):
        tool.felt = np.array([0.0, 0.0, high if k % 4 == 0 and k < 20 else 1.0])
        paces.append(sense.pace())
    # The last hop is at 16; it is remembered for 15 readings.
    assert paces[1:31] == 30 * [pace]
    assert paces[31:] == 29 * [1.0]


@pytest.mark.parametrize(("aside", "insists"), [(1.9, True), (2.2, False)])
def test_the_search_does_not_insist_against_a_wall(aside: float, insists: bool) -> None:
    tool = Tool()
    hand, search = feeling(tool), None
    for step in hand.insert(np.zeros(2), 1.2e-3, 0.4e-3):
        if isinstance(step, Press) and step.insists is not None:
            search = step
            break
    assert search is not None
    assert search.name == "search"
    tool.felt = np.array([0.0, aside, 0.6])
    assert search.insists is not None
    assert search.insists() == insists
