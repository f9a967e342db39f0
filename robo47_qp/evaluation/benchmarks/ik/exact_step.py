"""One step of inverse kinematics without rounding: mink's QP within joint limits, in 50 digits."""

from collections.abc import Sequence
from decimal import Decimal, localcontext

import mink
import numpy as np
from mink.tasks import BaseTask

from robo47_qp.arrays import Matrix, Vector

_DIGITS = 50
_CLOSE = 1e-5
"""Within this of a bound a joint is first taken to be on it [rad]; the sign of its multiplier
decides."""
_ZERO = Decimal(0)
_Rows = list[list[Decimal]]


def exact_step(
    configuration: mink.Configuration,
    tasks: Sequence[BaseTask],
    damping: float,
    low: Vector,
    high: Vector,
    near: Vector,
) -> Vector:
    """Return the minimiser of mink's objective between bounds, rounded once, at its end.

    The objective is made of the residuals of the tasks, before doubles multiply them:
    ½ Σ ‖W dq - e‖² + ½ (damping + Σ μ) ‖dq‖². Its minimum is found by active sets; it is the one
    minimum, for the objective is strictly convex and the signs of all multipliers are checked.

    Args:
        configuration: Where the step starts.
        tasks: Tasks with a residual (`mink.BaseTask.compute_qp_residual`).
        damping: That of all joints, above 0.
        low: Lower bounds of the step (n,) [rad].
        high: Upper bounds (n,) [rad].
        near: A step that is roughly right (n,) [rad].
    """
    with localcontext() as context:
        context.prec = _DIGITS
        residuals = [task.compute_qp_residual(configuration) for task in tasks]
        found = [residual for residual in residuals if residual is not None]
        W = _decimals(np.vstack([W for W, _, _ in found]))
        e = _decimals(np.concatenate([e for _, e, _ in found])[:, None])
        diagonal = Decimal(damping) + sum((Decimal(float(mu)) for _, _, mu in found), _ZERO)
        columns = list(zip(*W, strict=True))
        H = [[_dot(a, b) for b in columns] for a in columns]
        for i in range(len(H)):
            H[i][i] += diagonal
        g = [_dot(column, [row[0] for row in e]) for column in columns]
        bounds = [(Decimal(float(a)), Decimal(float(b))) for a, b in zip(low, high, strict=True)]
        on = dict.fromkeys(np.flatnonzero(near <= low + _CLOSE).tolist(), 0)
        on |= dict.fromkeys(np.flatnonzero(near >= high - _CLOSE).tolist(), 1)
        return np.array([float(x) for x in _minimum(H, g, bounds, on)])


def _minimum(
    H: _Rows, g: list[Decimal], bounds: list[tuple[Decimal, Decimal]], on: dict[int, int]
) -> list[Decimal]:
    """Return x of least ½ xᵀ H x - gᵀ x between bounds; `on`: the ends that hold joints."""
    while True:
        x = _held(H, g, {i: bounds[i][end] for i, end in on.items()})
        beyond = {
            i: max(bounds[i][0] - x[i], x[i] - bounds[i][1]) for i in range(len(x)) if i not in on
        }
        worst = max(beyond, key=lambda i: beyond[i], default=None)
        if worst is not None and beyond[worst] > 0:
            on[worst] = 0 if x[worst] < bounds[worst][0] else 1
            continue
        # The pull of the objective at a bound must be outwards.
        pull = {i: (g[i] - _dot(H[i], x)) * (1 if end else -1) for i, end in on.items()}
        worst = min(pull, key=lambda i: pull[i], default=None)
        if worst is None or pull[worst] >= 0:
            return x
        del on[worst]


def _held(H: _Rows, g: list[Decimal], held: dict[int, Decimal]) -> list[Decimal]:
    """Return the minimum with some coordinates held, by elimination."""
    free = [i for i in range(len(g)) if i not in held]
    rows = [
        [*(H[i][j] for j in free), g[i] - sum((H[i][k] * v for k, v in held.items()), _ZERO)]
        for i in free
    ]
    m = len(free)
    for c in range(m):
        for r in range(c + 1, m):
            factor = rows[r][c] / rows[c][c]
            rows[r] = [a - factor * b for a, b in zip(rows[r], rows[c], strict=True)]
    x = dict(held)
    for c in reversed(range(m)):
        known = sum((rows[c][k] * x[free[k]] for k in range(c + 1, m)), _ZERO)
        x[free[c]] = (rows[c][m] - known) / rows[c][c]
    return [x[i] for i in range(len(g))]


def _decimals(A: Matrix) -> _Rows:
    return [[Decimal(x) for x in row] for row in A.tolist()]


def _dot(a: Sequence[Decimal], b: Sequence[Decimal]) -> Decimal:
    return sum((x * y for x, y in zip(a, b, strict=True)), _ZERO)
