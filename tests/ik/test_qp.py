from itertools import pairwise

import mink
import numpy as np
import pytest
import qpsolvers
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from mink import SE3
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import UnknownNameError
from robo47_qp.ik.box_qp import backends
from robo47_qp.ik.qp import QpIk
from robo47_qp.ik.solver import Reason, Tolerance
from robo47_qp.model.arm import Arm
from tests.examples import fractions, inner_fractions, poses, rates, shifted, turned
from tests.plain_arm import PlainArm

BACKENDS = backends()
BACKEND = pytest.mark.parametrize("backend", BACKENDS)


def error_twist(plain: PlainArm, q: Vector, target: SE3) -> Vector:
    """Twist in the tool frame that leads to the target in unit time."""
    position, R = plain.tool(q)
    turn = Rotation.from_matrix(R.T @ target.rotation().as_matrix()).as_rotvec()
    # A steady twist carries the tool by its linear part, turned along the way: integrate that.
    nodes, weights = np.polynomial.legendre.leggauss(12)
    along = Rotation.from_rotvec(0.5 * (nodes[:, None] + 1.0) * turn).as_matrix()
    carried = np.einsum("k,kij->ij", 0.5 * weights, along)
    linear = np.linalg.solve(carried, R.T @ (target.translation() - position))
    return np.concatenate([linear, turn])


def error_slope(plain: PlainArm, q: Vector, target: SE3) -> Matrix:
    """How the error falls per joint (6, n), by differences."""
    h = 1e-6
    columns = [
        (error_twist(plain, q - h * e, target) - error_twist(plain, q + h * e, target)) / (2 * h)
        for e in np.eye(plain.n)
    ]
    return np.array(columns).T


def best_step(plain: PlainArm, target: SE3, q_seed: Vector, q: Vector, solver: QpIk) -> Vector:
    """The step of the class's docstring, by scipy's bounded least squares."""
    e, n = error_twist(plain, q, target), plain.n
    size = np.linalg.norm(e)
    posture, calm = solver.posture_cost * size, np.sqrt(solver.lm_damping) * size
    A = np.vstack([error_slope(plain, q, target), posture * np.eye(n), calm * np.eye(n)])
    b = np.concatenate([e, posture * (q_seed - q), np.zeros(n)])
    low, high = plain.q_min - q, plain.q_max - q
    # No room at all is no interval for scipy.
    bounds = np.minimum(low, -1e-12), np.maximum(high, 1e-12)
    step: Vector = lsq_linear(A, b, bounds, method="bvls", tol=1e-14).x
    return step


@BACKEND
@settings(max_examples=12)
@given(
    at=inner_fractions,
    step=rates,
    costs=st.tuples(st.floats(1e-3, 0.1), st.floats(1e-3, 0.3)),
)
def test_one_step_is_the_bounded_least_squares_step(
    arm: Arm,
    plain: PlainArm,
    backend: str,
    at: Vector,
    step: Vector,
    costs: tuple[float, float],
) -> None:
    q = plain.at(at)
    target = arm.pose(q + 0.5 * step[: plain.n])
    assume(1e-2 < np.linalg.norm(error_twist(plain, q, target)[3:]) < 3.0)
    solver = QpIk(
        backend=backend,
        max_iterations=1,
        lm_damping=costs[0],
        posture_cost=costs[1],
    )
    expected = best_step(plain, target, q, q, solver)
    assert solver.solve(arm, target, q).q - q == pytest.approx(expected, abs=2e-5)


def step_of_mink(arm: Arm, target: SE3, q_seed: Vector, q: Vector, solver: QpIk) -> Vector:
    """mink's own problem at q, solved by qpsolvers."""
    frame = mink.FrameTask(arm.robot.tcp, "site", 1.0, 1.0, lm_damping=solver.lm_damping)
    frame.set_target(target)
    configuration = mink.Configuration(arm.model, q=q)
    size = float(np.linalg.norm(frame.compute_error(configuration)))
    posture = mink.PostureTask(arm.model, cost=solver.posture_cost * size)
    posture.set_target(q_seed)
    limits = [mink.ConfigurationLimit(arm.model, gain=1.0)]
    problem = mink.build_ik(configuration, [frame, posture], 1.0, damping=1e-9, limits=limits)
    # By itself DAQP leaves bounds by up to 1e-6.
    step: Vector | None = qpsolvers.solve_problem(problem, solver="daqp", primal_tol=1e-9).x
    assert step is not None
    return step


@settings(max_examples=150)
@given(
    at=fractions,
    seed=fractions,
    target=st.one_of(poses, rates),
    costs=st.tuples(st.floats(1e-3, 0.3), st.floats(1e-3, 0.3)),
)
def test_a_step_is_that_of_mink(
    arm: Arm,
    plain: PlainArm,
    at: Vector,
    seed: Vector,
    target: SE3 | Vector,
    costs: tuple[float, float],
) -> None:
    """Anywhere inside the limits and on them, to targets far, near, and out of reach."""
    q, q_seed = plain.at(at), plain.at(seed)
    if not isinstance(target, SE3):
        target = arm.pose(q + 0.5 * target[: plain.n])
    # mink's own logarithm is another one beyond: see test_pose_log.py.
    assume(1e-3 < plain.errors(q, target)[1] < np.pi - 1e-3)
    solver = QpIk(lm_damping=costs[0], posture_cost=costs[1])
    stepper = solver._search(arm).stepper
    stepper.aim(target, q_seed)
    step = stepper.step(q, sum(stepper.move(q)), None)
    expected = step_of_mink(arm, target, q_seed, q, solver)
    assert step == pytest.approx(expected, abs=1e-8)
    first = QpIk(max_iterations=1, lm_damping=costs[0], posture_cost=costs[1])
    moved = first.solve(arm, target, q).q - q
    assert moved == pytest.approx(step_of_mink(arm, target, q, q, first), abs=1e-8)


def test_a_whole_search_is_that_of_mink(arm: Arm, plain: PlainArm) -> None:
    """Step after step with the posture at the seed, to the end."""
    rng = np.random.default_rng(12)
    for _ in range(8):
        q_seed = rng.uniform(plain.q_min, plain.q_max)
        target = arm.pose(np.clip(q_seed + rng.uniform(-0.5, 0.5, arm.n), plain.q_min, plain.q_max))
        q = q_seed.copy()
        for count in range(4):
            solver = QpIk(max_iterations=count)
            result = solver.solve(arm, target, q_seed)
            assert result.q == pytest.approx(q, abs=1e-7)
            if result.converged:
                break
            q = np.clip(q + step_of_mink(arm, target, q_seed, q, solver), plain.q_min, plain.q_max)


def test_a_tight_limit_stops_the_step(arm: Arm, plain: PlainArm) -> None:
    q = arm.home.copy()
    q[0] = plain.q_max[0] - 0.02
    beyond = q.copy()
    beyond[0] += 0.3
    target = arm.pose(beyond)
    solver = QpIk(max_iterations=1)
    moved = solver.solve(arm, target, q).q - q
    assert moved[0] == pytest.approx(0.02, abs=1e-6)
    assert moved == pytest.approx(best_step(plain, target, q, q, solver), abs=2e-5)


def test_the_posture_is_the_seed_through_all_steps(arm: Arm, plain: PlainArm) -> None:
    """The second step still leans towards where the search began."""
    target = turned(shifted(arm.pose(arm.home), np.array([0.1, 0.15, -0.1])), 0, 0.5)
    one = QpIk(max_iterations=1, posture_cost=0.3)
    q_seed = arm.home
    q_first = one.solve(arm, target, q_seed).q
    q_second = QpIk(max_iterations=2, posture_cost=0.3).solve(arm, target, q_seed).q
    expected = best_step(plain, target, q_seed, q_first, one)
    assert q_second - q_first == pytest.approx(expected, abs=2e-5)
    assert (q_seed - q_first) @ (q_seed - q_first) > 1e-3


def test_a_seed_outside_the_limits_starts_on_them_and_stays_the_posture(
    arm: Arm, plain: PlainArm
) -> None:
    q_seed = arm.home.copy()
    q_seed[1] = plain.q_min[1] - 0.4
    start = np.clip(q_seed, plain.q_min, plain.q_max)
    target = arm.pose(arm.home)
    assert QpIk(max_iterations=0).solve(arm, target, q_seed).q.tolist() == start.tolist()
    one = QpIk(max_iterations=1, posture_cost=0.3)
    expected = best_step(plain, target, q_seed, start, one)
    assert one.solve(arm, target, q_seed).q - start == pytest.approx(expected, abs=2e-5)


@settings(max_examples=15)
@given(at=inner_fractions, step=rates)
def test_backends_agree_step_by_step(arm: Arm, plain: PlainArm, at: Vector, step: Vector) -> None:
    q = plain.at(at)
    target = arm.pose(np.clip(q + 0.3 * step[: plain.n], plain.q_min, plain.q_max))
    ends = [
        QpIk(backend=backend, max_iterations=1, posture_cost=1e-2).solve(arm, target, q).q
        for backend in BACKENDS
    ]
    for end in ends[1:]:
        assert end == pytest.approx(ends[0], abs=1e-5)


@BACKEND
@settings(max_examples=15)
@given(at=fractions, step=rates)
def test_no_step_ever_leaves_the_limits(
    arm: Arm, plain: PlainArm, backend: str, at: Vector, step: Vector
) -> None:
    q_seed = plain.at(at)
    target = arm.pose(q_seed + step[: plain.n])
    for count in (1, 3, 8):
        result = QpIk(backend=backend, max_iterations=count).solve(arm, target, q_seed)
        outside = np.maximum(plain.q_min - result.q, result.q - plain.q_max).max()
        assert outside <= 0.0


@pytest.mark.parametrize("end", ["q_min", "q_max"])
def test_an_answer_on_a_limit_is_an_answer(arm: Arm, plain: PlainArm, end: str) -> None:
    for i in range(arm.n):
        q = arm.home.copy()
        q[i] = getattr(plain, end)[i]
        away = np.clip(q + np.where(np.arange(arm.n) == i, 0.0, 0.1), plain.q_min, plain.q_max)
        result = QpIk().solve(arm, arm.pose(q), away)
        assert result.converged, (arm.robot.joints[i], result.explanation)


def test_the_answer_is_close_to_the_seed(arm: Arm, plain: PlainArm) -> None:
    """Of the poses that a redundant arm has for a target, one near the seed is returned."""
    rng = np.random.default_rng(2)
    for _ in range(20):
        q = rng.uniform(plain.at(np.full(8, 0.2)), plain.at(np.full(8, 0.8)))
        q_seed = q + rng.uniform(-0.05, 0.05, arm.n)
        result = QpIk().solve(arm, arm.pose(q), q_seed)
        assert result.converged
        assert np.linalg.norm(result.q - q_seed) <= 1.5 * np.linalg.norm(q - q_seed)


@BACKEND
def test_the_number_of_steps_is_bounded_and_counted(arm: Arm, backend: str) -> None:
    target = shifted(arm.pose(arm.home), np.array([0.1, 0.1, -0.1]))
    full = QpIk(backend=backend).solve(arm, target, arm.home)
    assert full.converged
    assert full.iterations >= 2
    for count in range(full.iterations + 2):
        result = QpIk(backend=backend, max_iterations=count).solve(arm, target, arm.home)
        assert result.iterations == min(count, full.iterations)
        assert result.converged == (count >= full.iterations)


@pytest.mark.parametrize("tolerance", [Tolerance(position=1e-3), Tolerance(orientation=1e-2)])
def test_both_errors_count(arm: Arm, tolerance: Tolerance) -> None:
    target = turned(shifted(arm.pose(arm.home), np.array([0.1, 0.1, -0.1])), 1, 0.3)
    result = QpIk(tolerance=tolerance).solve(arm, target, arm.home)
    assert result.converged
    assert result.position_error <= tolerance.position
    assert result.orientation_error <= tolerance.orientation


def test_near_the_end_it_converges_quadratically(arm: Arm, plain: PlainArm) -> None:
    target = shifted(arm.pose(arm.home), np.array([0.03, 0.03, -0.03]))
    errors = []
    for count in range(4):
        tight = QpIk(max_iterations=count, tolerance=Tolerance(position=1e-9, orientation=1e-9))
        q = tight.solve(arm, target, arm.home).q
        errors.append(max(plain.errors(q, target)))
    assert errors[-1] < 1e-8
    assert all(b < 50.0 * a**2 for a, b in pairwise(errors))


def test_settings_of_one_solver_do_not_leak_into_another(arm: Arm) -> None:
    target = shifted(arm.pose(arm.home), np.array([0.1, 0.1, -0.1]))
    calm = QpIk(max_iterations=1, lm_damping=10.0)
    first = calm.solve(arm, target, arm.home).q
    quick = QpIk(max_iterations=1).solve(arm, target, arm.home).q
    assert np.linalg.norm(first - arm.home) < 0.5 * np.linalg.norm(quick - arm.home)
    assert calm.solve(arm, target, arm.home).q.tolist() == first.tolist()


def test_it_reaches_four_fifths_of_all_targets_from_home(arm: Arm, plain: PlainArm) -> None:
    rng = np.random.default_rng(5)
    targets = [arm.pose(rng.uniform(plain.q_min, plain.q_max)) for _ in range(150)]
    results = [QpIk().solve(arm, target, arm.home) for target in targets]
    assert sum(result.converged for result in results) >= 0.8 * len(targets)
    assert {result.reason for result in results} <= {None, Reason.NOT_CONVERGED}


@pytest.mark.parametrize("name", ["", "gurobi", "DAQP", "nosuch"])
def test_another_backend_is_refused_and_the_known_ones_listed(name: str) -> None:
    message = rf"No QP solver is called '{name}'; known: {', '.join(BACKENDS)}\."
    with pytest.raises(UnknownNameError, match=message):
        QpIk(backend=name)
