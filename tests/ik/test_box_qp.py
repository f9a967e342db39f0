"""Every QP back end against brute force over active sets, scipy, and the KKT conditions."""

from itertools import product
from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import UnknownNameError
from robo47_qp.ik import box_qp as module
from robo47_qp.ik.box_qp import BoxQp, backends, box_qp

# The way through qpsolvers is for solvers that need not be installed: here it leads to the
# dense and the sparse one that are.
EVERY = pytest.mark.parametrize(
    "name",
    [*backends(), "qpsolvers daqp", "qpsolvers osqp"],
    ids=lambda name: name.replace(" ", "-"),
)
CLOSE = 1e-6
"""How far answers may be off; steps of a search are a thousand times larger."""
LOOSE = {"qpsolvers osqp": 1e-2}
"""The same for a solver at its own default accuracy."""
pytestmark = pytest.mark.filterwarnings("ignore:OSQP exited with status")


class Problem(NamedTuple):
    H: Matrix
    f: Vector
    low: Vector
    high: Vector
    A: Matrix | None = None
    upper: Vector | None = None

    def value(self, x: Vector) -> float:
        return float(0.5 * x @ self.H @ x + self.f @ x)


def qp(name: str, n: int) -> BoxQp:
    way, _, through = name.partition(" ")
    return module._Qpsolvers(through) if through else box_qp(way, n)


def drawn(rng: np.random.Generator, n: int, rows: int = 0) -> Problem:
    """A problem whose bounds are partly active; with rows, one that has an answer."""
    root = rng.normal(size=(n + 1, n))
    H = root.T @ root + 0.05 * np.eye(n)
    centre, width = 0.3 * rng.normal(size=n), rng.uniform(0.0, 1.0, n)
    width[rng.random(n) < 0.15] = 0.0
    problem = Problem(H, rng.normal(size=n), centre - width, centre + width)
    if rows == 0:
        return problem
    A = rng.normal(size=(rows, n))
    inside = rng.uniform(problem.low, problem.high)
    return problem._replace(A=A, upper=A @ inside + rng.uniform(0.0, 0.3, rows))


def by_force(problem: Problem) -> Vector:
    """The best feasible one of the minimisers under every choice of active bounds and rows."""
    H, f, low, high = problem[:4]
    n = len(f)
    A = np.zeros((0, n)) if problem.A is None else problem.A
    upper = np.zeros(0) if problem.upper is None else problem.upper
    best, least = np.full(n, np.nan), np.inf
    for choice in product(range(3), repeat=n):
        for active in product((False, True), repeat=len(A)):
            fixed = np.flatnonzero(choice)
            C = np.vstack([np.eye(n)[fixed], A[list(active)]])
            ends = np.array([low[i] if choice[i] == 1 else high[i] for i in fixed])
            d = np.concatenate([ends, upper[list(active)]])
            if len(C) > n or np.linalg.matrix_rank(C) < len(C):
                continue
            m = len(C)
            kkt = np.block([[H, C.T], [C, np.zeros((m, m))]])
            x = np.linalg.solve(kkt, np.concatenate([-f, d]))[:n]
            inside = (x >= low - 1e-9).all() and (x <= high + 1e-9).all()
            if inside and (A @ x <= upper + 1e-9).all() and problem.value(x) < least:
                best, least = x, problem.value(x)
    return best


def close(name: str) -> float:
    return LOOSE.get(name, CLOSE)


def check_kkt(problem: Problem, x: Vector, off: float = CLOSE) -> None:
    """Feasible, and the slope of the objective is pushed back by what is active alone."""
    assert (x >= problem.low - 1e-9).all()
    assert (x <= problem.high + 1e-9).all()
    slope = problem.H @ x + problem.f
    normals, eye = [], np.eye(len(x))
    for i in range(len(x)):
        if x[i] <= problem.low[i] + off:
            normals.append(-eye[i])
        if x[i] >= problem.high[i] - off:
            normals.append(eye[i])
    if problem.A is not None and problem.upper is not None:
        room = problem.upper - problem.A @ x
        assert (room >= -off).all()
        normals.extend(problem.A[room <= off])
    left = slope
    if normals:
        N = np.array(normals).T
        pushes = lsq_linear(N, -slope, (0.0, np.inf), method="bvls", tol=1e-14).x
        left = slope + N @ pushes
    assert np.abs(left).max() < 10.0 * off


def solved(name: str, problem: Problem) -> Vector:
    x = qp(name, len(problem.f)).solve(*problem)
    assert x is not None
    return np.array(x)


@EVERY
@pytest.mark.parametrize("rows", [0, 1, 2])
def test_it_is_the_best_of_all_active_sets(name: str, rows: int, rng: np.random.Generator) -> None:
    for _ in range(8):
        problem = drawn(rng, 3, rows)
        assert solved(name, problem) == pytest.approx(by_force(problem), abs=close(name))


@EVERY
def test_in_a_box_it_is_bounded_least_squares(name: str, rng: np.random.Generator) -> None:
    touched = 0
    for _ in range(25):
        root, b = rng.normal(size=(9, 7)), rng.normal(size=9)
        low, high = -rng.uniform(0.01, 0.5, 7), rng.uniform(0.01, 0.5, 7)
        expected = lsq_linear(root, b, (low, high), method="bvls", tol=1e-14).x
        problem = Problem(root.T @ root, -root.T @ b, low, high)
        assert solved(name, problem) == pytest.approx(expected, abs=close(name))
        touched += int(((expected == low) | (expected == high)).sum())
    assert touched > 25


@EVERY
@pytest.mark.parametrize("rows", [0, 5])
def test_it_meets_the_optimality_conditions(name: str, rows: int, rng: np.random.Generator) -> None:
    for _ in range(25):
        problem = drawn(rng, 7, rows)
        check_kkt(problem, solved(name, problem), close(name))


@EVERY
@pytest.mark.parametrize("rows", [0, 1])
def test_a_box_without_width_is_its_own_answer(
    name: str, rows: int, rng: np.random.Generator
) -> None:
    problem = drawn(rng, 6)
    only = rng.normal(size=6)
    problem = problem._replace(low=only, high=only.copy())
    if rows:
        A = rng.normal(size=(1, 6))
        problem = problem._replace(A=A, upper=A @ only + 0.1)
    assert solved(name, problem) == pytest.approx(only, abs=1e-12)


@EVERY
def test_bounds_may_be_infinite(name: str, rng: np.random.Generator) -> None:
    problem = drawn(rng, 5)
    free = np.full(5, np.inf)
    expected = np.linalg.solve(problem.H, -problem.f)
    wide = problem._replace(low=-free, high=free)
    assert solved(name, wide) == pytest.approx(expected, abs=close(name))
    half = wide._replace(low=np.where(np.arange(5) == 2, expected + 0.3, -np.inf))
    assert solved(name, half)[2] == pytest.approx(expected[2] + 0.3, abs=close(name))
    check_kkt(half, solved(name, half), close(name))


@EVERY
def test_rows_that_nothing_meets_have_no_answer(name: str, rng: np.random.Generator) -> None:
    problem = drawn(rng, 4)
    A = rng.normal(size=(1, 4))
    reach = float(np.minimum(A * problem.low, A * problem.high).sum())
    outside = problem._replace(A=A, upper=np.array([reach - 0.1]))
    assert qp(name, 4).solve(*outside) is None
    opposed = problem._replace(A=np.vstack([A, -A]), upper=np.array([-1.0, -1.0]))
    assert qp(name, 4).solve(*opposed) is None
    # And what comes after is not the worse for it.
    assert solved(name, problem) == pytest.approx(solved("daqp", problem), abs=close(name))
    barely = problem._replace(A=A, upper=np.array([reach + 0.1]))
    check_kkt(barely, solved(name, barely), close(name))


@EVERY
def test_a_row_that_does_not_bind_changes_nothing(name: str, rng: np.random.Generator) -> None:
    problem = drawn(rng, 5)
    A = rng.normal(size=(2, 5))
    idle = problem._replace(A=A, upper=np.array([50.0, 50.0]))
    assert solved(name, idle) == pytest.approx(solved(name, problem), abs=close(name))


@EVERY
@pytest.mark.parametrize("rows", [0, 3])
def test_an_answer_does_not_depend_on_the_question_before(
    name: str, rows: int, rng: np.random.Generator
) -> None:
    """To the bit, whatever came in between: another scale, rows, or nothing to be found."""
    problem = drawn(rng, 6, rows)
    first = solved(name, problem)
    steep = drawn(rng, 6)
    for scale in (1e-4, 1e4):
        solved(name, steep._replace(H=scale * steep.H))
        assert solved(name, problem).tobytes() == first.tobytes()
    solved(name, drawn(rng, 6, 2))
    assert solved(name, problem).tobytes() == first.tobytes()
    never = steep._replace(A=np.zeros((1, 6)), upper=np.array([-1.0]))
    assert qp(name, 6).solve(*never) is None
    assert solved(name, problem).tobytes() == first.tobytes()


def test_osqp_is_not_changed_by_a_question_too_hard_for_it(rng: np.random.Generator) -> None:
    problem = drawn(rng, 6)
    first = solved("osqp", problem)
    scales = np.logspace(-6, 6, 6)
    hard = drawn(rng, 6)
    x = box_qp("osqp", 6).solve(hard.H * np.outer(scales, scales), *hard[1:])
    assert x is None or ((x >= hard.low).all() and (x <= hard.high).all())
    assert solved("osqp", problem).tobytes() == first.tobytes()


@EVERY
@pytest.mark.parametrize("rows", [0, 3])
def test_questions_are_left_alone_and_answers_kept(
    name: str, rows: int, rng: np.random.Generator
) -> None:
    problem, other = drawn(rng, 5, rows), drawn(rng, 5, rows)
    before = [None if part is None else part.copy() for part in problem]
    x = qp(name, 5).solve(*problem)
    assert x is not None
    kept = x.copy()
    solved(name, other)
    assert x.tolist() == kept.tolist()
    for part, old in zip(problem, before, strict=True):
        assert (part is None) == (old is None)
        if part is not None and old is not None:
            assert part.tolist() == old.tolist()


@EVERY
def test_the_layout_of_matrices_does_not_matter(name: str, rng: np.random.Generator) -> None:
    problem = drawn(rng, 5, 3)
    assert problem.A is not None
    turned = problem._replace(A=np.asfortranarray(problem.A), H=np.asfortranarray(problem.H))
    assert solved(name, turned) == pytest.approx(solved(name, problem), abs=1e-12)


@pytest.mark.parametrize("name", ["osqp", "qpsolvers daqp", "qpsolvers osqp"])
def test_answers_of_iterative_solvers_are_inside_to_the_bit(
    name: str, rng: np.random.Generator
) -> None:
    for _ in range(20):
        problem = drawn(rng, 7)
        x = solved(name, problem)
        assert (x >= problem.low).all()
        assert (x <= problem.high).all()


@pytest.mark.parametrize("name", backends())
def test_each_solver_has_memory_of_its_own(name: str) -> None:
    rng = np.random.default_rng(13)
    one, other = box_qp(name, 4), box_qp(name, 4)
    first, second = drawn(rng, 4, rows=3), drawn(rng, 4)
    x = one.solve(*first)
    assert x is not None
    before = x.tobytes()
    other.solve(*second)
    assert x.tobytes() == before
    again = one.solve(*first)
    assert again is not None
    assert again.tobytes() == before


def test_the_two_that_are_called_directly_come_first() -> None:
    assert backends()[:2] == ("daqp", "osqp")
    assert len(set(backends())) == len(backends())


@pytest.mark.parametrize("name", ["", "gurobi", "DAQP", "daqp "])
def test_another_name_is_refused_and_the_known_ones_are_listed(name: str) -> None:
    known = ", ".join(backends())
    with pytest.raises(
        UnknownNameError, match=rf"^No QP solver is called '{name}'; known: {known}\.$"
    ):
        box_qp(name, 3)
