"""Joints without a range turn freely: the short way, whole turns are one configuration."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo47_qp.arrays import Vector
from robo47_qp.control.joint_stops import JointStops
from robo47_qp.evaluation.benchmarks.ik.judge import Judge
from robo47_qp.evaluation.benchmarks.ik.same_step import states
from robo47_qp.evaluation.benchmarks.motion.reference_kinematics import ReferenceKinematics
from robo47_qp.ik.solver import IkSolver
from robo47_qp.ik.stream.joint_bounds import JointBounds
from robo47_qp.model.arm import Arm
from robo47_qp.model.loading import robot_from_mjcf
from robo47_qp.model.robot import ToolFrame
from robo47_qp.motion.waypoint import Place, Waypoint
from robo47_qp.report.audit.audit import audit
from robo47_qp.report.run_report import report
from robo47_qp.run.policy.action_check import checked_action
from robo47_qp.run.policy.policy import JointTarget
from robo47_qp.run.runner import Runner
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import IK_SOLVERS, ClassicalStack
from robo47_qp.tasks.reach.reach import Reach
from tests.robots import MODELS, arm_of

ROBOT = robot_from_mjcf(
    MODELS / "free7.xml", tcp="tool", home=[0.0, 0.26, 0.0, 1.9, 0.0, 0.98, 0.0]
)
ARM = Arm(ROBOT)
TURN = 2.0 * np.pi
FREE = np.array([True, False] * 3 + [True])
KINOVA = os.environ.get("KINOVA_GEN3_MJCF")


def reached(arm: Arm, solver: IkSolver, count: int, seed: int = 90_000) -> int:
    """How many poses of random configurations are reached from home, judged by FK here."""
    rng, found = np.random.default_rng(seed), 0
    for _ in range(count):
        target = arm.pose(arm.drawn(rng))
        result = solver.solve(arm, target, arm.home)
        p, w = arm.pose_distance(target, result.q)
        inside = arm.limit_margin(result.q) >= 0.0
        near = np.abs((result.q - arm.home)[arm.free]).max() <= np.pi + 1e-9
        found += bool(result.converged and max(p, w) <= 1e-6 and inside and near)
    return found


def test_they_have_no_limits_and_are_drawn_on_the_circle() -> None:
    np.testing.assert_array_equal(ARM.free, FREE)
    assert (ARM.q_max[FREE] == np.inf).all()
    assert (ARM.q_min[FREE] == -np.inf).all()
    q = np.array([ARM.drawn(np.random.default_rng(i)) for i in range(200)])
    assert (np.abs(q[:, FREE]) <= np.pi).all()
    assert (np.abs(q[:, FREE]).max(axis=0) > 3.0).all()
    far = ARM.home + 50.0 * FREE
    assert ARM.limit_margin(far) == ARM.limit_margin(ARM.home) > 0.0


@pytest.mark.parametrize(("name", "count"), [("lm", 1000), ("qp", 200), ("mink", 100), ("dls", 10)])
def test_every_reachable_pose_is_reached_close_to_the_seed(name: str, count: int) -> None:
    assert reached(ARM, ClassicalStack(ik=name).solver(), count) == count


@pytest.mark.parametrize("name", ["mink", "qp", "lm"])
@pytest.mark.skipif(KINOVA is None, reason="KINOVA_GEN3_MJCF names no model of a Kinova Gen3")
def test_every_reachable_pose_of_a_kinova_is_reached(name: str) -> None:
    home = [0.0, 0.26, np.pi, -2.27, 0.0, 0.96, np.pi / 2]
    arm = Arm(robot_from_mjcf(Path(KINOVA or ""), tcp=ToolFrame(body="right_hand"), home=home))
    assert arm.free.sum() == 4
    assert reached(arm, ClassicalStack(ik=name).solver(), 1000) == 1000


@pytest.mark.parametrize("name", IK_SOLVERS)
def test_the_answer_is_on_the_turn_of_the_seed(name: str) -> None:
    seed = ARM.home + TURN * np.array([2, 0, -3, 0, 1, 0, 4])
    target = ARM.pose(ARM.home + 0.1)
    result = ClassicalStack(ik=name).solver().solve(ARM, target, seed)
    assert result.converged
    assert np.abs(result.q - seed).max() <= np.pi


TURNS = st.lists(st.integers(-3, 3), min_size=7, max_size=7).map(np.array)
ANGLES = st.lists(st.floats(-2.0, 2.0), min_size=7, max_size=7).map(np.array)


@given(q=ANGLES, near=ANGLES, turns=TURNS)
def test_the_way_is_the_short_one_and_the_pose_stays(
    q: np.ndarray, near: np.ndarray, turns: np.ndarray
) -> None:
    wound = q + TURN * turns * FREE
    found = ARM.nearest(wound, near)
    np.testing.assert_allclose(np.sin(found - q), 0.0, atol=1e-9)
    assert np.abs((found - near)[FREE]).max() <= np.pi + 1e-9
    np.testing.assert_array_equal(found[~FREE], wound[~FREE])
    np.testing.assert_allclose(ARM.way(near, wound), found - near, atol=1e-12)


@given(q=ANGLES, near=ANGLES, turns=TURNS)
def test_joints_with_a_range_of_more_than_a_turn_unwind_inside_it(
    q: np.ndarray, near: np.ndarray, turns: np.ndarray
) -> None:
    """By brute force over all whole turns."""
    arm = arm_of("ur5e")
    wound = np.clip(2.0 * q[:6] + TURN * turns[:6], arm.q_min, arm.q_max)
    found, goal = arm.unwound(wound, 3.0 * near[:6]), 3.0 * near[:6]
    assert arm.limit_margin(found) >= 0.0
    for i in range(arm.n):
        options = [wound[i] + TURN * k for k in range(-3, 4)]
        inside = [x for x in options if arm.q_min[i] + 1e-9 < x < arm.q_max[i] - 1e-9]
        turned = (found[i] - wound[i]) / TURN
        assert abs(turned - round(turned)) < 1e-9
        options = [wound[i], *inside]
        assert abs(found[i] - goal[i]) <= min(abs(x - goal[i]) for x in options) + 1e-6


def test_motions_go_the_short_way_round() -> None:
    planner = ClassicalStack().planner(ROBOT, Reach(count=1, obstacles=()))
    start, goal = ARM.home.copy(), ARM.home.copy()
    start[0], goal[0] = 3.0, -3.0
    leg = planner.plan(ARM, Waypoint(name="across", target=ARM.pose(goal)), start, 0.001)
    assert leg.stops
    assert np.abs(leg.trajectory.end.q - start).max() <= np.pi
    assert ARM.pose_distance(leg.T_world_goal, leg.trajectory.end.q)[0] < 1e-5
    wound = ARM.home + TURN * FREE
    home = planner.plan(ARM, Waypoint(name="home", target=Place.HOME), wound + 0.1 * FREE, 0.001)
    np.testing.assert_allclose(home.trajectory.end.q, wound, atol=1e-9)
    chain = [Waypoint(name=f"{i}", target=ARM.pose(ARM.home + 2.5 * i * FREE)) for i in range(1, 5)]
    legs = planner.plan_chain(ARM, chain, ARM.home, 0.001)
    for one in legs:
        assert np.abs(one.trajectory.q[-1] - one.trajectory.q[0]).max() <= np.pi + 1e-6


def test_a_task_runs_and_its_report_has_no_infinity() -> None:
    task = Reach(count=2)
    simulation = Simulation(ROBOT, task.build_scene)
    run = Runner(ClassicalStack().scenario(ROBOT, task, 90_000), simulation).run()
    assert run.failure is None
    findings = audit(run)
    assert not [str(finding) for finding in findings if not finding.ok]
    assert "inf" not in str(report(run, {}, findings)).lower().replace("info", "")
    simulation.data.qpos[:7] = ROBOT.home + TURN * FREE
    assert simulation.from_home().max() < 1e-9
    simulation.data.qpos[:7] = ROBOT.home + TURN * ~FREE
    assert simulation.from_home().max() > 6.0


def test_limits_of_streams_stops_and_actions_leave_them_out() -> None:
    bounds = JointBounds(ARM.q_min, ARM.q_max, ROBOT.profile, dt=0.001, margin=1e-3)
    v = 0.9 * bounds.v_max
    box = bounds.box(1000.0 * FREE, v * FREE)
    assert (box.high[FREE] >= v[FREE]).all()
    assert not box.recovering
    tau = np.zeros(7)
    JointStops().push(tau, ARM, ARM.home, ARM.home + 100.0 * FREE)
    np.testing.assert_array_equal(tau, 0.0)
    action = checked_action(JointTarget(q=ARM.home + 9.0 * FREE), ARM)
    assert isinstance(action, JointTarget)
    np.testing.assert_array_equal(action.q, ARM.home + 9.0 * FREE)


def test_the_judge_of_ik_knows_that_they_have_no_limits() -> None:
    q = ARM.home + np.array([2.0, 0.1, -3.0, -0.1, 3.0, 0.1, 2.5])
    found = Judge(ROBOT).verdict(ARM.pose(q), q)
    assert found.limit_excess == 0.0
    assert max(found.position_error, found.orientation_error) < 1e-9
    beyond = q + np.array([0.0, 10.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    excess = Judge(ROBOT).verdict(ARM.pose(q), beyond).limit_excess
    assert excess == pytest.approx(beyond[1] - ARM.q_max[1])


def test_steps_are_compared_from_finite_states() -> None:
    for state in states(ARM, 20):
        assert np.isfinite(state.q).all()


def test_so_do_checks_of_motions_which_search_all_the_way_around() -> None:
    look = ReferenceKinematics(ROBOT)
    np.testing.assert_array_equal(look.q_max[FREE], np.inf)
    assert look.inside(ARM.home + 50.0 * FREE)
    starts = []

    class Noted(ReferenceKinematics):
        def nearest(self, pose: Vector, q: Vector, room: tuple[Vector, Vector]) -> Any:
            starts.append(q)
            return q, np.inf

    Noted(ROBOT).reaches(look.pose(look.home), 200, np.random.default_rng(1), 1e-6)
    spread = np.abs(np.array(starts)[:, FREE]).max(axis=0)
    assert ((spread > 3.0) & (spread <= np.pi)).all()
