"""Gauss-Newton inverse kinematics: linearise, solve a QP inside the joint limits, step."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import partial
from math import sqrt
from time import process_time
from typing import Annotated, NamedTuple, Protocol, Self

import numpy as np
from mujoco import mju_addToScl

from robo47_qp.arrays import Checked, Count, CountOrZero, Matrix, NotNegative, Range, Vector
from robo47_qp.collision.clearance import Clearance
from robo47_qp.ik.avoidance import Avoidance, DistanceRows
from robo47_qp.ik.box_qp import BoxQp
from robo47_qp.ik.solver import (
    Attempt,
    IkResult,
    Reason,
    Tolerance,
    Unconverged,
    is_target,
    judged,
    rejected,
)
from robo47_qp.ik.tool_error import ToolError, error_to, tools_of
from robo47_qp.model.arm import Arm
from robo47_qp.model.tool_poses import Target

_FLOOR = 1e-9
"""Least damping, for the directions in which a redundant arm moves without its tool."""
_ROUNDING = 100.0
"""A squared error of more than so many squared tolerances is no answer, whatever rounding does:
QP solvers leave the limits by as much as a tolerance of theirs, and answers are clamped."""
_SPARE = 1e-5
"""Distance kept beyond the clearance, for the curvature that the last rows do not see [m]."""
_DETECTION = 0.05
"""How much further away a pair gets a row [m]."""


@dataclass(frozen=True, kw_only=True)
class Stall(Checked):
    """A search is stuck once its squared error has hardly fallen over the last steps."""

    steps: Count = 3
    """Over how many steps the fall is measured."""
    fall: Annotated[float, Range(above=0.0, below=1.0)] = 0.19
    """Share of the squared error that must go in these steps."""

    def _label(self, field: str) -> str:
        return f"stall {field}"

    def stuck(self, squared_errors: list[float]) -> bool:
        """Return whether the last of these errors has not fallen as it should."""
        if len(squared_errors) <= self.steps:
            return False
        return squared_errors[-1] > (1.0 - self.fall) * squared_errors[-1 - self.steps]


@dataclass(frozen=True, kw_only=True)
class GaussNewtonIk(Checked, ABC):
    """Settings of a search by QPs; a member adds what its steps minimise."""

    max_iterations: CountOrZero = 100
    """QPs before giving up."""
    stall: Stall | None = None
    """When a start is given up early; never by default."""
    clearance: NotNegative | None = None
    """Distance that the arm keeps from itself and from its obstacles [m]; None ignores both."""
    tolerance: Tolerance = Tolerance()

    @abstractmethod
    def _search(self, arm: Arm, tools: tuple[int, ...] = (0,)) -> "Search":
        """Return the search for poses of some tools of an arm, with its memory."""

    @property
    def _demanded(self) -> Tolerance:
        return self.tolerance

    def solve(self, arm: Arm, T_world_target: Target, q_seed: Vector) -> IkResult:
        """See `IkSolver.solve`."""
        q = arm.checked_q("q_seed", q_seed)
        if not is_target(T_world_target):
            return rejected(arm, q)
        started = process_time()
        end = self._attempt(arm, T_world_target, q)
        if isinstance(end, Unconverged):
            end = judged(arm, T_world_target, end.q, self._demanded, end.iterations)
        seconds = process_time() - started
        return end.with_effort(iterations=end.iterations, restarts=0, seconds=seconds)

    def attempts(self, arm: Arm, T_world_target: Target) -> Attempt:
        """See `solver.MakeAttempts`."""
        return partial(self._attempt, arm, T_world_target)

    def thorough(self) -> Self:
        """See `EarlyStopping.thorough`."""
        return replace(self, stall=Stall(steps=10), max_iterations=max(self.max_iterations, 100))

    def _attempt(self, arm: Arm, T_world_target: Target, q_seed: Vector) -> IkResult | Unconverged:
        """Return the end of a search from q_seed, judged unless it is far from the target.

        The way to an answer is not driven, so nothing has to stay clear on it: the first search
        looks at the tool alone. Where its answer is closer than `clearance` to anything, a second
        one from the same start has every step keep the distance, or regain it.
        """
        search = self._search(arm, tools_of(arm, T_world_target))
        tolerance, clearance = self._demanded, self.clearance
        limits = (tolerance, self.max_iterations, self.stall)
        iterations = search.run(T_world_target, q_seed, *limits)
        if search.missed and arm.target_beyond_reach(T_world_target) <= 0.0:
            return Unconverged(search.q.copy(), iterations, search.error)
        free = judged(arm, T_world_target, search.q, tolerance, iterations, None, clearance)
        if clearance is None or free.reason is not Reason.COLLISION or free.inevitable:
            return free
        iterations += search.run(
            T_world_target, q_seed, *limits, arm.derived(_avoidance, clearance)
        )
        kept = judged(arm, T_world_target, search.q, tolerance, iterations, None, clearance)
        # A pose that is reached too close to something tells more than one that is not reached.
        if kept.reason is Reason.NOT_CONVERGED:
            return replace(free, iterations=iterations)
        return kept


def _avoidance(arm: Arm, clearance: float) -> Avoidance:
    d_min = clearance + _SPARE
    return Avoidance(arm.derived(Clearance, clearance), d_min=d_min, detection=d_min + _DETECTION)


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


class Objective(Protocol):
    """What a search minimises."""

    def linearised(self, error: ToolError, squared_error: float) -> Linearised:
        """Return the objective about the configuration of `error`; valid until the next call."""
        ...


class Search:
    """Memory of the searches on one arm; `q` is where the last one ended."""

    def __init__(
        self,
        arm: Arm,
        objective: Objective,
        qp: BoxQp,
        *,
        tools: tuple[int, ...] = (0,),
        limited: bool = True,
        rows: int = 6,
    ) -> None:
        """Make the memory for an arm.

        Args:
            arm: The arm.
            objective: What a step minimises.
            qp: What solves for a step.
            tools: The tools that targets are for, by their places among the robot's.
            limited: False lets joints leave their limits.
            rows: 3 where the positions alone count, 6 for the poses.
        """
        n, everywhere = arm.n, np.full(arm.n, np.inf)
        self._q_min = arm.q_min if limited else -everywhere
        self._q_max = arm.q_max if limited else everywhere
        self._turns = rows == 6
        self._objective, self._qp = objective, qp
        self._error = error_to(arm, tools)
        self._low, self._high = np.empty(n), np.empty(n)
        self._H, self._f, self._lean = np.empty((n, n)), np.empty(n), np.empty(n)
        self._diagonal = self._H.reshape(-1)[:: n + 1]
        self.q: Vector = np.empty(n)
        self.error = np.inf
        """Distance and angle that were left at the end [m + rad]."""
        self.missed = True
        """True where more was left than rounding at the limits explains."""

    def run(
        self,
        T_world_target: Target,
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
        error, q, q_min, q_max = self._error, self.q, self._q_min, self._q_max
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
            self._linearise(squared_error, q_seed)
            dq = self._step(None if avoidance is None else avoidance.rows(q))
            if dq is None:
                break
            q += dq
        # QP solvers meet bounds but for rounding; answers meet them exactly.
        np.maximum(q, q_min, out=q)
        np.minimum(q, q_max, out=q)
        self.error = sqrt(distance2) + sqrt(angle2)
        self.missed = distance2 > _ROUNDING * close or angle2 > _ROUNDING * aligned
        return iteration

    def _linearise(self, squared_error: float, q_seed: Vector) -> None:
        """Write the QP of the next step: ½ dqᵀ H dq + fᵀ dq between `_low` and `_high`."""
        error, q, H, f = self._error, self.q, self._H, self._f
        error.update_jacobian()
        e, J, damping, posture = self._objective.linearised(error, squared_error)
        J.T.dot(J, H)
        self._diagonal += damping + _FLOOR
        e.dot(J, f)
        if posture:
            mju_addToScl(f, np.subtract(q_seed, q, out=self._lean), posture)
        np.negative(f, f)
        np.subtract(self._q_min, q, self._low)
        np.subtract(self._q_max, q, self._high)

    def _step(self, rows: DistanceRows | None) -> Vector | None:
        """Return the step within the bounds and the rows.

        Bounds and rows together may leave no step where pairs have to part. Then the parting
        gives way, and the rows only keep what distance there is: no step at all does that.
        """
        H, f, low, high, solve = self._H, self._f, self._low, self._high, self._qp.solve
        if rows is None or len(rows.upper) == 0:
            return solve(H, f, low, high)
        dq = solve(H, f, low, high, rows.A, rows.upper)
        if dq is None and rows.upper.min() < 0.0:
            dq = solve(H, f, low, high, rows.A, np.maximum(rows.upper, 0.0))
        return dq
