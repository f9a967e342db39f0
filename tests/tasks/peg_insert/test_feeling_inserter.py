"""A peg is inserted by feel, where camera and wrist err."""

from contextlib import suppress
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.evaluation.perturbation import PRESETS, Perturbation
from robo47_qp.evaluation.task_episode import TaskEpisode
from robo47_qp.model.payload import Payload
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.waypoint import Waypoint
from robo47_qp.report.audit.tool import tool_paths
from robo47_qp.run.contact_steps import Press
from robo47_qp.run.failure import Cause, Failure, StepFailed
from robo47_qp.run.runner import Runner
from robo47_qp.run.scenario import Run
from robo47_qp.run.steps import Move, Release, StepLike, Wait
from robo47_qp.sim.sensed import Sensed, Senses
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.handling.wrist import FreeWrist
from robo47_qp.tasks.heading import heading
from robo47_qp.tasks.peg_insert.feeling_inserter import FeelingInserter
from robo47_qp.tasks.peg_insert.hole_sense import HoleSense
from robo47_qp.tasks.peg_insert.peg import DEPTH
from robo47_qp.tasks.peg_insert.peg_insert import PegInsert
from robo47_qp.tasks.peg_insert.sinking import Sinking
from tests.runs import no_objects


def rows_of(run: Run, name: str, signal: str) -> np.ndarray:
    """Rows of a signal in the first phase of a name."""
    i = next(i for i, phase in enumerate(run.phases) if phase.name == name)
    return run.rows[signal][run.phases[i].start : run.phases[i + 1].start]


def test_where_camera_and_wrist_err_the_block_is_felt_and_the_peg_goes_in_at_once() -> None:
    """The hole is seen some millimetres beside where it is, and turned."""
    erring = Perturbation(
        pose_bias=2e-3, rotation_bias=0.0087, pose_noise=2e-3, noise_force=0.3, force_drift=1.0
    )
    episode = TaskEpisode(robot=PANDA, task=PegInsert(), perturbation=erring)
    scenario = episode.scenario(80089)
    # Another one of the same seed: looking draws noise.
    simulation = episode.simulation(scenario, 80089)
    off = simulation.seen_marker("hole seen").inverse() @ simulation.marker_pose("hole")
    assert np.linalg.norm(off.translation()) > 4e-3
    assert np.degrees(np.linalg.norm(off.rotation().log())) > 1.0
    run = Runner(scenario, episode.simulation(scenario, 80089)).run()
    assert run.failure is None
    names = [phase.name for phase in run.phases]
    assert names.count("insert") == 1
    assert "draw out" not in names
    # Three touches beside the hole, and one over it; it is lifted off where the wrist is read anew.
    assert names.count("touch") == names.count("lift off") + 1 >= 4
    level = rows_of(run, "insert", "objects/peg")[:, 3:]
    tilt = [SO3(wxyz).as_matrix()[2, 2] for wxyz in level]
    assert np.degrees(np.arccos(np.clip(min(tilt), -1.0, 1.0))) < 1.5
    assert np.linalg.norm(run.rows["contact/tool"], axis=1).max() < 30.0


class Tool(Sensed):
    """A tool at a height, and what its wrist feels."""

    def __init__(self) -> None:
        self.at, self.felt = np.zeros(3), np.zeros(3)

    @property
    def time(self) -> float:
        return 0.0

    def tool_pose(self, tool: int = 0) -> SE3:
        return SE3.from_translation(self.at)

    def felt_force(self, tool: int = 0) -> np.ndarray:
        return self.felt

    def seen_pose(self, name: str) -> SE3:
        return SE3.from_translation(self.at - np.array([0.0, 0.0, 0.03]))


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


def feeling(tool: Tool) -> FeelingInserter:
    """Return who inserts a peg into a hole in the origin."""
    return FeelingInserter(
        sensed=tool,
        item=PegInsert().peg,
        above=0.2,
        search_force=2.0,
        insert_force=5.0,
        T_world_hole=SE3.identity(),
    )


def hole_sense(tool: Tool, free: np.ndarray) -> HoleSense:
    """Return what is felt of a hole below, with a free wrist's reading (3,) [N]."""
    up = np.array([0.0, 0.0, 1.0])
    wrist = FreeWrist(force=free, time=0.0)
    return HoleSense(sensed=tool, axis=up, free=wrist, sinking=Sinking(tool, up))


def lanes_of(step: Press) -> np.ndarray:
    """Return the ends of the lanes of a search (n, 3)."""
    targets = [waypoint.target for waypoint in step.waypoints]
    return np.array([one.translation() for one in targets if isinstance(one, SE3)])


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


@pytest.mark.parametrize("sinks", [False, True])
def test_a_peg_that_a_wall_stops_beside_the_hole_is_searched_with_on_the_lanes_beyond(
    sinks: bool,
) -> None:
    tool, gap = Tool(), 0.4e-3
    hand = feeling(tool)
    searches, starts = list[np.ndarray](), list[np.ndarray]()
    for step in hand.insert(np.zeros(2), 1.2e-3, gap):
        if isinstance(step, Press) and step.name == "search":
            if len(searches) == 2:
                break
            ways = lanes_of(step)
            searches.append(ways)
            # On the way along the second lane, or further on, it is stopped.
            k = 1 if len(searches) == 1 else 3
            tool.at = 0.7 * ways[k] + 0.3 * ways[k + 1]
            starts.append(tool.at)
            assert step.observe is not None
            step.observe()
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
    searches, caught, told = list[np.ndarray](), np.zeros(3), list[str | None]()
    for step in feeling(tool).insert(np.zeros(2), side, gap):
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
            assert step.observe is not None
            step.observe()
            tool.felt = np.array([0.0, -6.0, 3.0])
            for _ in range(4):
                step.until.against()
            tool.felt = np.zeros(3)
        else:
            tool.at = ways[-1]
            told.append(step.until.against())
            if told[-1] is not None:
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
    assert told == [None] * len(parts) + told[-1:]


def test_a_peg_that_edges_catch_everywhere_and_no_lane_lets_in_is_not_pressed_on() -> None:
    tool, steps = Tool(), list[StepLike]()

    def insert() -> None:
        for step in feeling(tool).insert(np.zeros(2), 1.0e-3, 0.4e-3):
            steps.append(step)
            if isinstance(step, Waypoint) and isinstance(step.target, SE3):
                tool.at = step.target.translation()
            if isinstance(step, Press) and step.name == "search":
                tool.at = lanes_of(step)[-2:].mean(axis=0)
                assert step.observe is not None
                assert step.until is not None
                step.observe()
                tool.felt = np.array([0.0, -6.0, 3.0])
                for _ in range(4):
                    step.until.against()
                tool.felt = np.zeros(3)

    with pytest.raises(StepFailed, match="does not go in there"):
        insert()
    ways = [step.name for step in steps if isinstance(step, Waypoint)]
    assert ways.count("beside the edge") == 1
    pressed = [step for step in steps if isinstance(step, Press) and step.name == "insert"]
    assert {step.force for step in pressed} == {4.0}


def test_fingers_let_go_of_a_peg_that_sticks_only_after_they_press_no_more() -> None:
    """Under load, the arm would spring back."""
    tool, pressed = Tool(), list[Press]()
    for step in feeling(tool).insert(np.zeros(2), 1.2e-3, 0.4e-3):
        if isinstance(step, Release):
            break
        if isinstance(step, Press):
            pressed.append(step)
            tool.felt = np.zeros(3)
        if isinstance(step, Press) and step.name == "search":
            assert step.observe is not None
            step.observe()
            assert step.until is not None
            tool.felt = np.array([0.0, -6.0, 3.0])
            for _ in range(4):
                step.until.against()
        if [one.name for one in pressed].count("insert") == 1 and pressed[-1].name == "insert":
            # It sinks once, deep enough to stand, and no further.
            tool.at = tool.at - [0.0, 0.0, 9e-3]
    else:
        pytest.fail("the fingers never let go")
    inserts = [one.force for one in pressed if one.name == "insert"]
    # What seems to be the hole is tried with less.
    assert inserts == [4.0] + 6 * [10.0]
    assert pressed[-1].force <= 0.1 * inserts[-1]


def test_in_a_long_search_the_wrist_is_read_anew_as_it_drifts() -> None:
    tool, gap, known = Tool(), 0.4e-3, list[bool]()
    searches, between = list[np.ndarray](), list[str]()
    for step in feeling(tool).insert(np.zeros(2), 1.6e-3, gap):
        name = step.name if isinstance(step, Press | Wait) else ""
        known += [step.untouched] if isinstance(step, Wait) else []
        if isinstance(step, Press) and name == "search":
            searches.append(lanes_of(step))
            assert step.until is not None
            assert step.until.against() is not None
            # Friction holds it a little before the end.
            tool.at = searches[-1][-1] + [0.0, 0.3e-3, 0.0]
            if len(searches) == 2:
                # After the last lane, nothing was found.
                assert step.until.against() is not None
                break
            assert step.until.against() is None
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
    for step in feeling(tool).insert(np.zeros(2), 1.2e-3, 0.4e-3):
        name = step.name if isinstance(step, Press | Wait) else ""
        if isinstance(step, Press) and name == "search":
            assert step.observe is not None
            assert step.until is not None
            step.observe()
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
    assert after == ["ease", "tare", "ease aside", "lift off", "tare", "touch"]
    # Only a peg that is lifted off tells the zero of the wrist.
    assert known["ease"] == {False}
    assert known["lift off"] == {True}


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
    episode = TaskEpisode(
        robot=PANDA, task=PegInsert(), perturbation=PRESETS["moderate"], time_limit=25.5
    )
    scenario = episode.scenario(8_900_033)
    run = Runner(scenario, episode.simulation(scenario, 8_900_033)).run()
    names = [phase.name for phase in run.phases]
    assert names[-5:-1] == ["weigh", "stop", "settle", "lift"]
    off = [f.extreme for f in tool_paths(run) if f.signal == "LIN measured (tool)"]
    assert 0.0 < max(off) < 0.2e-3


def test_a_peg_that_is_seen_beside_the_fingers_middle_is_centred_between_them() -> None:
    """It is seen 9 mm beside where it is; along the fingers, they would hold it by their edge."""
    episode = TaskEpisode(
        robot=PANDA, task=PegInsert(), perturbation=PRESETS["moderate"], time_limit=21.0
    )
    scenario = episode.scenario(9_100_142)
    run = Runner(scenario, episode.simulation(scenario, 9_100_142)).run()
    names = [phase.name for phase in run.phases]
    assert names.index("close across") < names.index("turn") < names.index("close gripper")

    def off(name: str) -> np.ndarray:
        """Return where the peg is in the plane of the tool when a phase ends (2,) [m]."""
        tool, peg = (rows_of(run, name, signal)[-1] for signal in ("tool/pose", "objects/peg"))
        return SO3(tool[3:]).inverse().apply(peg[:3] - tool[:3])[:2]

    assert np.linalg.norm(off("descend")) > 7e-3
    assert np.abs(off("close gripper")).max() < 0.5e-3


class Cell(Tool):
    """One that sees with errors."""

    def __init__(self) -> None:
        simulation = Simulation(PANDA, no_objects)
        sheet = Senses(simulation).sensed.sheet
        erring = replace(sheet, noise={**sheet.noise, "pose_bias": 2e-3})
        Sensed.__init__(self, PANDA, erring, simulation.objects)
        super().__init__()


def test_fingers_turn_the_way_that_the_wrist_can_or_not_at_all() -> None:
    steps = replace(feeling(Cell()), resting=0.03)._come_around(SE3.identity())
    step, turns = next(steps), list[float]()
    failure = Failure(cause=Cause.IK, evidence="it is too far", step="approach")
    for _ in range(3):
        assert isinstance(step, Move)
        (approach,) = step.waypoints
        assert approach.name == "approach"
        assert isinstance(approach.target, SE3)
        turns.append(heading(approach.target))
        with suppress(StepFailed):
            step = steps.throw(StepFailed(failure))
    np.testing.assert_allclose(turns, [0.5 * np.pi, -0.5 * np.pi, 0.0], atol=1e-9)
