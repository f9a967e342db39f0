"""The loop that LM and QP share: linearise, solve a QP inside the joint limits, step."""

from math import sqrt
from typing import Protocol

import numpy as np
from mink import SE3

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.ik.avoidance import Avoidance, DistanceRows
from robo47_qp.ik.box_qp import BoxQp
from robo47_qp.ik.settings import Stall
from robo47_qp.ik.solver import Tolerance
from robo47_qp.ik.tool_error import ToolError
from robo47_qp.model.arm import Arm

_ROUNDING = 100.0
"""Beyond so many times the tolerance, squared, an end is no answer whatever rounding does: QP
solvers leave the limits by as much as a tolerance of theirs, and answers are put back."""


class Objective(Protocol):
    """What a step minimises: ½ dqᵀ H dq + fᵀ dq, to second order."""

    def expand(
        self, error: ToolError, squared_error: float, q: Vector, q_seed: Vector
    ) -> tuple[Matrix, Vector]:
        """H (n, n), positive definite, and f (n,) at q; valid until the next call."""
        ...


class Descent:
    """Memory of the searches on one arm; `q` is where the last one ended."""

    def __init__(
        self, arm: Arm, objective: Objective, qp: BoxQp, *, limited: bool = True, rows: int = 6
    ) -> None:
        """Make the memory for an arm.

        Args:
            arm: The arm.
            objective: What a step minimises.
            qp: What solves for a step.
            limited: False lets joints leave their limits.
            rows: 3 where the position alone counts, 6 for the pose.
        """
        everywhere = np.full(arm.n, np.inf)
        self._q_min = arm.q_min if limited else -everywhere
        self._q_max = arm.q_max if limited else everywhere
        self._turns = rows == 6
        self._expand, self._qp = objective.expand, qp
        self._error = ToolError(arm)
        self._low, self._high = np.empty(arm.n), np.empty(arm.n)
        self.q: Vector = np.empty(arm.n)
        self.error = np.inf
        """Distance and angle that were left at the last look [m + rad]."""
        self.missed = True
        """True where more was left than rounding at the limits explains."""

    def run(
        self,
        T_world_target: SE3,
        q_seed: Vector,
        tolerance: Tolerance,
        max_iterations: int,
        stall: Stall | None,
        avoidance: Avoidance | None = None,
    ) -> int:
        """Search from the point inside the limits that is closest to q_seed.

        With `avoidance`, steps keep its rows, and the search ends clear of everything.

        Returns:
            The number of steps.
        """
        error, q, low, high = self._error, self.q, self._low, self._high
        q_min, q_max, expand, solve = self._q_min, self._q_max, self._expand, self._qp.solve
        distance2 = angle2 = np.inf
        error.set_target(T_world_target)
        np.maximum(q_seed, q_min, out=q)
        np.minimum(q, q_max, out=q)
        close = tolerance.position**2
        aligned = tolerance.orientation**2 if self._turns else np.inf
        history: list[float] = []
        for iteration in range(max_iterations + 1):
            distance2, angle2 = error.move(q)
            reached = distance2 <= close and angle2 <= aligned
            if reached and (avoidance is None or avoidance.kept(q)):
                break
            squared_error = distance2 + angle2 if self._turns else distance2
            if stall is not None and not reached:
                history.append(squared_error)
                if stall.stuck(history):
                    break
            if iteration == max_iterations:
                break
            error.update_jacobian()
            H, f = expand(error, squared_error, q, q_seed)
            np.subtract(q_min, q, low)
            np.subtract(q_max, q, high)
            if avoidance is None:
                dq = solve(H, f, low, high)
            else:
                dq = self._step(H, f, avoidance.rows(q))
            if dq is None:
                break
            q += dq
        # QP solvers meet bounds but for rounding; answers meet them exactly.
        np.maximum(q, q_min, out=q)
        np.minimum(q, q_max, out=q)
        self.error = sqrt(distance2) + sqrt(angle2)
        self.missed = distance2 > _ROUNDING * close or angle2 > _ROUNDING * aligned
        return iteration

    def _step(self, H: Matrix, f: Vector, rows: DistanceRows) -> Vector | None:
        """The step within the bounds and the rows.

        Bounds and rows together may leave no step where pairs have to part. Then the parting
        gives way, and the rows only keep what distance there is: no step at all does that.
        """
        low, high = self._low, self._high
        if len(rows.upper) == 0:
            return self._qp.solve(H, f, low, high)
        dq = self._qp.solve(H, f, low, high, rows.A, rows.upper)
        if dq is None and rows.upper.min() < 0.0:
            dq = self._qp.solve(H, f, low, high, rows.A, np.maximum(rows.upper, 0.0))
        return dq
