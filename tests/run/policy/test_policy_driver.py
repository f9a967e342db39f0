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
from tests.robots import robot_named
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
        ({"rate": 0.0}, "rate must be above 0 and at most 1000; found 0.0"),
        ({"rate": 1001.0}, "rate must be above 0 and at most 1000"),
        ({"rate": np.nan}, "rate must be above 0 and at most 1000; found nan"),
        ({"seconds": 0.0}, "seconds must be above 0 and finite; found 0.0"),
        ({"seconds": np.inf}, "seconds must be above 0 and finite; found inf"),
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


def test_joint_targets_are_reached_within_the_bounds_of_the_profile() -> None:
    goals = [HOME + 0.1, HOME - 0.15]
    run = follow(
        Scripted(lambda seen: JointTarget(q=goals[seen.time > 0.3])),
        timing=PolicyTiming(seconds=1.6),
    )
    assert run.failure is None
    assert broken(run) == []
    assert names(run) == ["joint targets", "end"]
    rows = run.rows
    np.testing.assert_array_equal(rows["joints/q_ref"][-1], goals[1])
    assert np.abs(rows["joints/q"][-1] - goals[1]).max() < 1e-3
    # It turned round while it moved, as fast as its jerk allows.
    turned = rows["joints/v_ref"][301:340, 0]
    assert (turned > 0.05).all()
    jerk = np.abs(np.diff(rows["joints/a_ref"], axis=0)) / TIMESTEP
    assert jerk.max() == pytest.approx(PANDA.profile.j_max[0], rel=1e-6)


def test_tool_targets_are_reached_without_steps_in_torque() -> None:
    goal = SE3.from_translation(np.array([0.05, 0.05, 0.05])) @ ARM.pose(HOME)
    run = follow(Scripted(lambda _: ToolTarget(pose=vector_of(goal))))
    assert run.failure is None
    assert broken(run) == []
    assert names(run)[0] == "tool targets"
    phase = run.phases[0]
    assert (phase.streamed, phase.compliant, phase.leg) == (True, False, None)
    np.testing.assert_allclose(run.rows["tool/pose"][-1, :3], goal.translation(), atol=5e-4)
    tau = run.rows["joints/tau_command"]
    assert np.abs(np.diff(tau, axis=0)).max() < PANDA.tau_rate_max[0] * TIMESTEP


def holding(seen: Observation) -> Action:
    """Gravity alone, and some damping: the arm stays where it is."""
    still = np.zeros(7)
    return Torques(tau=ARM.inverse_dynamics(seen.q, still, still) - 2.0 * seen.v)


def test_torques_go_to_the_motors_and_nothing_else_does() -> None:
    wanted = []

    def push(seen: Observation) -> Action:
        action = holding(seen)
        assert isinstance(action, Torques)
        wanted.append(action.tau + np.array([3.0, 0, 0, 0, 0, 0, 0]))
        return Torques(tau=wanted[-1])

    run = follow(Scripted(push), timing=PolicyTiming(rate=1000.0, seconds=0.3))
    rows = run.rows
    # Once the motors have got there (3 N·m at 1 N·m per period), they deliver what is asked for.
    np.testing.assert_allclose(rows["joints/tau"][10:300], wanted[10:300], atol=1e-9)
    np.testing.assert_allclose(rows["joints/tau_command"][:3, 0], [1.0, 2.0, 3.0], atol=0.1)
    np.testing.assert_array_equal(rows["joints/q_ref"][:300], rows["joints/q"][:300])
    np.testing.assert_array_equal(rows["joints/v_ref"][:300], rows["joints/v"][:300])
    assert not rows["joints/a_ref"][:300].any()
    # A mass m under a force f with damping b: q = f / b (t - m / b (1 - exp(-b t / m))).
    f, b, t = 3.0, 3.0, 0.3
    m = 1.0 / np.linalg.inv(ARM.mass_matrix(HOME))[0, 0]
    expected = f / b * (t - m / b * (1.0 - np.exp(-b * t / m)))
    assert rows["joints/q"][299, 0] - HOME[0] == pytest.approx(expected, rel=0.15)
    assert names(run) == ["torques", "stop", "end"]
    assert (run.phases[0].streamed, run.phases[0].compliant) == (True, True)
    assert broken(run) == []
    # Then the controller takes over, and brings the arm to rest.
    assert np.abs(rows["joints/v"][-1]).max() < 1e-3
    assert np.abs(rows["errors/q"][300:]).max() < 0.02


def test_the_controller_takes_over_without_a_bump() -> None:
    def push(seen: Observation) -> Action | None:
        action = holding(seen)
        assert isinstance(action, Torques)
        return Torques(tau=action.tau + np.array([6.0, 0, 0, 0, 0, 0, 0]))

    run = follow(Scripted(push), timing=PolicyTiming(rate=100.0, seconds=0.1))
    assert run.rows["joints/tau_command"][99, 0] > 3.0
    assert broken(run) == []


@pytest.mark.parametrize("then", [JointTarget(q=HOME), None])
def test_an_arm_too_fast_to_turn_round_within_jerk_and_limits_brakes_harder(
    then: Action | None,
) -> None:
    """Joint 4 folds towards its limit so fast that a jerk-limited stop would leave it."""
    there = ToolTarget(pose=vector_of(tool_down([0.25, 0.0, 0.15])))
    run = follow(Scripted(lambda seen: there if seen.time < 0.599 else then))
    assert run.failure is None
    assert broken(run) == []
    assert names(run)[-1] == "end"
    braking = run.rows["joints/v"][600:700, 3]
    assert braking[0] < -0.5
    assert np.abs(braking[-1]) < np.abs(braking[0])


def test_torques_between_targets_change_hands_without_a_bump() -> None:
    def mixed(seen: Observation) -> Action:
        if 0.1 < seen.time < 0.3:
            return holding(seen)
        up = ARM.pose(HOME).translation() + np.array([0.0, 0.0, 0.03])
        if seen.time > 0.5:
            pose = SE3.from_rotation_and_translation(ARM.pose(HOME).rotation(), up)
            return ToolTarget(pose=vector_of(pose))
        return JointTarget(q=HOME)

    run = follow(Scripted(mixed), timing=PolicyTiming(rate=100.0, seconds=1.0))
    assert run.failure is None
    assert broken(run) == []
    assert names(run)[:4] == ["joint targets", "torques", "joint targets", "tool targets"]
    assert np.abs(run.rows["errors/q"]).max() < 2e-3


def test_targets_of_all_kinds_in_turn_keep_all_promises(rng: np.random.Generator) -> None:
    """Decimetres and tenths of a radian at random, changed while the arm is fast."""
    held: list[Action] = []

    def wild(seen: Observation) -> Action:
        if not held or rng.random() < 0.15:
            pose = seen.tool + np.array([*rng.uniform(-0.2, 0.2, 3), 0, 0, 0, 0])
            pose[2] = max(pose[2], 0.25)
            near = np.clip(seen.q + rng.uniform(-0.4, 0.4, 7), ARM.q_min, ARM.q_max)
            held[:] = [ToolTarget(pose=pose) if rng.random() < 0.5 else JointTarget(q=near)]
        return held[0]

    run = follow(Scripted(wild), timing=PolicyTiming(seconds=4.0))
    assert run.failure is None
    assert broken(run) == []
    assert {"joint targets", "tool targets"} <= set(names(run))
    assert np.abs(run.rows["joints/v"]).max() > 0.5


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_joint_may_be_sent_to_its_very_limit(side: float) -> None:
    q = HOME.copy()
    q[6] = ARM.q_max[6] if side > 0.0 else ARM.q_min[6]
    run = follow(Scripted(lambda _: JointTarget(q=q)), timing=PolicyTiming(seconds=3.2))
    assert run.failure is None
    assert broken(run) == []
    assert abs(run.rows["joints/q"][-1, 6] - q[6]) < 0.01


def test_a_width_that_wobbles_still_holds_the_cube() -> None:
    """Networks never say the same number twice."""

    rng = np.random.default_rng(0)

    class Shaky(PickAndPlace):
        def act(self, observation: Observation) -> Action | None:
            answer = super().act(observation)
            if isinstance(answer, ToolTarget) and answer.width == 0.0:
                return ToolTarget(pose=answer.pose, width=0.037 + rng.uniform(-1e-3, 1e-3))
            return answer

    run = follow(Shaky(), task=PickPlace(), timing=PolicyTiming(seconds=4.5))
    lifted = run.rows["objects/cube"][:4500, 2] > 0.03
    assert lifted.sum() > 500
    assert run.rows["gripper/force"][:4500][lifted].min() > 20.0


def test_a_robot_without_a_gripper_is_driven_too() -> None:
    robot = robot_named("hinge6")
    home = Arm(robot).home
    policy = Scripted(lambda _: JointTarget(q=home + 0.02))
    run = follow(policy, robot=robot, timing=SHORT)
    assert policy.seen[0].width is None
    assert run.failure is None
    assert run.rows["joints/q_ref"][-1, 0] > home[0]


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
