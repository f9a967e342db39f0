"""Policies in the cell: what they see, what becomes of what they answer, how an episode ends."""

import sys
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm, JointState
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.waypoint import tool_down
from robo47_qp.report.audit.audit import audit
from robo47_qp.run.failure import Cause, Failure
from robo47_qp.run.policy.drivers import PolicyTiming
from robo47_qp.run.policy.policy import (
    Action,
    JointTarget,
    Observation,
    ToolTarget,
    Torques,
    vector_of,
)
from robo47_qp.run.recording import Rows
from robo47_qp.run.scenario import Run
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from robo47_qp.tasks.reach import reach as judged_reach
from scenarios.policies.hold_poses import HoldPoses
from scenarios.policies.pick_and_place import PickAndPlace
from scenarios.policies.random_targets import RandomTargets
from tests.policies import Scripted, follow
from tests.runs import Reach, Witness, carry_out

ARM = Arm(PANDA)
HOME = ARM.home
SHORT = PolicyTiming(seconds=0.2)


def stay(observation: Observation) -> Action | None:
    return JointTarget(q=HOME)


def broken(run: Run) -> list[str]:
    return [finding.signal for finding in audit(run) if not finding.ok]


def failed(run: Run) -> Failure:
    assert run.failure is not None
    return run.failure


def names(run: Run) -> list[str]:
    return [phase.name for phase in run.phases]


@cache
def solved() -> Run:
    return follow(PickAndPlace(), task=PickPlace(), timing=PolicyTiming(), seed=1)


# Timing


@dataclass(frozen=True, kw_only=True)
class Brief(Reach):
    """Has to be done within 0.2 s."""

    time_limit: float = 0.2


def test_programs_and_policies_have_the_same_time() -> None:
    stack = carry_out(Brief())
    policy = follow(Scripted(stay), task=Brief(), timing=PolicyTiming())
    assert failed(stack).cause is Cause.TIMEOUT
    assert "allowed are 0.2 s" in failed(stack).evidence
    assert len(stack.rows) == pytest.approx(200, abs=21)
    # Coming to rest and being judged is not counted.
    assert policy.failure is None
    assert len(policy.rows) == 200 + 300


@pytest.mark.parametrize("rate", [30.0, 7.0, 1000.0, 333.0])
def test_it_decides_at_its_rate(rate: float) -> None:
    policy = Scripted(stay)
    run = follow(policy, timing=PolicyTiming(rate=rate, seconds=0.2))
    times = [observation.time for observation in policy.seen]
    expected = np.arange(np.ceil(0.2 * rate - 1e-9)) / rate
    assert len(times) == len(expected)
    assert np.abs(times - expected).max() <= 0.5 * TIMESTEP + 1e-9
    assert policy.first is not None
    assert policy.first.time == 0.0
    # The episode, then rest until the end is judged.
    assert len(run.rows) == 200 + 300


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rate": 0.0}, "rate must be at least 0.001 and at most 1000; found 0.0"),
        ({"rate": 1001.0}, "rate must be at least 0.001 and at most 1000"),
        ({"rate": np.nan}, "rate must be at least 0.001 and at most 1000; found nan"),
        ({"seconds": 0.0}, "seconds must be above 0 and at most 86400; found 0.0"),
        ({"seconds": np.inf}, "seconds must be above 0 and at most 86400; found inf"),
    ],
)
def test_a_timing_out_of_range_is_refused(change: dict[str, float], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        PolicyTiming(**change)


# Observations


class Seen(Simulation):
    """Its sensors and its camera are off by known amounts."""

    def state(self) -> JointState:
        state = super().state()
        return JointState(state.q + 0.01, state.v - 0.02)

    def seen_pose(self, name: str) -> SE3:
        return SE3.from_translation(np.array([0.03, 0.0, 0.0])) @ self.object_pose(name)

    def felt_force(self, tool: int = 0) -> Vector:
        return np.array([1.0, 2.0, 3.0])


def test_it_sees_sensors_and_camera_not_the_truth() -> None:
    task, policy = PickPlace(), Scripted(lambda _: None)
    simulation = Seen(PANDA, task.build_scene)
    follow(policy, task=task, simulation=simulation, seed=3)
    (seen,) = policy.seen
    np.testing.assert_allclose(seen.q, HOME + 0.01, atol=1e-12)
    np.testing.assert_allclose(seen.v, -0.02, atol=1e-9)
    np.testing.assert_allclose(seen.tool, vector_of(ARM.pose(HOME + 0.01)), atol=1e-12)
    np.testing.assert_array_equal(seen.force, [1.0, 2.0, 3.0])
    assert seen.width == pytest.approx(0.08, abs=1e-6)
    twin = Simulation(PANDA, task.build_scene)
    task.reset(twin, np.random.default_rng(3))
    cube, goal = twin.object_pose("cube"), twin.marker_pose("goal")
    assert list(seen.objects) == ["cube"]
    assert list(seen.markers) == ["goal"]
    off = seen.objects["cube"][:3] - cube.translation()
    np.testing.assert_allclose(off, [0.03, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(seen.objects["cube"][3:], cube.rotation().wxyz, atol=1e-12)
    np.testing.assert_allclose(seen.markers["goal"], vector_of(goal), atol=1e-12)


def test_what_it_scribbles_on_is_its_own() -> None:
    def scribble(seen: Observation) -> Action:
        for array in (seen.q, seen.v, seen.tool, seen.force, *seen.objects.values()):
            array[:] = 7.0
        return JointTarget(q=HOME)

    tidy, other = (
        follow(Scripted(act), task=PickPlace(), timing=SHORT) for act in (stay, scribble)
    )
    assert tidy.rows.values.tobytes() == other.rows.values.tobytes()


# Actions


# How an episode ends


def test_it_ends_when_the_policy_says_so() -> None:
    policy = Scripted(lambda seen: None if seen.time > 0.12 else JointTarget(q=HOME))
    witness = Witness()
    run = follow(policy, observers=[witness])
    assert policy.seen[-1].time == pytest.approx(0.133)
    assert len(run.rows) == 133 + 300
    assert run.failure is None
    texts = [text for _, text, _ in witness.notes]
    assert texts == ["the policy ended the episode", "program done", "success"]


def test_it_ends_when_its_time_is_over() -> None:
    witness = Witness()
    follow(Scripted(stay), timing=SHORT, observers=[witness])
    assert witness.notes[0][1] == "the episode's 0.2 s are over"


def test_the_verdict_is_that_of_the_task() -> None:
    run = follow(Scripted(lambda _: None), task=PickPlace())
    assert failed(run).cause is Cause.PLACE
    assert "the cube is 400.0 mm from its goal" in failed(run).evidence
    assert run.measures["place_error_m"] == pytest.approx(0.4, abs=1e-3)


class Raises:
    def __init__(self, where: str) -> None:
        self.where = where

    def reset(self, observation: Observation) -> None:
        if self.where == "reset":
            raise KeyError("weights")

    def act(self, observation: Observation) -> Action | None:
        if observation.time > 0.12:
            raise ZeroDivisionError("no such luck")
        return JointTarget(q=HOME)


class Odd:
    """What raises when it is taken for a number, as tensors with gradients do."""

    def __array__(self, dtype: object = None, copy: object = None) -> Vector:
        raise RuntimeError("call detach() first")


@pytest.mark.parametrize(
    ("policy", "evidence"),
    [
        (Raises("reset"), "the policy at 0.000 s: it raised KeyError in reset: 'weights'"),
        (Raises("act"), "the policy at 0.133 s: it raised ZeroDivisionError in act: no such luck"),
        (
            Scripted(lambda _: sys.exit(2)),
            "the policy at 0.000 s: it raised SystemExit in act: 2",
        ),
        (
            Scripted(lambda seen: JointTarget(q=HOME * (np.nan if seen.time > 0.05 else 1.0))),
            "the policy at 0.067 s: q of the action must be a vector of 7 finite numbers; found",
        ),
        (
            Scripted(lambda _: JointTarget(q=np.zeros(3))),
            "q of the action must be a vector of 7 finite numbers; found shape (3,)",
        ),
        (Scripted(lambda _: 7), "the action must be a JointTarget"),  # type: ignore[arg-type,return-value]
        (
            Scripted(lambda _: JointTarget(q=Odd())),  # type: ignore[arg-type]
            "it raised RuntimeError in act: call detach() first",
        ),
        (
            Scripted(lambda _: Torques(tau=np.full(7, 90.0))),
            "tau[4] of the action must be from -12 to 12; found 90",
        ),
    ],
)
def test_what_no_policy_may_do_ends_the_episode_with_its_reason(
    policy: Scripted | Raises, evidence: str
) -> None:
    chunks: list[int] = []

    class Keeper:
        def write(self, rows: Rows) -> None:
            chunks.append(len(rows))

    run = follow(policy, sinks=[Keeper()])
    assert failed(run).cause is Cause.LIMIT
    assert evidence in failed(run).evidence
    assert failed(run).time is not None
    # All that happened is kept, and the arm came to rest.
    assert sum(chunks) == len(run.rows) >= 300
    assert np.abs(run.rows["joints/v"][-1]).max() < 1e-3
    assert broken(run) == []


def test_a_policy_that_fails_while_the_arm_is_fast_leaves_it_at_rest() -> None:
    def lost(seen: Observation) -> Action:
        if seen.time > 0.5:
            raise RuntimeError("lost")
        return ToolTarget(pose=vector_of(tool_down([0.3, 0.4, 0.4])))

    run = follow(Scripted(lost))
    assert names(run) == ["tool targets", "stop", "end"]
    assert np.abs(run.rows["joints/v"][500]).max() > 0.3
    assert np.abs(run.rows["joints/v"][-1]).max() < 1e-3
    assert "RuntimeError in act: lost" in failed(run).evidence
    assert broken(run) == []


def test_the_watch_ends_what_must_not_go_on() -> None:
    down = vector_of(tool_down([0.45, 0.0, -0.05]))
    run = follow(Scripted(lambda _: ToolTarget(pose=down)), timing=PolicyTiming(seconds=4.0))
    assert failed(run).cause is Cause.COLLISION
    assert "touched the table" in failed(run).evidence
    assert names(run) == ["tool targets"]
    assert len(run.rows) < 4000


def test_torques_that_throw_the_arm_are_ended_with_what_happened() -> None:
    run = follow(Scripted(lambda _: Torques(tau=PANDA.tau_max)), timing=PolicyTiming(seconds=2.0))
    assert failed(run).cause in (Cause.LIMIT, Cause.COLLISION)
    assert run.rows["joints/v"].max() > 1.0


# Examples


def test_the_example_solves_the_main_job_from_what_it_observes() -> None:
    run = solved()
    assert run.failure is None
    assert broken(run) == []
    assert run.measures["place_error_m"] < 3e-3
    assert names(run) == ["tool targets", "joint targets", "stop", "end"]
    assert len(run.rows) < 20_000


def test_the_example_holds_poses_in_turn() -> None:
    """Judged as the classical stack is judged: from what was seen on the way."""
    seen = []

    class Watched(HoldPoses):
        def act(self, observation: Observation) -> Action | None:
            seen.append(observation)
            return super().act(observation)

    task = judged_reach.Reach(count=2)
    run = follow(Watched(), task=task, timing=PolicyTiming(), seed=3)
    assert run.failure is None
    assert broken(run) == []
    assert run.measures["poses_left"] == 0.0
    assert len(run.rows) < 20_000
    left = [[name for name, pose in o.markers.items() if pose[2] > 0.0] for o in seen]
    first = [names for names, before in zip(left[1:], left, strict=False) if names != before]
    assert first == [["pose 2"], []]
    for name in ("pose 1", "pose 2"):
        gone = next(o.time for o in seen if o.markers[name][2] < 0.0)
        goal = seen[0].markers[name]
        rows = run.rows["tool/pose"][round(1e3 * gone) - 230 : round(1e3 * gone) - 30]
        assert np.linalg.norm(rows[:, :3] - goal[:3], axis=1).max() < 1e-3


def test_the_example_without_a_plan_fails_by_the_verdict() -> None:
    timing = PolicyTiming(seconds=2.0)
    runs = [follow(RandomTargets(), task=PickPlace(), timing=timing, seed=s) for s in (1, 1, 2)]
    assert failed(runs[0]).cause is Cause.PLACE
    assert broken(runs[0]) == []
    first, again, other = (run.rows["joints/q"].tobytes() for run in runs)
    assert first == again
    assert first != other
