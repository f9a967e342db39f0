"""Restarts of any IK solver from other configurations."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from time import process_time
from typing import Any

import numpy as np
from mink import SE3

from robo47_qp._core.library import Backend, backend
from robo47_qp.arrays import Checked, Count, CountOrZero, NotNegative, Vector
from robo47_qp.ik.descent import Descending
from robo47_qp.ik.diagnosis import diagnosed
from robo47_qp.ik.restarts import Looks, Restarts
from robo47_qp.ik.seeds import feature_of, library_of
from robo47_qp.ik.solver import (
    Composing,
    EarlyStopping,
    IkResult,
    IkSolver,
    Reason,
    Tolerance,
    Unconverged,
    attempts_of,
    composed_ik,
    is_pose,
    is_target,
    judged,
    unwound,
)
from robo47_qp.ik.tool_demand import ToolDemand
from robo47_qp.ik.tool_error import tools_of
from robo47_qp.model.arm import Arm
from robo47_qp.model.tool_poses import Target


@dataclass(frozen=True, kw_only=True)
class Preference(Checked):
    """Weights of the qualities by which solutions are ranked; each quality runs from 0 to 1."""

    seed: NotNegative = 1.0
    """Closeness to the seed: one minus the root mean square of the joints' displacements, each as a
    share of its range."""
    limits: NotNegative = 0.5
    """Distance to the nearest joint limit, as a share of half the joint's range."""
    manipulability: NotNegative = 0.2
    """√det(J Jᵀ), relative to the largest among the solutions (Yoshikawa, "Manipulability of
    robotic mechanisms", 1985)."""
    clearance: NotNegative = 0.2
    """Distance to the nearest obstacle, relative to the largest among the solutions, if known."""

    def _label(self, field: str) -> str:
        return f"preference for {field}"

    def ranked(self, arm: Arm, answers: Sequence[IkResult], q_seed: Vector) -> tuple[IkResult, ...]:
        """Return the solutions, best first; equal ones in the order given."""
        if len(answers) < 2:
            return tuple(answers)
        span = arm.q_high - arm.q_low
        q = np.array([answer.q for answer in answers])
        score = self.seed * (1.0 - np.sqrt(np.mean((arm.way(q_seed, q) / span) ** 2, axis=1)))
        room = np.minimum(q - arm.q_min, arm.q_max - q) / (0.5 * span)
        score += self.limits * np.minimum(room.min(axis=1), 1.0)
        score += self.manipulability * _share([_manipulability(arm, row) for row in q])
        clearances = [answer.clearance for answer in answers]
        known = [clearance for clearance in clearances if clearance is not None]
        if len(known) == len(answers):
            score += self.clearance * _share(known)
        return tuple(answers[i] for i in np.argsort(-score, kind="stable"))


def _manipulability(arm: Arm, q: Vector) -> float:
    # As a product of singular values it is 0 rather than a root of rounding.
    tools = range(len(arm.robot.tools))
    gains = [np.linalg.svd(arm.jacobian(q, tool), compute_uv=False) for tool in tools]
    return float(np.prod(gains))


def _share(values: Sequence[float]) -> Vector:
    largest = max(values)
    return np.array(values) / largest if largest > 0.0 else np.zeros(len(values))


_HOPELESS = (Reason.INVALID_TARGET, Reason.OUT_OF_REACH)
_DIAGNOSES = 8
"""Number of starts of a diagnosis."""
_SECOND_LOOKS = (10, 20, 40)
"""Numbers of starts after which the closest results are continued by a more patient search: near a
singularity, the error falls too slowly for a search that stops early."""
_ENDS = 4
"""Number of results that are continued."""
_CLOSE = 0.05
"""Largest error of a result that is continued [m + rad]."""
_SAME = 0.05
"""Results closer to one another than this count as one [rad or m]."""


@dataclass(frozen=True, kw_only=True)
class MultiStart(Checked):
    """Starts a solver from the seed, then from a library, until there are enough solutions.

    The library spreads configurations evenly within the joint limits; those whose tool poses are
    nearest to the target come first, then the rest in their order. The budget is counted in starts
    of the solver, not in time, so that the result is reproducible.
    """

    solver: IkSolver
    """Solver that runs from each start; best with few iterations and a stall test."""
    max_restarts: CountOrZero = 200
    """Starts after the first before giving up. Up to 12 more searches may continue the closest
    ends; results count them as restarts."""
    seed_first: bool = True
    """True to start from the seed; False to start from the nearer of the seed and the library's
    nearest configuration, which is faster for targets far from the seed."""
    library: Count = 3000
    """Number of configurations in the library."""
    near: Count = 40
    """Number of starts chosen for nearness to the target, before those chosen for spread."""
    answers: Count = 1
    """Number of different solutions to collect, if there are so many, before the preferred one is
    taken."""
    apart: NotNegative = 0.3
    """Two solutions differ if a joint differs by more than this [rad or m]."""
    preference: Preference = Preference()

    @property
    def tolerance(self) -> Tolerance:
        """How close counts as reached."""
        return self.solver.tolerance

    def composed(
        self, objectives: Sequence[Any] = (), demand: ToolDemand | None = None
    ) -> "MultiStart":
        """See `Extensible.composed`."""
        return replace(self, solver=composed_ik(self.solver, objectives, demand))

    def solve(self, arm: Arm, T_world_target: Target, q_seed: Vector) -> IkResult:
        """See `IkSolver.solve`; where no start gets there, the best one with the reason."""
        return self.solve_all(arm, T_world_target, q_seed)[0]

    def solve_all(self, arm: Arm, T_world_target: Target, q_seed: Vector) -> tuple[IkResult, ...]:
        """Return up to `answers` different solutions, the preferred one first.

        Iterations and time are those of the whole search.

        Returns:
            At least one result; a single one with the reason if there is no solution.

        Raises:
            InvalidValueError: `q_seed` is not a finite vector of shape (n,).
        """
        started = process_time()
        q_seed = arm.checked_q("q_seed", q_seed)
        if is_pose(T_world_target):
            whole = self.whole(arm)
            if whole is not None:
                answer = whole.answer(T_world_target, q_seed)
                if answer is not None:
                    answer = unwound(arm, answer, q_seed)
                    object.__setattr__(answer, "seconds", process_time() - started)
                    return (answer,)
        if not is_target(T_world_target):
            none = self.solver.solve(arm, T_world_target, q_seed)
            return (replace(none, seconds=process_time() - started),)
        tally = _Tally(self.answers, self.apart)
        self._search(arm, T_world_target, q_seed, tally)
        iterations, restarts = tally.iterations, tally.starts + tally.looks - 1
        found, best = tally.found, tally.best
        if not found and best is not None:
            if isinstance(best, Unconverged):
                best = judged(arm, T_world_target, best.q, self.tolerance, best.iterations)
            best = replace(best, iterations=iterations, restarts=restarts)
            starts = list(islice(self._all_starts(arm, T_world_target, q_seed), _DIAGNOSES))
            told = diagnosed(arm, T_world_target, best, starts, self.tolerance)
            if isinstance(self.solver, Composing):
                told = self.solver.explained(arm, T_world_target, told)
            found = [told]
        ranked = self.preference.ranked(arm, found, q_seed)
        seconds = process_time() - started
        return tuple(
            result.with_effort(iterations=iterations, restarts=restarts, seconds=seconds)
            for result in ranked
        )

    def whole(self, arm: Arm) -> Restarts | None:
        """Return the whole search in the compiled core; None where it is not all there.

        It is for one pose of the only tool and one answer by a `Descending` solver. A target that
        it does not reach is for the search here, which tells why.
        """
        if not hasattr(self.solver, "descent"):
            return None
        return arm.derived(_whole, self, backend())

    def _search(self, arm: Arm, T_world_target: Target, q_seed: Vector, tally: "_Tally") -> None:
        """Search from one start after another until enough solutions are found."""
        attempt = attempts_of(self.solver, arm, T_world_target)
        for q_start in islice(self._all_starts(arm, T_world_target, q_seed), self.max_restarts + 1):
            tally.starts += 1
            if tally.take(unwound(arm, attempt(q_start), q_seed)):
                return
            if tally.starts in _SECOND_LOOKS and isinstance(self.solver, EarlyStopping):
                again = attempts_of(self.solver.thorough(), arm, T_world_target)
                for q in tally.ends():
                    tally.looks += 1
                    if tally.take(unwound(arm, again(q), q_seed)):
                        return

    def _all_starts(self, arm: Arm, T_world_target: Target, q_seed: Vector) -> Iterator[Vector]:
        """Yield the starts as the solver takes them: with joints where it holds them."""
        starts, solver = self._starts(arm, T_world_target, q_seed), self.solver
        if not isinstance(solver, Composing):
            return starts
        return (solver.start(arm, q_start, q_seed) for q_start in starts)

    def _starts(self, arm: Arm, T_world_target: Target, q_seed: Vector) -> Iterator[Vector]:
        """Yield the starts: seed, nearest of the library, then the others in their order.

        Joints that do not move the tool stay at the seed.
        """
        if not isinstance(T_world_target, SE3) or len(arm.robot.tools) > 1:
            yield from self._starts_of_tools(arm, T_world_target, q_seed)
            return
        if self.seed_first:
            yield q_seed
        demand = self.tolerance.demand
        library = library_of(arm, self.library, demand=demand)
        target = demand.feature(feature_of(T_world_target))
        distances = library.distances(target)
        near = library.nearest(distances, min(self.near, len(distances)))
        taken = [next(near)]
        if not self.seed_first:
            seed = demand.feature(feature_of(arm.pose(q_seed)))
            if seed.dot(0.5 * seed - target) <= distances[taken[0]]:
                yield q_seed
        moving = arm.tool_joints(0)
        yield np.where(moving, library.q[taken[0]], q_seed)
        for k in near:
            taken.append(k)
            yield np.where(moving, library.q[k], q_seed)
        for k in np.setdiff1d(np.arange(len(distances)), taken):
            yield np.where(moving, library.q[k], q_seed)

    def _starts_of_tools(self, arm: Arm, target: Target, q_seed: Vector) -> Iterator[Vector]:
        """Yield the seed, then for each tool's joints those of its own library, by nearness.

        All other joints stay at the seed. Joints shared by several tools are those of the first.
        """
        yield q_seed
        poses = (target,) if isinstance(target, SE3) else tuple(target.values())
        tools = list(zip(tools_of(arm, target), poses, strict=True))[::-1]
        orders = [self._by_nearness(arm, tool, pose) for tool, pose in tools]
        for places in zip(*orders, strict=True):
            q_start = q_seed.copy()
            for (tool, _), place in zip(tools, places, strict=True):
                joints = arm.tool_joints(tool)
                q_start[joints] = library_of(arm, self.library, tool).q[place, joints]
            yield q_start

    def _by_nearness(self, arm: Arm, tool: int, pose: SE3) -> Iterator[int]:
        """Yield the nearest of a tool's library, then all others in their order."""
        demand = self.tolerance.demand
        library = library_of(arm, self.library, tool, demand)
        distances, taken = library.distances(demand.feature(feature_of(pose))), list[int]()
        for place in library.nearest(distances, min(self.near, len(distances))):
            taken.append(place)
            yield place
        yield from np.setdiff1d(np.arange(len(distances)), taken).tolist()


def _whole(arm: Arm, search: MultiStart, chosen: Backend) -> Restarts | None:
    solver, one = search.solver, search.answers == 1 and len(arm.robot.tools) == 1
    if chosen == "numpy" or not one or not isinstance(solver, Descending):
        return None
    first, patient = solver.descent(arm), solver.thorough().descent(arm)
    if first is None or patient is None:
        return None
    library = library_of(arm, search.library, demand=search.tolerance.demand)
    looks = Looks(_SECOND_LOOKS, _ENDS, _CLOSE, _SAME)
    return Restarts(
        arm,
        (first, patient),
        library,
        looks,
        starts=search.max_restarts + 1,
        near=search.near,
        seed_first=search.seed_first,
    )


class _Tally:
    """Results of the starts so far."""

    def __init__(self, answers: int, apart: float) -> None:
        self._answers, self._apart = answers, apart
        self.starts = self.looks = self.iterations = 0
        self.found: list[IkResult] = []
        self.best: IkResult | Unconverged | None = None
        self._close: list[IkResult | Unconverged] = []

    def take(self, result: IkResult | Unconverged) -> bool:
        """Count a result; return True if no further start is needed or useful."""
        self.iterations += result.iterations
        if isinstance(result, IkResult) and result.converged:
            if all(np.abs(result.q - other.q).max() > self._apart for other in self.found):
                self.found.append(result)
            return len(self.found) == self._answers
        if self.best is None or _rank(result) < _rank(self.best):
            self.best = result
        if result.error < _CLOSE:
            self._close.append(result)
        if isinstance(result, Unconverged):
            return False
        return result.reason in _HOPELESS or result.inevitable

    def ends(self) -> list[Vector]:
        """Return where the closest searches since the last call ended, for a search to continue."""
        close = sorted(self._close, key=_rank)
        self._close = []
        ends: list[Vector] = []
        for result in close:
            if all(np.abs(result.q - q).max() > _SAME for q in ends):
                ends.append(result.q)
        return ends[:_ENDS]


def _rank(result: IkResult | Unconverged) -> tuple[bool, float]:
    """Return the remaining error; a pose that is reached with too little clearance comes first."""
    if isinstance(result, Unconverged) or result.reason is not Reason.COLLISION:
        return True, result.error
    return False, -(result.clearance or 0.0)
