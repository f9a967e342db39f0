"""Actions of policies: what the arm and the gripper make of them."""

import numpy as np
import pytest
from mink import SE3

from robo47_qp.constants import TIMESTEP
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.waypoint import tool_down
from robo47_qp.report.audit.audit import audit
from robo47_qp.run.policy.drivers import PolicyTiming
from robo47_qp.run.policy.policy import (
    Action,
    JointTarget,
    Observation,
    ToolTarget,
    Torques,
    vector_of,
)
from robo47_qp.run.scenario import Run
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from scenarios.policies.pick_and_place import PickAndPlace
from tests.policies import Scripted, follow
from tests.robots import robot_named

ARM = Arm(PANDA)
HOME = ARM.home
SHORT = PolicyTiming(seconds=0.2)


def broken(run: Run) -> list[str]:
    return [finding.signal for finding in audit(run) if not finding.ok]


def names(run: Run) -> list[str]:
    return [phase.name for phase in run.phases]


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
