"""Restarts around any IK solver."""

from dataclasses import dataclass, replace
from functools import lru_cache
from time import process_time

import numpy as np
from mink import SE3

from robo47_qp.arm import Arm
from robo47_qp.arrays import Matrix, Vector
from robo47_qp.ik.solver import IkResult, IkSolver, Reason, Tolerance


@dataclass(frozen=True, kw_only=True)
class MultiStart:
    """Try the seed, then configurations spread evenly over the joint limits.

    The starts are an additive recurrence, x_k = frac(½ + k α) with α_i = φ⁻ⁱ and φ the
    positive root of x^(n+1) = x + 1: the same for every call, evenly spread, no random
    numbers (Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018).
    """

    solver: IkSolver
    """What runs from each start."""
    max_restarts: int = 50
    """Starts after the seed before giving up."""

    @property
    def tolerance(self) -> Tolerance:
        """How close counts as reached."""
        return self.solver.tolerance

    def solve(self, arm: Arm, T_world_target: SE3, q_seed: Vector) -> IkResult:
        """See `IkSolver.solve`; the best of all starts where none reaches the target."""
        started = process_time()
        best = self.solver.solve(arm, T_world_target, q_seed)
        iterations, restarts = best.iterations, 0
        hopeless = (None, Reason.INVALID_TARGET, Reason.OUT_OF_REACH)
        while best.reason not in hopeless and restarts < self.max_restarts:
            q_start = _starts(arm, self.max_restarts)[restarts].copy()
            result = self.solver.solve(arm, T_world_target, q_start)
            iterations += result.iterations
            restarts += 1
            if _rank(result) < _rank(best):
                best = result
        seconds = process_time() - started
        return replace(best, iterations=iterations, restarts=restarts, seconds=seconds)


def _rank(result: IkResult) -> tuple[bool, float]:
    return not result.converged, result.position_error + result.orientation_error


@lru_cache(maxsize=16)
def _starts(arm: Arm, count: int) -> Matrix:
    """Configurations of shape (count, n)."""
    root = 2.0
    for _ in range(64):
        root = (1.0 + root) ** (1.0 / (arm.n + 1))
    alpha = root ** -np.arange(1.0, arm.n + 1)
    unit = np.mod(0.5 + np.arange(1, count + 1)[:, None] * alpha, 1.0)
    return arm.q_min + unit * (arm.q_max - arm.q_min)
