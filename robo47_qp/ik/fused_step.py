"""Steps of the fused solvers: one small QP, written and solved in place."""

from typing import NamedTuple, Protocol

import numpy as np
from mujoco import mju_addToScl

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.ik.avoidance import DistanceRows
from robo47_qp.ik.box_qp import BoxQp
from robo47_qp.ik.gauss_newton import FLOOR
from robo47_qp.ik.refinement import ILL_CONDITIONED, refined, within
from robo47_qp.ik.tool_demand import FULL, ToolDemand
from robo47_qp.ik.tool_error import ToolError, error_to
from robo47_qp.model.arm import Arm
from robo47_qp.model.tool_poses import Target


class Linearised(NamedTuple):
    """½ ‖J dq - e‖² + ½ λ ‖dq‖² + ½ w ‖dq - (q_seed - q)‖², what a step dq minimises."""

    e: Vector
    """Residual (rows,)."""
    J: Matrix
    """How it falls per joint (rows, n)."""
    damping: float
    """λ + w."""
    posture: float = 0.0
    """w."""


class FusedObjective(Protocol):
    """What a step minimises."""

    def linearised(self, error: ToolError, squared_error: float) -> Linearised:
        """Return the objective about the configuration of `error`; valid until the next call."""
        ...


class FusedStepper:
    """Memory of the steps on one arm; see `gauss_newton.Stepper`."""

    def __init__(
        self,
        arm: Arm,
        objective: FusedObjective,
        qp: BoxQp,
        *,
        tools: tuple[int, ...] = (0,),
        limited: bool = True,
        demand: ToolDemand = FULL,
    ) -> None:
        """Make the memory for an arm.

        Args:
            arm: The arm.
            objective: What a step minimises.
            qp: What solves for a step.
            tools: The tools that targets are for, by their places among the robot's.
            limited: False lets joints leave their limits.
            demand: What of the poses counts.
        """
        n, everywhere = arm.n, np.full(arm.n, np.inf)
        self._q_min = arm.q_min if limited else -everywhere
        self._q_max = arm.q_max if limited else everywhere
        self._objective, self._qp = objective, qp
        self._error = error_to(arm, tools, None, demand)
        self._q_seed = arm.home
        self._low, self._high = np.empty(n), np.empty(n)
        self._H, self._f, self._lean = np.empty((n, n)), np.empty(n), np.empty(n)
        self._diagonal = self._H.reshape(-1)[:: n + 1]
        self._at, self._damping = Linearised(np.zeros(0), np.zeros((0, n)), 0.0), 0.0

    def aim(self, T_world_target: Target, q_seed: Vector) -> None:
        """See `Stepper.aim`."""
        self._error.set_target(T_world_target)
        self._q_seed = q_seed

    def move(self, q: Vector) -> tuple[float, float, float]:
        """See `Stepper.move`."""
        distance2, angle2 = self._error.move(q)
        return distance2, angle2, 0.0

    def step(self, q: Vector, squared_error: float, rows: DistanceRows | None) -> Vector | None:
        """Return the step within the bounds and the rows; see `Stepper.step`.

        Bounds and rows together may leave no step where pairs have to part. Then the parting
        gives way, and the rows only keep what distance there is: no step at all does that.
        """
        self._linearise(q, squared_error)
        H, f, low, high, solve = self._H, self._f, self._low, self._high, self._qp.solve
        if rows is None or len(rows.upper) == 0:
            dq = solve(H, f, low, high)
            return dq if dq is None or self._damping > ILL_CONDITIONED else self._refined(q, dq)
        dq = solve(H, f, low, high, rows.A, rows.upper)
        if dq is None and rows.upper.min() < 0.0:
            dq = solve(H, f, low, high, rows.A, np.maximum(rows.upper, 0.0))
        return dq

    def _linearise(self, q: Vector, squared_error: float) -> None:
        """Write the QP of the next step: ½ dqᵀ H dq + fᵀ dq between `_low` and `_high`."""
        error, H, f = self._error, self._H, self._f
        error.update_jacobian()
        at = self._objective.linearised(error, squared_error)
        e, J, damping, posture = at
        self._at, self._damping = at, damping
        J.T.dot(J, H)
        self._diagonal += damping + FLOOR
        e.dot(J, f)
        if posture:
            mju_addToScl(f, np.subtract(self._q_seed, q, out=self._lean), posture)
        np.negative(f, f)
        np.subtract(self._q_min, q, self._low)
        np.subtract(self._q_max, q, self._high)

    def _refined(self, q: Vector, dq: Vector) -> Vector:
        """Return a step with the digits that H = JᵀJ + λ1 has lost; H is overwritten."""
        e, J, damping, posture = self._at
        dq = within(self._low, self._high, dq)
        fall = (e - J.dot(dq)).dot(J)
        fall -= (damping + FLOOR) * dq
        if posture:
            fall += posture * (self._q_seed - q)
        return refined(self._H, fall, self._low, self._high, dq)
