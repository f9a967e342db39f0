"""Strict priorities: each level moves only in the freedom that the levels before it leave."""

from collections.abc import Sequence

import mink
import numpy as np
from mink.tasks import BaseTask

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.ik.box_qp import solved

_NULL = 1e-9
"""Singular values below this share of the largest are none."""
_FLOOR = 1e-9
"""Damping of a level, as a share of its largest curvature."""


def weighted_jacobian(configuration: mink.Configuration, task: BaseTask) -> Matrix:
    """Return W with WᵀW the Hessian of a task, its damping aside (k, nv)."""
    residual = task.compute_qp_residual(configuration)
    if residual is not None:
        return residual[0]
    curvature, axes = np.linalg.eigh(task.compute_qp_objective(configuration).H)
    W: Matrix = np.sqrt(np.maximum(curvature, 0.0))[:, None] * axes.T
    return W


def null_space(A: Matrix) -> Matrix:
    """Return an orthonormal basis of the null space of A (k, n), as columns (n, m)."""
    _, sizes, axes = np.linalg.svd(A)
    rank = int((sizes > _NULL * max(sizes.max(initial=0.0), np.finfo(float).tiny)).sum())
    basis: Matrix = axes[rank:].T
    return basis


def in_freedom(
    configuration: mink.Configuration,
    dq: Vector,
    freedom: Matrix,
    levels: Sequence[Sequence[BaseTask]],
    limits: Sequence[mink.Limit],
    backend: str,
) -> Vector:
    """Return a step with what each level adds to it in the freedom left (nv,).

    Level after level min over y of the level's QP of mink at dq + Z y, within the limits, Z the
    null space of all weighted Jacobians before. No motion is always allowed, so there is always
    an answer (Escande, Mansard and Wieber, "Hierarchical quadratic programming", 2014).

    Args:
        configuration: Where the step starts.
        dq: The step of the levels before (nv,).
        freedom: Basis of the motions that they leave free (nv, m).
        levels: Tasks, the most important level first.
        limits: Limits that hold for the whole step.
        backend: QP solver.
    """
    for tasks in levels:
        if freedom.shape[1] == 0:
            break
        problem = mink.build_ik(configuration, tasks, 1.0, limits=limits)
        P = freedom.T @ problem.P @ freedom
        P += (_FLOOR * max(float(P.diagonal().max()), _FLOOR)) * np.eye(len(P))
        q = freedom.T @ (problem.q + problem.P @ dq)
        G = h = None
        if problem.G is not None and problem.h is not None:
            G, h = problem.G @ freedom, np.maximum(problem.h - problem.G @ dq, 0.0)
        y = solved(backend, P, q, G, h)
        if y is not None:
            dq = dq + freedom @ y
        W = np.vstack([weighted_jacobian(configuration, task) for task in tasks])
        freedom = freedom @ null_space(W @ freedom)
    return dq
