from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from mink import SE3
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

from robo47_qp.arrays import Vector
from robo47_qp.ik.gauss_newton import Stall
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.qp import QpIk
from robo47_qp.ik.solver import Reason, Tolerance
from robo47_qp.model.arm import Arm
from tests.examples import fractions, inner_fractions, poses, rates, shifted, turned
from tests.plain_arm import PlainArm
from tests.robots import arm_of, plain_arm_of

TIGHT = Tolerance(position=1e-9, orientation=1e-9)


def best_step(plain: PlainArm, target: SE3, q: Vector, solver: LmIk) -> Vector:
    """The step of the class's docstring, by scipy's bounded least squares."""
    rows = 3 if solver.position_only else 6
    position, R = plain.tool(q)
    turn = Rotation.from_matrix(R.T @ target.rotation().as_matrix()).as_rotvec()
    # Everything in the axes of the tool; lengths are those in any axes.
    e = np.concatenate([R.T @ (target.translation() - position), turn])[:rows]
    calm = np.sqrt(solver.damping * (e @ e) + 1e-9)
    A = np.vstack([plain.jacobian(q)[:rows], calm * np.eye(plain.n)])
    b = np.concatenate([e, np.zeros(plain.n)])
    if not solver.within_limits:
        step: Vector = np.linalg.lstsq(A, b)[0]
        return step
    # No room at all is no interval for scipy.
    low, high = np.minimum(plain.q_min - q, -1e-12), np.maximum(plain.q_max - q, 1e-12)
    bounded: Vector = lsq_linear(A, b, (low, high), method="bvls", tol=1e-14).x
    return bounded


@pytest.mark.parametrize("within_limits", [True, False])
@pytest.mark.parametrize("position_only", [False, True])
@pytest.mark.parametrize("damping", [0.003, 0.03, 1.0])
@settings(max_examples=12)
@given(at=fractions, step=rates)
def test_one_step_is_the_damped_least_squares_step(
    arm: Arm,
    plain: PlainArm,
    damping: float,
    position_only: bool,
    within_limits: bool,
    at: Vector,
    step: Vector,
) -> None:
    q = plain.at(at)
    target = arm.pose(q + 0.5 * step[: plain.n])
    position, angle = plain.errors(q, target)
    assume(angle < 3.0)
    assume(position > 0.05)
    solver = LmIk(
        max_iterations=1,
        damping=damping,
        position_only=position_only,
        within_limits=within_limits,
    )
    expected = best_step(plain, target, q, solver)
    assert solver.solve(arm, target, q).q - q == pytest.approx(expected, abs=2e-5)


def test_every_step_is_one_from_where_the_last_one_ended(arm: Arm, plain: PlainArm) -> None:
    target = turned(shifted(arm.pose(arm.home), np.array([0.1, 0.15, -0.1])), 0, 0.5)
    q = arm.home
    for count in range(1, 4):
        there = LmIk(max_iterations=count).solve(arm, target, arm.home).q
        assert there - q == pytest.approx(best_step(plain, target, q, LmIk()), abs=2e-5)
        q = there


def test_a_tight_limit_stops_the_step_and_the_others_take_over(arm: Arm, plain: PlainArm) -> None:
    q = arm.home.copy()
    q[0] = plain.q_max[0] - 0.02
    beyond = q.copy()
    beyond[0] += 0.3
    target = arm.pose(beyond)
    moved = LmIk(max_iterations=1).solve(arm, target, q).q - q
    free = LmIk(max_iterations=1, within_limits=False).solve(arm, target, q).q - q
    assert moved[0] == pytest.approx(0.02, abs=1e-12)
    assert free[0] > 0.1
    # Not the free step with one joint cut off.
    assert np.abs(moved - free)[1:].max() > 0.01


def test_more_damping_makes_shorter_steps(arm: Arm) -> None:
    target = shifted(arm.pose(arm.home), np.array([0.1, 0.1, -0.1]))
    lengths = [
        np.linalg.norm(LmIk(max_iterations=1, damping=d).solve(arm, target, arm.home).q - arm.home)
        for d in (0.0, 0.03, 1.0, 30.0, 1e3)
    ]
    assert all(b < a for a, b in pairwise(lengths))
    assert lengths[-1] < 0.2 * lengths[0]


@settings(max_examples=25)
@given(at=fractions, target=poses)
def test_no_step_ever_leaves_the_limits(arm: Arm, plain: PlainArm, at: Vector, target: SE3) -> None:
    """To the last bit, wherever the search goes and for whatever target."""
    q_seed = plain.at(at)
    for position_only in (False, True):
        for count in (1, 2, 5, 12):
            solver = LmIk(max_iterations=count, position_only=position_only)
            q = solver.solve(arm, target, q_seed).q
            assert np.maximum(plain.q_min - q, q - plain.q_max).max() <= 0.0


def test_a_seed_outside_the_limits_starts_on_them(arm: Arm, plain: PlainArm) -> None:
    q_seed = arm.home.copy()
    q_seed[1], q_seed[3] = plain.q_min[1] - 0.4, plain.q_max[3] + 0.2
    start = np.clip(q_seed, plain.q_min, plain.q_max)
    target = arm.pose(arm.home)
    assert LmIk(max_iterations=0).solve(arm, target, q_seed).q.tolist() == start.tolist()
    step = LmIk(max_iterations=1).solve(arm, target, q_seed).q - start
    assert step == pytest.approx(best_step(plain, target, start, LmIk()), abs=2e-5)
    free = LmIk(max_iterations=0, within_limits=False).solve(arm, target, q_seed)
    assert free.q.tolist() == q_seed.tolist()


def test_without_limits_it_leaves_them_and_says_so(arm: Arm, plain: PlainArm) -> None:
    q = arm.home.copy()
    q[0] = plain.q_max[0] + 0.2
    target = arm.pose(q)
    near = arm.home.copy()
    near[0] = plain.q_max[0] - 0.05
    result = LmIk(within_limits=False).solve(arm, target, near)
    assert max(plain.errors(result.q, target)) < 1e-6
    assert not plain.inside(result.q)
    assert result.reason is Reason.JOINT_LIMITS
    outside = (result.q < plain.q_min) | (result.q > plain.q_max)
    expected = [name for name, out in zip(plain.robot.joints, outside, strict=True) if out]
    assert list(result.joints) == expected
    for i in np.flatnonzero(outside):
        beyond = max(plain.q_min[i] - result.q[i], result.q[i] - plain.q_max[i])
        assert f"{plain.robot.joints[i]} is {beyond:.3f} rad outside" in result.explanation


def test_the_position_alone_leaves_the_orientation_be(arm: Arm, plain: PlainArm) -> None:
    rng = np.random.default_rng(4)
    for _ in range(20):
        target = arm.pose(rng.uniform(plain.at(np.full(8, 0.2)), plain.at(np.full(8, 0.8))))
        result = LmIk(position_only=True).solve(arm, target, arm.home)
        assert result.converged, result.explanation
        position, angle = plain.errors(result.q, target)
        assert position <= 1.0001e-6
        assert angle > 1e-3
        assert result.orientation_error == pytest.approx(angle, abs=1e-9)


@settings(max_examples=25)
@given(at=inner_fractions, step=rates)
def test_it_ends_where_the_qp_ends(arm: Arm, plain: PlainArm, at: Vector, step: Vector) -> None:
    """From near the target both reach it, by ways so alike that they meet at one answer."""
    q_seed = plain.at(at)
    assume(np.linalg.svd(arm.jacobian(q_seed), compute_uv=False)[-1] > 0.1)
    there = np.clip(q_seed + 0.05 * step[: plain.n], plain.q_min, plain.q_max)
    target = arm.pose(there)
    lm = LmIk(tolerance=TIGHT).solve(arm, target, q_seed)
    qp = QpIk(tolerance=TIGHT).solve(arm, target, q_seed)
    assert lm.converged
    assert qp.converged
    assert max(plain.errors(lm.q, target)) < 2e-9
    assert max(plain.errors(qp.q, target)) < 2e-9
    assert np.abs(lm.q - qp.q).max() < 0.5 * np.abs(q_seed - there).max() + 1e-9


def test_near_the_end_it_converges_quadratically(arm: Arm, plain: PlainArm) -> None:
    target = turned(shifted(arm.pose(arm.home), np.array([0.03, 0.03, -0.03])), 0, 0.1)
    errors = []
    for count in range(4):
        q = LmIk(max_iterations=count, tolerance=TIGHT).solve(arm, target, arm.home).q
        errors.append(max(plain.errors(q, target)))
    assert errors[-1] < 1e-8
    assert all(b < 50.0 * a**2 for a, b in pairwise(errors))


@pytest.mark.parametrize("position_only", [False, True])
def test_the_number_of_steps_is_bounded_and_counted(arm: Arm, position_only: bool) -> None:
    target = turned(shifted(arm.pose(arm.home), np.array([0.1, 0.1, -0.1])), 1, 0.3)
    full = LmIk(position_only=position_only).solve(arm, target, arm.home)
    assert full.converged
    assert full.iterations >= 2
    for count in range(full.iterations + 2):
        solver = LmIk(position_only=position_only, max_iterations=count)
        result = solver.solve(arm, target, arm.home)
        assert result.iterations == min(count, full.iterations)
        assert result.converged == (count >= full.iterations)


@pytest.mark.parametrize("tolerance", [Tolerance(position=1e-3), Tolerance(orientation=1e-2)])
def test_both_errors_count(arm: Arm, tolerance: Tolerance) -> None:
    target = turned(shifted(arm.pose(arm.home), np.array([0.1, 0.1, -0.1])), 1, 0.3)
    result = LmIk(tolerance=tolerance).solve(arm, target, arm.home)
    assert result.converged
    assert result.position_error <= tolerance.position
    assert result.orientation_error <= tolerance.orientation


@pytest.mark.parametrize("kind", ["lm", "lm position", "qp"])
@pytest.mark.parametrize("stall", [Stall(), Stall(steps=1, fall=0.5), Stall(steps=4, fall=0.05)])
def test_a_search_is_given_up_at_the_first_step_at_which_it_is_stuck(
    arm: Arm, plain: PlainArm, kind: str, stall: Stall
) -> None:
    """Predicted from the errors of searches that are not given up."""
    rng = np.random.default_rng(7)
    limit, stopped = 12, 0
    alone = kind == "lm position"

    def solver(count: int, rule: Stall | None) -> LmIk | QpIk:
        if kind == "qp":
            return QpIk(max_iterations=count, stall=rule)
        return LmIk(max_iterations=count, stall=rule, position_only=alone)

    for _ in range(12):
        target = arm.pose(rng.uniform(plain.q_min, plain.q_max))
        q_seed = rng.uniform(plain.q_min, plain.q_max)
        ends = [solver(count, None).solve(arm, target, q_seed) for count in range(limit + 1)]
        squares: list[float] = []
        expected = ends[-1]
        for end in ends:
            position, angle = plain.errors(end.q, target)
            squares.append(position**2 + (0.0 if alone else angle**2))
            earlier = squares[: -stall.steps]
            if end.converged or (earlier and squares[-1] > (1.0 - stall.fall) * earlier[-1]):
                expected = end
                break
        found = solver(limit, stall).solve(arm, target, q_seed)
        assert found.iterations == expected.iterations
        assert found.q.tobytes() == expected.q.tobytes()
        stopped += not found.converged and found.iterations < limit
    assert stopped > 0


def test_settings_of_one_solver_do_not_leak_into_another(arm: Arm) -> None:
    target = turned(shifted(arm.pose(arm.home), np.array([0.1, 0.1, -0.1])), 1, 0.3)
    solvers = [
        LmIk(max_iterations=1),
        LmIk(max_iterations=1, damping=10.0),
        LmIk(max_iterations=1, position_only=True),
        LmIk(max_iterations=1, within_limits=False, damping=10.0),
    ]
    first = [solver.solve(arm, target, arm.home).q.tobytes() for solver in solvers]
    assert len(set(first[:3])) == 3
    again = [solver.solve(arm, target, arm.home).q.tobytes() for solver in reversed(solvers)]
    assert again[::-1] == first


def test_a_joint_wound_back_inside_its_limits_is_not_called_outside() -> None:
    """Without limits a search may go round a wrist; the answer is told as it is after that."""
    arm, plain = arm_of("ur5e"), plain_arm_of("ur5e")
    target = arm.pose(plain.at(np.array([0.50878, 0.5, 0.71409, 0.9844, 0.73358, 0.0])))
    q_seed = plain.at(np.array([0.47746, 0.24075, 0.0, 0.46115, 0.90576, 0.0]))
    result = LmIk(within_limits=False).solve(arm, target, q_seed)
    assert max(plain.errors(result.q, target)) < 1.1e-6
    assert plain.inside(result.q)
    assert (result.reason, result.explanation, result.joints) == (None, "", ())
