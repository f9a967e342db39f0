"""Comparison: every solver on every target, one after the other, judged by one judge."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from time import process_time
from typing import TypeAlias

import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import InvalidValueError, Robo47Error
from robo47_qp.evaluation.benchmarks.ik.answers import RAISED, Answer, Answers
from robo47_qp.evaluation.benchmarks.ik.judge import Judge
from robo47_qp.evaluation.benchmarks.ik.targets import MakeTargets, TargetSet
from robo47_qp.ik.solver import IkSolver
from robo47_qp.model.arm import Arm

_Unjudged: TypeAlias = tuple[Vector, str | None, str, int, int, float]
"""The fields of an `Answer` before its verdict."""
_RAISES = (
    *(Robo47Error, ValueError, TypeError, ArithmeticError, AttributeError, LookupError),
    *(RuntimeError, SystemError),  # compiled peers
)
"""What a solver is known to raise on a bad target; never a reason to stop the comparison."""


class Start(Enum):
    """Where the searches start."""

    HOME = "home"
    """The robot's rest configuration, always."""
    RANDOM = "random"
    """A configuration drawn from the joint ranges for each target, the same for all solvers."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Field:
    """A target set and the judge of its answers."""

    make: MakeTargets
    judge: Judge


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """Who is compared on what. Every solver gets the same targets from the same seeds."""

    arm: Arm
    solvers: Mapping[str, IkSolver]
    fields: Mapping[str, Field]
    """Target sets by name."""
    n: int
    """Targets per set."""
    seed: int = 0
    """Each set is drawn from a generator of its own: it does not depend on the others."""
    start: Start = Start.HOME
    block: int = 50
    """Targets between two changes of the solver."""
    warm: int = 5
    """Targets of a block that a solver is asked once more before, without being timed."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: There is nothing to compare.
        """
        if self.n < 1:
            raise InvalidValueError("--n", self.n, "1 or more")
        if self.seed < 0:
            raise InvalidValueError("--seed", self.seed, "0 or more")
        for option, chosen in (("--solvers", self.solvers), ("--targets", self.fields)):
            if not chosen:
                raise InvalidValueError(option, "none", "at least one name")

    def q_seeds(self, name: str) -> Matrix:
        """Where the searches of one target set start (n, joints) [rad]."""
        if self.start is Start.HOME:
            return np.tile(self.arm.home, (self.n, 1))
        rng = np.random.default_rng([self.seed, 1, *name.encode()])
        return rng.uniform(self.arm.q_min, self.arm.q_max, (self.n, self.arm.n))

    def target_set(self, name: str) -> TargetSet:
        """The targets of one name: the same for the same seed, whatever else is compared."""
        rng = np.random.default_rng([self.seed, 0, *name.encode()])
        return self.fields[name].make(self.arm, self.n, rng)

    def run(self, show: Callable[[Sequence[Answers], int], None]) -> Iterator[Sequence[Answers]]:
        """Yield the answers of all solvers, set by set.

        Blocks of targets are the outer loop: a comparison that is interrupted is still paired,
        and what slows the machine down for a while slows all solvers. Before its turn a solver
        warms up on the first targets of the block, so that it is timed at work, not while its
        code and data come back into the processor's caches.

        Args:
            show: Called after each block with the answers so far and their number.
        """
        for name in self.fields:
            targets = self.target_set(name)
            rows = [self._row(solver, targets) for solver in self.solvers]
            try:
                for first in range(0, len(targets), self.block):
                    block = range(first, min(first + self.block, len(targets)))
                    answers = [self._answers(row, block) for row in rows]
                    for row, more in zip(rows, answers, strict=True):
                        row.items.extend(more)
                    show(rows, block.stop)
            except KeyboardInterrupt:
                if rows[0].n:
                    yield rows
                raise
            yield rows

    def _row(self, solver: str, targets: TargetSet) -> Answers:
        """No answers yet, after a solve of what needs no step: it builds what is kept."""
        started = process_time()
        self.solvers[solver].solve(self.arm, self.arm.pose(self.arm.home), self.arm.home.copy())
        return Answers(
            solver=solver,
            targets=targets,
            q_seeds=self.q_seeds(targets.name),
            first_seconds=process_time() - started,
        )

    def _answers(self, row: Answers, block: range) -> list[Answer]:
        for k in block[: self.warm]:
            self._solved(row, k)
        solved = [self._solved(row, k) for k in block]
        judge = self.fields[row.targets.name].judge
        return [
            Answer(*answer, judge.verdict(row.targets.targets[k], answer[0]))
            for k, answer in zip(block, solved, strict=True)
        ]

    def _solved(self, row: Answers, k: int) -> _Unjudged:
        """An answer that waits for its verdict."""
        target, seed = row.targets.targets[k], row.q_seeds[k].copy()
        solve = self.solvers[row.solver].solve
        started = process_time()
        try:
            result = solve(self.arm, target, seed)
        except _RAISES as error:
            seconds = process_time() - started
            q: Vector = np.full(self.arm.n, np.nan)
            words = f"{type(error).__name__}: {error}"
            return q, RAISED, words, 0, 0, seconds
        seconds = process_time() - started
        reason = None if result.reason is None else result.reason.name
        effort = (result.iterations, result.restarts, seconds)
        return result.q, reason, result.explanation, *effort
