"""The bar changes hands in the air, and nothing else counts."""

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.errors import InvalidValueError
from robo47_qp.model.robots.panda_pair import panda_pair
from robo47_qp.report.audit.audit import audit
from robo47_qp.run.contact_steps import Guarded
from robo47_qp.run.failure import Cause
from robo47_qp.run.runner import Runner
from robo47_qp.run.scenario import Run
from robo47_qp.run.steps import StepLike, Wait
from robo47_qp.run.task import Program, Task
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from robo47_qp.tasks.carry_tray.carry_tray import CarryTray
from robo47_qp.tasks.goal import Goal
from robo47_qp.tasks.handling.hand import Hand, closed_on
from robo47_qp.tasks.handling.held_item import HeldItem
from robo47_qp.tasks.handover import handover
from robo47_qp.tasks.handover.handover import Handover
from robo47_qp.tasks.task_state import task_state
from tests.runs import at_rest, live

PAIR = panda_pair()
TASK = Handover()


def start(task: Handover = TASK) -> Simulation:
    simulation = Simulation(PAIR, task.build_scene)
    task.reset(simulation, np.random.default_rng(0))
    return simulation


@pytest.fixture(scope="module")
def run() -> Run:
    simulation = Simulation(PAIR, TASK.build_scene)
    return Runner(ClassicalStack(ik="qp").scenario(PAIR, TASK), simulation).run()


def test_the_bar_is_handed_over_and_put_at_its_goal(run: Run) -> None:
    assert run.failure is None
    assert run.measures["handed_over"] == 1.0
    assert run.measures["place_error_m"] < 1e-3


def test_no_limit_is_violated(run: Run) -> None:
    assert [finding for finding in audit(run) if not finding.ok] == []


def test_both_hands_hold_it_in_the_air_and_then_the_second_alone(run: Run) -> None:
    rows = run.rows
    left, right = (rows[f"gripper/{label}force"].min(axis=1) > 4.0 for label in ("", "right_"))
    height = rows["objects/bar"][:, 2]
    both = left & right
    assert height[both].min() > TASK.height_min
    assert both.sum() > 100
    after = np.arange(len(rows)) > np.flatnonzero(both)[-1]
    assert not left[after].any()
    # Only the left hand held it before.
    assert not right[: np.flatnonzero(both)[0] - 1000].any()


def test_the_arm_that_waits_stands_still(run: Run) -> None:
    (span,) = [rows for phase, rows in run.spans() if phase.name == "descend"]
    reference = run.rows["joints/q_ref"][span][:, 7:]
    np.testing.assert_allclose(reference, np.tile(reference[0], (len(reference), 1)), atol=1e-12)


def test_a_bar_at_its_goal_that_never_changed_hands_does_not_count() -> None:
    simulation = start()
    goal = Goal(simulation=simulation, item=TASK.bar)
    simulation.place_object("bar", goal.pose())
    at_rest(simulation)
    failure = TASK.verdict(simulation)
    assert failure is not None
    assert "never held the bar together" in failure.evidence
    task_state(simulation)[0] = 1.0
    assert TASK.verdict(simulation) is None
    simulation.data.qpos[simulation.model.joint("right_joint2").qposadr[0]] += 0.02
    failure = TASK.verdict(simulation)
    assert failure is not None
    assert failure.cause is Cause.PLACE


def test_an_empty_hand_holds_nothing() -> None:
    simulation = start()
    for tool, name in enumerate(("left", "right")):
        hand = Hand(sensed=live(simulation), name=name)
        assert not closed_on(simulation, tool, 0.03, 40.0)
        assert "80.0 mm apart" in str(hand.against(0.03, 40.0))
        # Open as wide as something, but pressing on nothing.
        assert "press with 0.0 N" in str(hand.against(0.08, 40.0))


def test_random_bars_can_be_held_by_two_hands() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        task = TASK.variant(rng)
        pose = SE3.identity()
        apart = task._grasp(pose, 1.0).translation() - task._grasp(pose, -1.0).translation()
        assert abs(apart[1]) >= 0.145
        assert task.bar.size[0] <= 0.045


def test_bars_that_are_too_short_or_too_thick_are_refused() -> None:
    for size in ((0.03, 0.1, 0.03), (0.08, 0.22, 0.03)):
        with pytest.raises(InvalidValueError, match="size of the bar"):
            Handover(bar=replace(TASK.bar, size=size))


@pytest.mark.parametrize("hands", [(), (0,), (1,), (0, 1)])
def test_one_hand_alone_hands_nothing_over(
    hands: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    def closed(_: Simulation, tool: int, width: float, force: float) -> bool:
        return tool in hands

    monkeypatch.setattr("robo47_qp.tasks.handover.handover.closed_on", closed)
    simulation = start()
    simulation.place_object("bar", SE3.from_translation(np.array([0.48, 0.0, 0.35])))
    TASK.monitor(simulation)
    assert bool(task_state(simulation)[0]) is (len(hands) == 2)


def test_the_bar_is_believed_to_be_where_it_is(run: Run) -> None:
    carried = {
        phase.name: phase.leg.waypoint.carried for phase in run.phases if phase.leg is not None
    }
    for name, hand in (("lift", "left"), ("reach", "left"), ("leave", "right"), ("carry", "right")):
        load = carried[name]
        assert isinstance(load, dict)
        assert [*load] == [hand]


T = TypeVar("T")


def returned(steps: Generator[StepLike, None, T]) -> T:
    """What steps return that move nothing."""
    try:
        while True:
            step = next(steps)
            while isinstance(step, Wait) and step.until and step.until.against():
                pass
    except StopIteration as end:
        result: T = end.value
        return result


class Feels(Simulation):
    """Wrists that feel what they are told to, upwards [N]."""

    felt = (50.0, 50.0)

    def felt_force(self, tool: int = 0) -> np.ndarray:
        return np.array([0.0, 0.0, self.felt[tool]])


def test_what_a_hand_holds_is_weighed_by_what_changes_at_its_own_wrist() -> None:
    simulation = Feels(PAIR, TASK.build_scene)
    hand = Hand(sensed=live(simulation), name="right")
    simulation.felt = (50.0, 0.8)
    free = returned(hand.felt())
    simulation.felt = (-50.0, 0.8 - 0.2 * 9.81)
    assert returned(hand.weigh(free)) == pytest.approx(0.2)


def test_a_bar_that_turned_between_the_fingers_is_where_the_hand_is_and_put_down_level(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    drooping = SO3.from_z_radians(0.4) @ SO3.from_x_radians(0.06)
    bar = SE3.from_rotation_and_translation(drooping, np.array([0.45, -0.2, 0.15]))
    place, off = np.array([3e-3, -0.08, 0.01]), np.array([2e-3, -1e-3, 5e-3])
    point = bar.apply(place)
    tcp = SE3.from_rotation_and_translation(SO3.from_x_radians(np.pi), point)

    def seen(*_: object) -> Generator[StepLike, None, SE3]:
        yield from ()
        return SE3.from_translation(off) @ bar

    monkeypatch.setattr(handover, "estimate_pose", seen)
    monkeypatch.setattr(handover, "camera_errs", lambda _: True)
    monkeypatch.setattr(Hand, "pose", lambda _: tcp)
    hand = Hand(sensed=live(start()), name="right")
    grasped = HeldItem(above=None, mass=0.2, T_tcp_item=tcp.inverse() @ bar, since=0.0)
    held = handover._HeldBar(hand=hand, held=grasped)
    found = returned(held.look(hand.sensed, TASK.bar))
    np.testing.assert_allclose(found.translation() - bar.translation(), [2e-3, -1e-3, 0], atol=1e-9)
    goal = SE3.from_translation(np.array([0.5, -0.3, 0.015]))
    _, there = returned(held.lower(hand.sensed, TASK.bar, goal))
    brought = there @ tcp.inverse() @ found
    np.testing.assert_allclose(brought.as_matrix(), goal.as_matrix(), atol=1e-9)


@dataclass(frozen=True, kw_only=True, eq=False)
class Lowering(Handover):
    """The right hand goes down until its wrist feels something."""

    def program(self, sensed: Sensed) -> Program:
        """See `Task.program`."""
        right = Hand(sensed=sensed, name="right")
        down = right.line("lower", SE3.from_translation(np.array([0, 0, -0.05])) @ right.pose())
        yield Guarded(waypoint=down, force=3.0, missing=Cause.TIMEOUT, tool="right")
        return None


def test_a_guarded_motion_of_the_second_hand_ends_at_what_this_one_touches() -> None:
    class Touches(Feels):
        def felt_force(self, tool: int = 0) -> np.ndarray:
            low = self.tool_pose(1).translation()[2] < start_height - 0.02
            return np.array([0.0, 0.0, 5.0 if tool == 1 and low else 0.0])

    task = Lowering()
    simulation = Touches(PAIR, task.build_scene)
    start_height = simulation.tool_pose(1).translation()[2]
    run = Runner(ClassicalStack(ik="qp").scenario(PAIR, task), simulation).run()
    lowest = run.rows["tool/right_pose"][:, 2].min()
    assert start_height - lowest == pytest.approx(0.02, abs=2e-3)


class Sized(Simulation):
    """Fingers that press, so far apart [m]."""

    apart = 0.0

    def width(self, tool: int = 0) -> float:
        return self.apart

    def last_finger_forces(self, tool: int = 0) -> np.ndarray:
        return np.full(2, 40.0)


def test_a_bar_may_be_as_thick_as_the_data_sheet_allows() -> None:
    simulation = Sized(PAIR, TASK.build_scene)
    sensed = live(simulation)
    sheet = sensed.sheet
    for tolerance, apart, held in ((0.0, 0.0345, False), (0.1, 0.0345, True), (0.1, 0.038, False)):
        sensed.sheet = replace(sheet, noise={**sheet.noise, "size_tolerance": tolerance})
        simulation.apart = apart
        assert (Hand(sensed=sensed, name="left").against(0.03, 40.0) is None) is held


def test_both_hands_hold_a_bar_that_is_thicker_than_is_told() -> None:
    simulation = Sized(PAIR, TASK.build_scene)
    TASK.reset(simulation, np.random.default_rng(0))
    simulation.place_object("bar", SE3.from_translation(np.array([0.48, 0.0, 0.35])))
    for thicker in (1.0, 1.3):
        task_state(simulation)[0] = 0.0
        simulation.model.geom("bar").size[0] = 0.5 * thicker * TASK.bar.size[0]
        simulation.apart = thicker * TASK.bar.size[0]
        TASK.monitor(simulation)
        assert task_state(simulation)[0] == 1.0


@pytest.mark.parametrize("task", [TASK, CarryTray()])
def test_the_hands_may_have_any_names(task: Task) -> None:
    pair = panda_pair()
    robot = replace(pair, tool_name="a", more_tools=(replace(pair.more_tools[0], name="b"),))
    simulation = Simulation(robot, task.build_scene)
    legs = Runner(ClassicalStack(ik="qp").scenario(robot, task), simulation).rehearse()
    assert {name for leg in legs for name in leg.tools or ()} == {"a", "b"}
