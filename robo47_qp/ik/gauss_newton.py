"""Gauss-Newton inverse kinematics: linearise, solve a QP inside the joint limits, step."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import partial
from math import sqrt
from time import process_time
from typing import Annotated, Any, Generic, Protocol, Self, TypeVar

import numpy as np

from robo47_qp.arrays import Checked, Count, CountOrZero, NotNegative, Range, Vector
from robo47_qp.collision.clearance import Clearance
from robo47_qp.ik.avoidance import Avoidance, DistanceRows
from robo47_qp.ik.solver import (
    Attempt,
    IkResult,
    Reason,
    Tolerance,
    Unconverged,
    is_target,
    judged,
    rejected,
    unwound,
)
from robo47_qp.ik.tool_error import tools_of
from robo47_qp.model.arm import Arm
from robo47_qp.model.tool_poses import Target

FLOOR = 1e-9
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
    def _search(self, arm: Arm, tools: tuple[int, ...] = (0,)) -> "Search[Any]":
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
        end = unwound(arm, self._attempt(arm, T_world_target, q), q)
        if isinstance(end, Unconverged) or end.reason is Reason.JOINT_LIMITS:
            # Wound back by whole turns, a joint may be inside its limits again.
            asked = self._demanded, end.iterations, None, self.clearance
            end = judged(arm, T_world_target, end.q, *asked)
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
        placed = tolerance.demand.position
        if search.missed and not (placed and arm.target_beyond_reach(T_world_target) > 0.0):
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


class Stepper(Protocol):
    """What a search asks for: how far the target is, and the step towards it."""

    def aim(self, T_world_target: Target, q_seed: Vector) -> None:
        """Take a target, and the configuration that answers are to be close to (n,) [rad]."""
        ...

    def move(self, q: Vector) -> tuple[float, float, float]:
        """Put the arm at q (n,) [rad].

        Returns:
            What is left there, squared: the distance of the tool [m²], its angle [rad²], and
            whatever else has to be reached, which is 0 where it is.
        """
        ...

    def step(self, q: Vector, squared_error: float, rows: DistanceRows | None) -> Vector | None:
        """Return the step (n,) from the q of the last `move`, or None where there is none.

        Args:
            q: That configuration (n,) [rad].
            squared_error: What was left there, altogether.
            rows: Rows that keep pairs of geoms apart.
        """
        ...


S = TypeVar("S", bound=Stepper)


class Search(Generic[S]):
    """The loop of all searches on one arm; `q` is where the last one ended."""

    def __init__(self, arm: Arm, stepper: S, *, limited: bool = True, turns: bool = True) -> None:
        """Make the memory for an arm.

        Args:
            arm: The arm.
            stepper: Measures what is left, and makes the steps.
            limited: False lets joints leave their limits.
            turns: False where the position alone counts.
        """
        n, everywhere = arm.n, np.full(arm.n, np.inf)
        self._turns = turns
        self._q_min = arm.q_min if limited else -everywhere
        self._q_max = arm.q_max if limited else everywhere
        self.stepper = stepper
        self.q: Vector = np.empty(n)
        self.error = np.inf
        """Distance and angle that were left at the end [m + rad]."""
        self.reached = False
        """True where nothing was left to be reached."""
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
        stepper, q, q_min, q_max = self.stepper, self.q, self._q_min, self._q_max
        distance2 = angle2 = np.inf
        stepper.aim(T_world_target, q_seed)
        np.maximum(q_seed, q_min, out=q)
        np.minimum(q, q_max, out=q)
        close = tolerance.position**2
        aligned = tolerance.orientation**2 if self._turns else np.inf
        history, self.reached = list[float](), False
        for iteration in range(max_iterations + 1):
            distance2, angle2, rest2 = stepper.move(q)
            reached = distance2 <= close and angle2 <= aligned and rest2 <= 0.0
            if reached and (avoidance is None or avoidance.kept(q)):
                self.reached = True
                break
            squared_error = (distance2 + angle2 if self._turns else distance2) + rest2
            if stall is not None and not reached:
                history.append(squared_error)
                if stall.stuck(history):
                    break
            if iteration == max_iterations:
                break
            dq = stepper.step(q, squared_error, None if avoidance is None else avoidance.rows(q))
            if dq is None:
                break
            q += dq
        # QP solvers meet bounds but for rounding; answers meet them exactly.
        np.maximum(q, q_min, out=q)
        np.minimum(q, q_max, out=q)
        self.note(distance2, angle2, tolerance)
        return iteration

    def note(self, distance2: float, angle2: float, tolerance: Tolerance) -> None:
        """Note what was left at the end, squared [m², rad²]."""
        close = tolerance.position**2
        aligned = tolerance.orientation**2 if self._turns else np.inf
        self.error = sqrt(distance2) + sqrt(angle2)
        self.missed = distance2 > _ROUNDING * close or angle2 > _ROUNDING * aligned
