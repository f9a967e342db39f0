"""Small dense QPs with bounds and inequalities, behind one interface to several QP solvers."""

from contextlib import AbstractContextManager, nullcontext
from typing import Any, Protocol
from warnings import catch_warnings

import daqp
import numpy as np
import osqp
import qpsolvers
from numpy.typing import NDArray
from qpsolvers.warnings import SparseConversionWarning
from scipy.sparse import csc_matrix

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import UnknownNameError

_RHO = 0.1
"""OSQP's default initial step size."""
_ENDLESS = 1e30
"""DAQP's value of infinity."""
_EXACT = 1e-9
"""By how much DAQP may leave a bound, its own default being 1e-6: a step within the joint limits is
wrong by as much and more."""
OSQP_SETTINGS: dict[str, Any] = {
    "rho": _RHO,
    # The default accuracy of 1e-3 leaves steps that are wrong by as much.
    "eps_abs": 1e-9,
    "eps_rel": 1e-9,
    "max_iter": 4000,
    # Nothing may be left of the problem before, or answers would depend on it; the step size
    # adapts by iterations, not by time.
    "scaling": 0,
    "warm_starting": False,
    "adaptive_rho": 1,
}
"""Settings of OSQP for steps that are exact and repeat to the bit."""
_SETTINGS: dict[str, dict[str, Any]] = {"osqp": OSQP_SETTINGS, "daqp": {"primal_tol": _EXACT}}
_OSQP_STEPS = (
    osqp.SolverStatus.OSQP_SOLVED,
    osqp.SolverStatus.OSQP_SOLVED_INACCURATE,
    osqp.SolverStatus.OSQP_MAX_ITER_REACHED,
)
"""OSQP's states that come with a usable step, also one of reduced accuracy; in other states the
returned numbers are no solution."""


class BoxQp(Protocol):
    """QP solver: min over x of ½ xᵀ H x + fᵀ x subject to low <= x <= high and A x <= upper."""

    def solve(
        self,
        H: Matrix,
        f: Vector,
        low: Vector,
        high: Vector,
        A: Matrix | None = None,
        upper: Vector | None = None,
    ) -> Vector | None:
        """Return the minimiser, which meets its bounds up to rounding errors.

        Args:
            H: Positive definite matrix (n, n).
            f: Vector (n,).
            low: Lower bounds (n,).
            high: Upper bounds (n,), nowhere below `low`.
            A: Further rows (m, n).
            upper: Their upper bounds (m,).

        Returns:
            x of shape (n,), or None where the solver found none.
        """
        ...


class _Daqp:
    """DAQP, a dual active-set method that is exact in a finite number of steps.

    Arnström, Bemporad and Axehill, "A dual active-set solver for embedded quadratic
    programming using recursive LDLᵀ updates", 2022.
    """

    def __init__(self, n: int) -> None:
        self._no_rows = np.zeros((0, n))
        self._plain: NDArray[np.int32] = np.zeros(n, dtype=np.int32)
        self._any: NDArray[np.int32] = np.zeros(n, dtype=np.int32)
        self._free: Vector = np.zeros(0)

    def solve(
        self,
        H: Matrix,
        f: Vector,
        low: Vector,
        high: Vector,
        A: Matrix | None = None,
        upper: Vector | None = None,
    ) -> Vector | None:
        if A is None or upper is None:
            x, _, flag, _ = daqp.solve(
                H, f, self._no_rows, high, low, self._plain, primal_tol=_EXACT
            )
        else:
            above = np.concatenate([high, upper])
            if len(upper) > len(self._free):
                self._free = np.full(2 * len(upper), -_ENDLESS)
                self._any = np.zeros(len(low) + 2 * len(upper), dtype=np.int32)
            below = np.concatenate([low, self._free[: len(upper)]])
            x, _, flag, _ = daqp.solve(H, f, A, above, below, self._any[: len(above)])
        return x if flag >= 1 else None


class _Osqp:
    """OSQP, an operator-splitting method with a polished solution (Stellato et al., "OSQP", 2020).

    The problem is set up once and its numbers are updated. Extra rows change its shape, so a
    problem with extra rows is set up anew.
    """

    def __init__(self, n: int) -> None:
        self._n = n
        self._upper_part = np.triu_indices(n)
        self._by_column = np.lexsort(self._upper_part)
        self._problem = osqp.OSQP()
        free = np.full(n, 1.0)
        dense = csc_matrix(np.triu(np.ones((n, n))) + n * np.eye(n))
        self._problem.setup(
            dense, np.zeros(n), csc_matrix(np.eye(n)), -free, free, verbose=False, **OSQP_SETTINGS
        )

    def solve(
        self,
        H: Matrix,
        f: Vector,
        low: Vector,
        high: Vector,
        A: Matrix | None = None,
        upper: Vector | None = None,
    ) -> Vector | None:
        if A is None or upper is None:
            problem = self._problem
            problem.update_settings(rho=_RHO)
            problem.update(Px=H[self._upper_part][self._by_column], q=f, l=low, u=high)
        else:
            problem = osqp.OSQP()
            rows = csc_matrix(np.vstack([np.eye(self._n), A]))
            below = np.concatenate([low, np.full(len(upper), -np.inf)])
            above = np.concatenate([high, upper])
            problem.setup(
                csc_matrix(np.triu(H)), f, rows, below, above, verbose=False, **OSQP_SETTINGS
            )
        result = problem.solve(raise_error=False)
        x: Vector = result.x
        if result.info.status_val not in _OSQP_STEPS or not np.isfinite(x).all():
            return None
        return np.minimum(np.maximum(x, low), high)


class _Qpsolvers:
    """Any other installed QP solver, called through qpsolvers at some extra cost."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._sparse = name not in qpsolvers.dense_solvers

    def solve(
        self,
        H: Matrix,
        f: Vector,
        low: Vector,
        high: Vector,
        A: Matrix | None = None,
        upper: Vector | None = None,
    ) -> Vector | None:
        problem = qpsolvers.Problem(H, f, A, upper, None, None, low, high)
        if self._sparse:
            problem.P = csc_matrix(problem.P)
            problem.G = None if A is None else csc_matrix(A)
        solution = qpsolvers.solve_problem(problem, solver=self._name)
        x: Vector | None = solution.x
        if not solution.found or x is None or not np.isfinite(x).all():
            return None
        return np.minimum(np.maximum(x, low), high)


def backends() -> tuple[str, ...]:
    """Return the names of the QP solvers that can be chosen, those called directly first."""
    direct = ("daqp", "osqp")
    return (*direct, *(name for name in qpsolvers.available_solvers if name not in direct))


def check_backend(backend: str) -> None:
    """Check the name of a QP solver.

    Raises:
        UnknownNameError: `backend` is not one of `backends()`.
    """
    if backend not in backends():
        raise UnknownNameError("QP solver", backend, backends())


def dense_call(backend: str) -> AbstractContextManager[object]:
    """Return a context in which qpsolvers takes dense matrices for a QP solver without warning."""
    if backend in qpsolvers.dense_solvers:
        return nullcontext()
    return catch_warnings(action="ignore", category=SparseConversionWarning)


def settings_of(backend: str) -> dict[str, Any]:
    """Return the arguments by which qpsolvers takes a QP solver and its settings."""
    return {"solver": backend, **_SETTINGS.get(backend, {})}


def solved(backend: str, P: Matrix, q: Vector, G: Matrix | None, h: Vector | None) -> Vector | None:
    """Return the minimiser of ½ xᵀ P x + qᵀ x subject to G x <= h; None where there is none."""
    with dense_call(backend):
        found = qpsolvers.solve_problem(qpsolvers.Problem(P, q, G, h), **settings_of(backend))
    x: Vector | None = found.x
    return x if found.found and x is not None and np.isfinite(x).all() else None


def box_qp(backend: str, n: int) -> BoxQp:
    """Return a QP solver of that name for n unknowns, with memory of its own.

    Raises:
        UnknownNameError: `backend` is not one of `backends()`.
    """
    check_backend(backend)
    if backend == "daqp":
        return _Daqp(n)
    return _Osqp(n) if backend == "osqp" else _Qpsolvers(backend)
