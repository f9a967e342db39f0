"""The bar changes hands in the air, and nothing else counts."""

from dataclasses import replace

import numpy as np
import pytest
from mink import SE3

from robo47_qp.errors import InvalidValueError
from robo47_qp.model.robots.panda_pair import panda_pair
from robo47_qp.report.audit.audit import audit
from robo47_qp.run.failure import Cause
from robo47_qp.run.runner import Runner
from robo47_qp.run.scenario import Run
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from robo47_qp.tasks.goal import Goal
from robo47_qp.tasks.handling.hand import Hand, closed_on
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
