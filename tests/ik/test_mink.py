"""mink in the path: the fused solvers step for step, the main job, and mink's own exceptions."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import mink
import numpy as np
import pytest
import qpsolvers
from mink import SE3
from mink.tasks import BaseTask

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.mink import MinkIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.qp import QpIk
from robo47_qp.ik.solver import Reason
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.planner import Leg, Planner
from robo47_qp.motion.waypoint import Place
from robo47_qp.run.runner import Runner
from robo47_qp.sim.simulation import Simulation
from robo47_qp.stack import ClassicalStack
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from tests.examples import turned
from tests.plain_arm import PlainArm

STATES = 300
SAME = 1e-9
"""Steps closer than this are one [rad]."""


class RotationVector(mink.Task):
    """Displacement and rotation vector of the tool: what LmIk steps on."""

    def __init__(self, arm: Arm, target: SE3, rows: int, damping: float) -> None:
        super().__init__(np.ones(rows), lm_damping=damping)
        self.arm, self.target, self.rows = arm, target, rows

    def compute_error(self, configuration: mink.Configuration) -> Vector:
        error: Vector = -self.arm.pose_error(self.target, configuration.q)[: self.rows]
        return error

    def compute_jacobian(self, configuration: mink.Configuration) -> Matrix:
        return self.arm.jacobian(configuration.q)[: self.rows]


def states(arm: Arm, count: int) -> list[tuple[Vector, Vector, SE3]]:
    """Configuration, seed and target: inside the limits and on them, near and far."""
    rng, found = np.random.default_rng(4), []
    for i in range(count):
        q, q_seed = rng.uniform(arm.q_min, arm.q_max, (2, arm.n))
        if i % 2:
            on = rng.random(arm.n) < 0.3
            q[on] = np.where(rng.random(arm.n) < 0.5, arm.q_min, arm.q_max)[on]
        way = rng.uniform(-1.0, 1.0, arm.n) * 10.0 ** -rng.uniform(0.0, 4.0)
        found.append((q, q_seed, arm.pose(q + way)))
    return found


def plain_step(configuration: mink.Configuration, tasks: Sequence[BaseTask]) -> Vector:
    """mink's own objects, made anew."""
    limits = [mink.ConfigurationLimit(configuration.model, gain=1.0)]
    return mink.solve_ik(configuration, tasks, 1.0, "daqp", damping=1e-9, limits=limits)


def step_of(solver: MinkIk | QpIk | LmIk, arm: Arm, state: tuple[Vector, Vector, SE3]) -> Vector:
    q, q_seed, target = state
    stepper = solver._search(arm).stepper
    stepper.aim(target, q_seed)
    distance2, angle2, _ = stepper.move(q)
    turns = not getattr(solver, "position_only", False)
    step = stepper.step(q, distance2 + (angle2 if turns else 0.0), None)
    assert step is not None
    return step


def test_fused_and_mink_make_the_same_step(arm: Arm) -> None:
    """Twist, posture and damping."""
    bounded = 0
    for state in states(arm, STATES):
        fused, own = (step_of(kind(), arm, state) for kind in (QpIk, MinkIk))
        assert np.abs(fused - own).max() < SAME
        q = state[0] + own
        bounded += bool((np.minimum(q - arm.q_min, arm.q_max - q) < 1e-9).any())
    assert 0.1 * STATES < bounded < 0.95 * STATES


def test_its_objects_are_those_of_mink(arm: Arm) -> None:
    """Away from mink's defects at half a turn and near none, mink's classes as they are."""
    compared = 0
    for state in states(arm, STATES):
        q, q_seed, target = state
        if not 1e-2 < arm.pose_distance(target, q)[1] < 3.1:
            continue
        compared += 1
        configuration = mink.Configuration(arm.model, q=q)
        tool = mink.FrameTask(arm.robot.tcp, "site", 1.0, 1.0, lm_damping=0.03)
        tool.set_target(target)
        size = float(np.linalg.norm(tool.compute_error(configuration)))
        posture = mink.PostureTask(arm.model, cost=1e-2 * size)
        posture.set_target(q_seed)
        expected = plain_step(configuration, [tool, posture])
        assert np.abs(step_of(MinkIk(), arm, state) - expected).max() < SAME
    assert compared > STATES // 3


@pytest.mark.parametrize("position_only", [False, True])
def test_the_step_of_lm_is_that_of_mink_with_a_task_of_rotation_vectors(
    arm: Arm, plain: PlainArm, position_only: bool
) -> None:
    solver, rows = LmIk(position_only=position_only), 3 if position_only else 6
    for state in states(arm, STATES // 3):
        q, _, target = state
        task = RotationVector(arm, target, rows, solver.damping)
        # That of the plain arm is one of differences.
        assert arm.jacobian(q) == pytest.approx(plain.jacobian(q), abs=1e-7)
        expected = plain_step(mink.Configuration(arm.model, q=q), [task])
        assert np.abs(step_of(solver, arm, state) - expected).max() < SAME


def test_whole_searches_end_in_the_same_place(arm: Arm) -> None:
    for q, q_seed, target in states(arm, 40):
        del q
        fused, own = (kind().solve(arm, target, q_seed) for kind in (QpIk, MinkIk))
        assert own.converged == fused.converged
        if fused.converged:
            assert own.q == pytest.approx(fused.q, abs=1e-5)
            assert own.iterations == fused.iterations


def test_clearance_is_kept_as_by_the_fused_solver() -> None:
    arm = Arm(PANDA)
    rng = np.random.default_rng(8)
    kept = 0
    for _ in range(20):
        target = arm.pose(rng.uniform(arm.q_min, arm.q_max))
        ends = [
            MultiStart(solver=kind(max_iterations=30, clearance=0.01), max_restarts=5).solve(
                arm, target, arm.home
            )
            for kind in (QpIk, MinkIk)
        ]
        assert ends[0].reason is ends[1].reason
        if ends[0].converged:
            kept += 1
            assert ends[1].clearance is not None
            assert ends[1].clearance >= 0.01
    assert kept > 10


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_half_a_turn_is_half_a_turn(arm: Arm, axis: int) -> None:
    """mink's own logarithm of it is zero, and the target counted as reached."""
    pose = arm.pose(arm.home)
    target = turned(pose, axis, np.pi)
    step = step_of(MinkIk(), arm, (arm.home, arm.home, target))
    assert np.abs(step).max() > 0.1
    assert np.abs(step - step_of(QpIk(), arm, (arm.home, arm.home, target))).max() < SAME


def test_the_last_steps_are_quadratic(arm: Arm) -> None:
    """With mink's slope, the identity near no rotation, half of the displacement is left."""
    q = arm.home + 1e-2
    target, errors = arm.pose(arm.home), list[float]()
    for _ in range(4):
        errors.append(sum(arm.pose_distance(target, q)))
        q = q + step_of(MinkIk(), arm, (q, q, target))
    assert all(b < 30.0 * a**2 + 1e-13 for a, b in pairwise(errors))


def test_no_solution_is_a_result(arm: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing(*_: Any, **__: Any) -> Vector:
        raise mink.NoSolutionFound("daqp")

    monkeypatch.setattr(mink, "solve_ik", nothing)
    result = MinkIk().solve(arm, arm.pose(arm.home + 0.2), arm.home)
    assert result.reason is Reason.NOT_CONVERGED
    assert result.q.tolist() == arm.home.tolist()


def test_the_qp_solver_is_the_one_that_was_chosen(
    arm: Arm, monkeypatch: pytest.MonkeyPatch
) -> None:
    used = set()
    original = qpsolvers.solve_problem

    def spy(problem: qpsolvers.Problem, solver: str, **options: Any) -> qpsolvers.Solution:
        used.add(solver)
        return original(problem, solver, **options)

    monkeypatch.setattr(qpsolvers, "solve_problem", spy)
    ik = ClassicalStack(ik="mink-single", qp_solver="osqp").solver()
    assert ik.solve(arm, arm.pose(arm.home + 0.1), arm.home).converged
    assert used == {"osqp"}


# The main job -----------------------------------------------------------------------------------


def main_job() -> Runner:
    task = PickPlace()
    scenario = ClassicalStack().scenario(PANDA, task, 1)
    return Runner(scenario, Simulation(PANDA, task.build_scene))


class MinkWasAskedError(Exception):
    """In place of mink."""


def test_the_main_job_fails_without_mink(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any, **__: Any) -> None:
        raise MinkWasAskedError

    monkeypatch.setattr(mink, "solve_ik", broken)
    monkeypatch.setattr(mink, "build_ik", broken)
    with pytest.raises(MinkWasAskedError):
        main_job().run()


def test_the_main_job_asks_mink_for_every_waypoint(monkeypatch: pytest.MonkeyPatch) -> None:
    solved, asked, legs = mink.solve_ik, list[Vector](), list[Leg]()

    def spy(configuration: mink.Configuration, tasks: Any, *more: Any, **options: Any) -> Vector:
        [tool] = [task for task in tasks if isinstance(task, mink.FrameTask)]
        assert tool.transform_target_to_world is not None
        asked.append(tool.transform_target_to_world.wxyz_xyz)
        return solved(configuration, tasks, *more, **options)

    def planned(*arguments: Any) -> Leg:
        legs.append(plan(*arguments))
        return legs[-1]

    plan = Planner._leg
    monkeypatch.setattr(mink, "solve_ik", spy)
    monkeypatch.setattr(Planner, "_leg", planned)
    assert main_job().run().failure is None
    assert len(legs) >= 7
    for leg in legs:
        # A place of the robot's own is given in its joints.
        if leg.waypoint.target is not Place.HOME:
            off = np.abs(np.array(asked) - leg.T_world_goal.wxyz_xyz).max(axis=1)
            assert off.min() < 1e-9, leg.waypoint.name
