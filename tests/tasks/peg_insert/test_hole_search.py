"""A hole is searched for by feel, along lanes."""

import numpy as np
import pytest
from mink import SE3

from robo47_qp.motion.waypoint import Waypoint
from robo47_qp.run.contact_steps import Press
from robo47_qp.run.failure import StepFailed
from robo47_qp.run.steps import StepLike, Wait
from robo47_qp.tasks.peg_insert.peg import DEPTH
from tests.tasks.peg_insert.felt import Tool, feeling, lanes_of, meet_edge, performed


@pytest.mark.parametrize("sinks", [False, True])
def test_a_peg_that_a_wall_stops_beside_the_hole_is_searched_with_on_the_lanes_beyond(
    sinks: bool,
) -> None:
    tool, gap = Tool(), 0.4e-3
    hand = feeling(tool)
    searches, starts = list[np.ndarray](), list[np.ndarray]()
    for step in performed(hand.insert(np.zeros(2), 1.2e-3, gap)):
        if isinstance(step, Press) and step.name == "search":
            if len(searches) == 2:
                break
            ways = lanes_of(step)
            searches.append(ways)
            # On the way along the second lane, or further on, it is stopped.
            k = 1 if len(searches) == 1 else 3
            tool.at = 0.7 * ways[k] + 0.3 * ways[k + 1]
            starts.append(tool.at)
            assert step.until is not None
            tool.felt = np.array([0.0, -6.0, 3.0])
            assert step.pace is not None
            assert step.pace() < 1.0
            for _ in range(3):
                assert step.until.against() is not None
            assert step.until.against() is None
            # The arm stops, and nothing pushes it any more.
            tool.felt = np.zeros(3)
        if isinstance(step, Press) and step.name == "insert":
            tool.at = tool.at - [0.0, 0.0, DEPTH if sinks else 1e-5]
    assert len(searches) == (1 if sinks else 2)
    if not sinks:
        first, beyond = searches
        # Beside where it is, back to where it came from, and all that was left.
        across = first[2] - first[1]
        assert np.linalg.norm(across) == pytest.approx(2.0 * 1.2e-3)
        way = first[3] - first[2]
        assert np.linalg.norm(way) == pytest.approx(gap)
        assert beyond[0] == pytest.approx(starts[0] + way, abs=1e-9)
        assert beyond[1] == pytest.approx(first[4], abs=1e-9)
        assert beyond[2:] == pytest.approx(first[3:], abs=1e-9)


def test_where_an_edge_caught_the_peg_and_no_lane_led_in_the_hole_is_searched_for_more_finely() -> (
    None
):
    """Once, around there; a search that finds nothing then has failed."""
    tool, side, gap = Tool(), 1.0e-3, 0.4e-3
    searches, caught, needed = list[np.ndarray](), np.zeros(3), list[bool]()
    for step in performed(feeling(tool).insert(np.zeros(2), side, gap)):
        if isinstance(step, Waypoint) and isinstance(step.target, SE3):
            tool.at = step.target.translation()
        if not isinstance(step, Press) or step.name != "search":
            continue
        assert step.until is not None
        ways = lanes_of(step)
        searches.append(ways)
        if len(searches) == 1:
            # An edge catches it in the second lane, in which the hole is not.
            caught = tool.at = 0.5 * (ways[1] + ways[2])
            meet_edge(tool, step)
        else:
            tool.at = ways[-1]
            assert step.until.against() is not None
            needed.append(step.needed)
            if step.needed:
                break
    _, beyond, *parts = searches
    fine = np.concatenate(parts)
    assert beyond[-1] == pytest.approx(searches[0][-1], abs=1e-9)
    off = fine - caught
    off[:, 2] = 0.0
    assert np.abs(off).max() == pytest.approx(1.2e-3, rel=0.2)
    between = np.linalg.norm(off[1::2] - off[:-1:2], axis=1)
    np.testing.assert_allclose(between, 0.6 * gap)
    # With the first lanes, the search was not over; it is with these.
    assert needed == [False] * len(parts) + [True]


def test_a_peg_that_edges_catch_everywhere_and_no_lane_lets_in_is_not_pressed_on() -> None:
    tool, steps = Tool(), list[StepLike]()

    def insert() -> None:
        for step in performed(feeling(tool).insert(np.zeros(2), 1.0e-3, 0.4e-3)):
            steps.append(step)
            if isinstance(step, Waypoint) and isinstance(step.target, SE3):
                tool.at = step.target.translation()
            if isinstance(step, Press) and step.name == "search":
                tool.at = lanes_of(step)[-2:].mean(axis=0)
                meet_edge(tool, step)

    with pytest.raises(StepFailed, match="does not go in there"):
        insert()
    ways = [step.name for step in steps if isinstance(step, Waypoint)]
    assert ways.count("beside the edge") == 1
    # An arm that had pressed comes back before it goes on a line.
    lines = (step for step in steps if isinstance(step, Waypoint))
    k = steps.index(next(step for step in lines if step.name == "beside the edge"))
    *read, settle = steps[k - 21 : k]
    assert all(isinstance(step, Wait) and step.untouched for step in read)
    assert isinstance(settle, Wait)
    assert settle.name == "settle"
    pressed = [step for step in steps if isinstance(step, Press) and step.name == "insert"]
    assert {step.force for step in pressed} == {4.0}


@pytest.mark.parametrize("touch", [1, 2])
def test_a_peg_that_comes_down_into_the_hole_is_not_searched_with_there(touch: int) -> None:
    """At the first touch or after the first lanes, where nothing was found."""
    tool, names = Tool(), list[str]()
    for step in performed(feeling(tool).insert(np.zeros(2), 1.6e-3, 0.4e-3)):
        if isinstance(step, Press):
            names.append(step.name)
            sunk = DEPTH if names.count("touch") == touch else 0.0
            if step.name == "touch":
                tool.at = np.array([*tool.at[:2], -sunk])
            elif step.name == "search":
                tool.at = lanes_of(step)[-1]
    # It is at the bottom.
    assert names == ["touch", *(touch - 1) * ["search", "lift off", "touch"], "ease"]


def test_a_peg_that_creeps_up_between_the_fingers_has_not_come_down_into_the_hole() -> None:
    """By 1 mm from each touch to the next."""
    tool, names = Tool(), list[str]()
    for step in performed(feeling(tool).insert(np.zeros(2), 6.4e-3, 0.4e-3)):
        if not isinstance(step, Press):
            continue
        names.append(step.name)
        if names.count("search") == 4:
            break
        if step.name == "search":
            tool.at = lanes_of(step)[-1]
        elif step.name == "touch":
            tool.at = np.array([*tool.at[:2], -1e-3 * (names.count("touch") - 1)])
    assert names == ["touch", *3 * ["search", "lift off", "touch"], "search"]


@pytest.mark.parametrize("radius", [1.2e-3, 1.6e-3])
def test_a_peg_that_sinks_as_its_last_lane_ends_has_found_the_hole(radius: float) -> None:
    """The tool needs some time to come to rest, in which nobody asks whether it has sunk.

    Where these were the last lanes, the search would have failed; with 1.6 mm, some are left.
    """
    tool, names = Tool(), list[str]()
    for step in performed(feeling(tool).insert(np.zeros(2), radius, 0.4e-3)):
        names += [step.name] if isinstance(step, Press) else []
        if isinstance(step, Press) and step.name == "search":
            assert step.until is not None
            tool.at = lanes_of(step)[-1]
            assert step.until.against() is not None
            tool.at = tool.at - [0.0, 0.0, 1e-3]
        elif isinstance(step, Press) and step.name == "insert":
            tool.at = tool.at - [0.0, 0.0, DEPTH]
    assert names == ["touch", "search", "centre", "ease", "insert", "ease"]


def test_a_peg_that_an_edge_has_let_in_a_little_is_lifted_by_that_as_well() -> None:
    tool, sunk, heights = Tool(), 0.6e-3, list[float]()
    for step in performed(feeling(tool).insert(np.zeros(2), 1.2e-3, 0.4e-3)):
        if not isinstance(step, Press):
            continue
        if step.name == "search":
            tool.at = lanes_of(step)[1]
            meet_edge(tool, step)
        elif step.name == "insert":
            tool.at = tool.at - [0.0, 0.0, sunk]
        elif step.name == "lift off":
            (up,) = step.waypoints
            assert isinstance(up.target, SE3)
            heights.append(float(up.target.translation()[2]))
            break
    np.testing.assert_allclose(heights, 2e-3)


def test_in_a_long_search_the_wrist_is_read_anew_as_it_drifts() -> None:
    tool, gap, known = Tool(), 0.4e-3, list[bool]()
    searches, between = list[np.ndarray](), list[str]()
    for step in performed(feeling(tool).insert(np.zeros(2), 1.6e-3, gap)):
        name = step.name if isinstance(step, Press | Wait) else ""
        known += [step.untouched] if isinstance(step, Wait) else []
        if isinstance(step, Press) and name == "search":
            searches.append(lanes_of(step))
            assert step.until is not None
            # No lane is left before its end, also where it begins near the end of the last one.
            for way in (searches[-1][-1], *searches[-1]):
                tool.at = way
                assert step.until.against() is not None
            # With the first lanes, the search is not over; it is with these.
            assert step.needed == (len(searches) == 2)
            if step.needed:
                break
        elif searches and between[-1:] != [name]:
            between.append(name)
    assert between == ["lift off", "tare", "touch"]
    assert all(known)
    ways = np.concatenate(searches)
    assert len(ways) == 17
    x = np.round((ways[:, 0] - ways[0, 0]) / gap).astype(int)
    np.testing.assert_array_equal(x, np.repeat(np.arange(9), 2)[1:] - x[0])


def test_a_wrist_that_has_drifted_is_no_wall_after_a_press_in_vain() -> None:
    tool, passed, drift, known = Tool(), list[str](), np.zeros(3), dict[str, set[bool]]()
    for step in performed(feeling(tool).insert(np.zeros(2), 1.2e-3, 0.4e-3)):
        name = step.name if isinstance(step, Press | Wait) else ""
        if isinstance(step, Press) and name == "search":
            assert step.until is not None
            if "insert" in passed:
                assert [step.until.against() is None for _ in range(4)] == [False] * 4
                break
            tool.felt = np.array([0.0, -6.0, 3.0])
            assert [step.until.against() is None for _ in range(4)] == [False] * 3 + [True]
        elif name == "insert":
            # The peg does not sink, and since it touched the block the sensor has drifted.
            drift = np.array([0.0, 6.0, 0.0])
        tool.felt = drift
        if name and passed[-1:] != [name]:
            passed.append(name)
        if isinstance(step, Wait):
            known.setdefault(passed[-2:][0], set()).add(step.untouched)
    after = passed[passed.index("insert") + 1 :]
    assert after == ["tare", "ease aside", "ease", "lift off", "tare", "touch"]
    # Only a peg that is lifted off tells the zero of the wrist.
    assert known["insert"] == {False}
    assert known["lift off"] == {True}
