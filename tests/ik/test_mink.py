"""mink in the path: the fused solvers step for step, the main job, and mink's own exceptions."""

from itertools import islice, pairwise
from typing import Any

import mink
import numpy as np
import pytest
import qpsolvers

from robo47_qp.arrays import Vector
from robo47_qp.evaluation.benchmarks.ik.same_step import (
    OBJECTIVES,
    State,
    differences,
    states,
    step_of,
)
from robo47_qp.ik.mink import MinkIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.qp import QpIk
from robo47_qp.ik.solver import Reason
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
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
        limits = [mink.ConfigurationLimit(arm.model, gain=1.0)]
        expected = mink.solve_ik(
            configuration,
            [tool, posture],
            1.0,
            "daqp",
            damping=1e-9,
            limits=limits,
            primal_tol=1e-9,
        )
        assert np.abs(step_of(MinkIk(), arm, state) - expected).max() < SAME
    assert compared > STATES // 3


@pytest.mark.parametrize("name", [*OBJECTIVES])
def test_steps_are_exact_and_those_of_mink(arm: Arm, name: str) -> None:
    """Beside the minimum in 50 digits, and beside `mink.solve_ik`, which rounds more."""
    found = np.array([differences(name, arm, one) for one in states(arm, STATES // 3)])
    assert found[:, 0].max() < (0.3 * SAME if name == "mink" else 0.1 * SAME)
    assert found[:, 2].max() < SAME
    assert found[:, 3].max() < (0.3 * SAME if name == "mink" else 0.1 * SAME)
    assert 0.1 < (found[:, 4] > 0).mean() < 0.95


def test_the_pose_error_of_lm_is_that_of_another_arm(arm: Arm, plain: PlainArm) -> None:
    for q, _, target in states(arm, 30):
        # That of the plain arm is one of differences.
        assert arm.jacobian(q) == pytest.approx(plain.jacobian(q), abs=1e-7)
        position, angle = plain.errors(q, target)
        e = arm.pose_error(target, q)
        assert (np.linalg.norm(e[:3]), np.linalg.norm(e[3:])) == pytest.approx((position, angle))


# Of 10,000 states those in which mink's JᵀJ loses most: nearly singular, the target near.
@pytest.mark.parametrize(("name", "worst"), [("lm", 2549), ("mink", 7113), ("qp", 7113)])
def test_a_step_where_doubles_lose_digits_is_exact(name: str, worst: int) -> None:
    arm = Arm(PANDA)
    found = differences(name, arm, next(islice(states(arm, 10_000), worst, None)))
    assert found.mink_exact > SAME  # else the state would show nothing
    assert max(found.solver_exact, found.solver_refined) < 0.1 * SAME


@pytest.mark.xfail(reason="mink 1.3: steps are taken from JᵀJ as they are", strict=True)
def test_a_step_of_mink_alone_is_exact_there() -> None:
    arm = Arm(PANDA)
    assert differences("mink", arm, next(islice(states(arm, 10_000), 7113, None))).mink_exact < SAME


def test_bounds_are_kept_closer_than_daqp_keeps_them_by_itself() -> None:
    """States of 10,000 in which its own tolerance of 1e-6 gives a wrong step."""
    arm, chosen = Arm(PANDA), (3315, 3921, 4015, 4605)
    found = [state for i, state in enumerate(states(arm, 4606)) if i in chosen]
    for name in ("qp", "lm", "mink"):
        assert max(differences(name, arm, state).solver_exact for state in found) < SAME


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
    """mink's own logarithm of it is zero, and the target counted as reached.

    Both ways round are as far: a step is right if it is the one for a turn a little less than half,
    one way or the other.
    """
    pose = arm.pose(arm.home)

    def step(ik: MinkIk | QpIk, turn: float) -> Vector:
        return step_of(ik, arm, State(arm.home, arm.home, turned(pose, axis, turn)))

    either = [step(MinkIk(), turn) for turn in (np.pi - 1e-11, 1e-11 - np.pi)]
    assert np.abs(either[0] - either[1]).max() > 0.1
    for ik in (MinkIk(), QpIk()):
        assert min(np.abs(step(ik, np.pi) - one).max() for one in either) < SAME


def test_the_last_steps_are_quadratic(arm: Arm) -> None:
    """With mink's slope, the identity near no rotation, half of the displacement is left."""
    q = arm.home + 1e-2
    target, errors = arm.pose(arm.home), list[float]()
    for _ in range(4):
        errors.append(sum(arm.pose_distance(target, q)))
        q = q + step_of(MinkIk(), arm, State(q, q, target))
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
    solved, asked = mink.solve_ik, list[Vector]()

    def spy(configuration: mink.Configuration, tasks: Any, *more: Any, **options: Any) -> Vector:
        [tool] = [task for task in tasks if isinstance(task, mink.FrameTask)]
        assert tool.transform_target_to_world is not None
        asked.append(tool.transform_target_to_world.wxyz_xyz)
        return solved(configuration, tasks, *more, **options)

    monkeypatch.setattr(mink, "solve_ik", spy)
    run = main_job().run()
    assert run.failure is None
    assert len(run.legs) == 7
    for leg in run.legs:
        # A place of the robot's own is given in its joints.
        if leg.waypoint.target is not Place.HOME:
            off = np.abs(np.array(asked) - leg.T_world_goal.wxyz_xyz).max(axis=1)
            assert off.min() < 1e-9, leg.waypoint.name
