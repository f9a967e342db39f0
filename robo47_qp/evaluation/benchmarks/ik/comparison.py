"""Comparison of IK solvers: all solve the same targets, and one judge evaluates the results."""

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
from robo47_qp.ik.solver import IkSolver, Tolerance, is_pose, judged
from robo47_qp.model.arm import Arm

_Unjudged: TypeAlias = tuple[Vector, str | None, str, int, int, float, float]
"""The fields of an `Answer` before its verdict."""
_RAISES = (
    *(Robo47Error, ValueError, TypeError, ArithmeticError, AttributeError, LookupError),
    *(RuntimeError, SystemError),  # compiled peers
)
"""Exceptions that solvers raise on bad targets; they do not stop the comparison."""


class Start(Enum):
    """Seed configuration of the searches."""

    HOME = "home"
    """The robot's rest configuration, always."""
    RANDOM = "random"
    """A random configuration per target, the same for all solvers."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Field:
    """A target set and the judge of its results."""

    make: MakeTargets
    judge: Judge


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """Runs several solvers on the same targets from the same seed configurations."""

    arm: Arm
    solvers: Mapping[str, IkSolver]
    fields: Mapping[str, Field]
    """Target sets by name."""
    n: int
    """Targets per set."""
    seed: int = 0
    """Seed of the targets; each set has a generator of its own and does not depend on the
    others."""
    start: Start = Start.HOME
    block: int = 50
    """Number of targets that one solver solves before the next one takes its turn."""
    warm: int = 5
    """Number of a block's targets that a solver first solves untimed, as a warm-up."""

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
        """Return the seed configurations of one target set (n, joints) [rad]."""
        if self.start is Start.HOME:
            return np.tile(self.arm.home, (self.n, 1))
        rng = np.random.default_rng([self.seed, 1, *name.encode()])
        return rng.uniform(self.arm.q_low, self.arm.q_high, (self.n, self.arm.n))

    def target_set(self, name: str) -> TargetSet:
        """Return the target set of one name, the same for the same seed."""
        rng = np.random.default_rng([self.seed, 0, *name.encode()])
        return self.fields[name].make(self.arm, self.n, rng)

    def run(self, show: Callable[[Sequence[Answers], int], None]) -> Iterator[Sequence[Answers]]:
        """Yield the results of all solvers, set by set.

        Solvers take turns block by block: an interrupted comparison is still paired, and a slow
        phase of the machine affects all solvers. Before each block, a solver warms up on its first
        targets, so that cold caches are not timed.

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
        """Return an empty list of results, after an untimed solve that builds cached data."""
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
            Answer(
                *answer,
                self._judge_seconds(row.targets.targets[k], answer[0]),
                judge.verdict(row.targets.targets[k], answer[0]),
            )
            for k, answer in zip(block, solved, strict=True)
        ]

    def _judge_seconds(self, target: object, q: Vector) -> float:
        """Processor time of judging an answer as the solvers of this package do."""
        if not (is_pose(target) and np.isfinite(q).all()):
            return 0.0
        started = process_time()
        judged(self.arm, target, q, Tolerance(), 0)
        return process_time() - started

    def _solved(self, row: Answers, k: int) -> _Unjudged:
        """A result without its verdict."""
        target, seed = row.targets.targets[k], row.q_seeds[k].copy()
        solve = self.solvers[row.solver].solve
        started = process_time()
        try:
            result = solve(self.arm, target, seed)
        except _RAISES as error:
            seconds = process_time() - started
            q: Vector = np.full(self.arm.n, np.nan)
            words = f"{type(error).__name__}: {error}"
            return q, RAISED, words, 0, 0, seconds, seconds
        seconds = process_time() - started
        reason = None if result.reason is None else result.reason.name
        effort = (result.iterations, result.restarts, seconds, result.seconds)
        return result.q, reason, result.explanation, *effort
