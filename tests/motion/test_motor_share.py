"""Motions at the ratings: what the motors have to do on them, by MuJoCo and the untouched file."""

from dataclasses import dataclass, replace

import mujoco
import numpy as np
import pytest

from robo47_qp.arrays import Vector
from robo47_qp.errors import PlanError, UnknownNameError
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import Robot
from robo47_qp.motion.motor_share import Excess, MotorShare
from robo47_qp.motion.planner import Planner
from robo47_qp.motion.trajectory import Trajectory
from robo47_qp.motion.waypoint import Motion, Waypoint
from robo47_qp.report.audit.audit import audit
from robo47_qp.run.failure import Cause, Condition, refusal
from robo47_qp.run.runner import Runner
from robo47_qp.run.steps import Move
from robo47_qp.run.task import Program
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from tests.examples import shifted
from tests.plain_arm import PlainArm
from tests.robots import robot_named
from tests.runs import Reach

DT = 1e-3


def planner_of(robot: Robot, profile: str = "rated") -> Planner:
    return replace(
        ClassicalStack(profile=profile).planner(robot, PickPlace()),
        collisions=None,
        surroundings=None,
    )


def asked(robot: Robot, trajectory: Trajectory) -> tuple[float, float]:
    """Largest shares of the torque left by gravity and of the torque rate, of the welded file."""
    m = PlainArm(robot).welded
    d, torques, shares = mujoco.MjData(m), list[Vector](), [0.0]
    for q, v, a in zip(trajectory.q, trajectory.v, trajectory.a, strict=True):
        d.qpos[:], d.qvel[:], d.qacc[:] = q, 0.0, 0.0
        mujoco.mj_inverse(m, d)
        g = d.qfrc_inverse.copy()
        d.qvel[:], d.qacc[:] = v, a
        mujoco.mj_inverse(m, d)
        left = np.maximum(robot.tau_max - np.abs(g), 0.1 * robot.tau_max)
        shares.append(float((np.abs(d.qfrc_inverse - g) / left).max()))
        torques.append(d.qfrc_inverse.copy())
    rates = np.abs(np.diff(torques, axis=0)) / DT / robot.tau_rate_max
    return max(shares), float(rates.max())


@pytest.mark.parametrize("name", ["panda", "ur5e"])
@pytest.mark.parametrize("motion", [Motion.PTP, Motion.LIN])
def test_motions_at_the_ratings_keep_the_share_of_the_motors(name: str, motion: Motion) -> None:
    robot = robot_named(name)
    arm = Arm(robot)
    target = shifted(arm.pose(arm.home), np.array([0.05, 0.25, -0.1]))
    waypoint = Waypoint(name="there", target=target, motion=motion)
    planner = planner_of(robot)
    leg = planner.plan(arm, waypoint, arm.home, DT)
    torque, rate = asked(robot, leg.trajectory)
    assert torque < 0.8
    assert rate < 0.5
    alone = replace(planner, motors=None).plan(arm, waypoint, arm.home, DT)
    if asked(robot, alone.trajectory)[1] > 0.5:
        assert rate > 0.4
        assert alone.trajectory.duration < leg.trajectory.duration
    else:
        np.testing.assert_array_equal(alone.trajectory.q, leg.trajectory.q)
    gentle = planner_of(robot, "gentle").plan(arm, waypoint, arm.home, DT)
    assert leg.trajectory.duration < 0.75 * gentle.trajectory.duration
    assert gentle.trajectory.v.max() < robot.profile.v_max.max()


def test_less_torque_is_less_acceleration_and_the_same_speed() -> None:
    robot = robot_named("panda")
    arm = Arm(robot)
    target = shifted(arm.pose(arm.home), np.array([0.05, 0.25, -0.1]))
    weak = replace(planner_of(robot), motors=MotorShare(torque=0.02))
    leg = weak.plan(arm, Waypoint(name="there", target=target), arm.home, DT)
    assert 0.01 < asked(robot, leg.trajectory)[0] < 0.02
    slower = weak.gentler(2.0, 4.0)
    assert slower.profile.v_max.tolist() == weak.profile.v_max.tolist()
    assert slower.profile.a_max.tolist() == (weak.profile.a_max / 2.0).tolist()
    assert slower.lin.profile.linear[2] == weak.lin.profile.linear[2] / 4.0


def test_jerk_that_the_ratings_of_the_panda_allow_is_too_much_for_its_motors() -> None:
    robot = robot_named("panda")
    arm = Arm(robot)
    target = shifted(arm.pose(arm.home), np.array([0.05, 0.25, -0.1]))
    planner = replace(planner_of(robot), motors=None)
    leg = planner.plan(arm, Waypoint(name="there", target=target), arm.home, DT)
    assert asked(robot, leg.trajectory)[1] > 1.0


class Never(MotorShare):
    """What nothing keeps."""

    def excess(self, arm: Arm, trajectory: Trajectory, dt: float) -> Excess:
        return Excess(0.5, 1.1)


def test_what_no_motion_can_keep_is_refused() -> None:
    robot = robot_named("panda")
    arm = Arm(robot)
    planner = replace(planner_of(robot), motors=Never())
    target = shifted(arm.pose(arm.home), np.array([0.05, 0.25, -0.1]))
    told = "'there' cannot be planned: its motors would have to do"
    with pytest.raises(PlanError, match=told) as caught:
        planner.plan(arm, Waypoint(name="there", target=target), arm.home, DT)
    assert refusal(caught.value).cause is Cause.PLAN


def test_profiles_have_names() -> None:
    assert planner_of(robot_named("panda"), "gentle").motors is None
    with pytest.raises(UnknownNameError, match="profile"):
        ClassicalStack(profile="fastest")


@dataclass(frozen=True, kw_only=True)
class Stopped(Reach):
    """Aside by 0.5 m, until something is found amiss."""

    at: float

    def program(self, sensed: Sensed) -> Program:
        def late() -> str | None:
            return "late" if sensed.time > self.at else None

        amiss = Condition(name="in time", cause=Cause.DROP, against=late)
        aside = Waypoint(name="aside", target=shifted(sensed.tool_pose(), np.array([0, 0.5, 0])))
        yield Move(waypoints=(aside,), during=(amiss,))
        return None


@pytest.mark.parametrize("at", [0.15, 0.3, 0.5])
def test_an_arm_at_its_ratings_is_stopped_within_what_its_motors_can_do(at: float) -> None:
    """With the rated jerk the torque would have to change ten times as fast as it can."""
    task, robot = Stopped(at=at), robot_named("panda")
    scenario = ClassicalStack(profile="rated").scenario(robot, task)
    run = Runner(scenario, Simulation(robot, task.build_scene)).run()
    assert run.failure is not None
    assert run.failure.evidence == "late"
    assert "stop" in [phase.name for phase in run.phases]
    assert np.abs(run.rows["joints/v"]).max() > 0.5
    assert [found.signal for found in audit(run) if not found.ok] == []


def test_what_is_asked_of_motors_counts_weights_of_either_sign() -> None:
    robot = robot_named("panda")
    arm, rng = Arm(robot), np.random.default_rng(3)
    for _ in range(20):
        q, v, a = arm.drawn(rng), rng.normal(size=arm.n), 5.0 * rng.normal(size=arm.n)
        still = Trajectory(dt=DT, q=np.stack([q, q]), v=np.stack([v, v]), a=np.stack([a, a]))
        found = MotorShare(torque=1.0, rate=1.0).excess(arm, still, DT)
        assert found.torque == pytest.approx(asked(robot, still)[0], rel=1e-6)
