"""The answers of one solver to one target set, as columns, and the outcome of each."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from hashlib import sha256
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.evaluation.benchmarks.ik.judge import LOOSE, TIGHT, IkVerdict
from robo47_qp.evaluation.benchmarks.ik.targets import TargetSet
from robo47_qp.evaluation.benchmarks.ik.unreachable import EXPECTED

RAISED = "RAISED"
"""Stands for the reason where a solver raised instead of giving one."""


class Answer(NamedTuple):
    """One solve: what came back, what it cost, and what it is worth."""

    q: Vector
    """Configuration (n,) [rad]; NaN where the solver raised."""
    reason: str | None
    """Name of the solver's reason; None where it claims success; RAISED with its message."""
    explanation: str
    """The solver's own words."""
    iterations: int
    restarts: int
    seconds: float
    """Processor time of the call, taken outside the solver."""
    verdict: IkVerdict


@dataclass(frozen=True, kw_only=True, eq=False)
class Answers:
    """All answers of one solver to one target set, so far."""

    solver: str
    targets: TargetSet
    q_seeds: Matrix
    """Where each search starts (targets, n) [rad]."""
    first_seconds: float
    """Processor time of a first solve that does not count: what is built once per robot."""
    items: list[Answer] = field(default_factory=list)
    """In the order of the targets; grows while the comparison runs."""

    @property
    def n(self) -> int:
        """Number of answers."""
        return len(self.items)

    @property
    def q(self) -> Matrix:
        """Configurations (answers, n) [rad]."""
        return np.array([answer.q for answer in self.items])

    @property
    def milliseconds(self) -> Vector:
        """Processor time of each call [ms]."""
        return 1e3 * np.array([answer.seconds for answer in self.items])

    @property
    def iterations(self) -> NDArray[np.int64]:
        """Steps of each call, over all starts."""
        return np.array([answer.iterations for answer in self.items], dtype=np.int64)

    @property
    def restarts(self) -> NDArray[np.int64]:
        """Starts after the first of each call."""
        return np.array([answer.restarts for answer in self.items], dtype=np.int64)

    @property
    def success(self) -> NDArray[np.bool_]:
        """Within 1 mm and 0.1 degrees, every joint in its range."""
        return np.array([a.verdict.within(LOOSE) for a in self.items], dtype=np.bool_)

    @property
    def tight(self) -> NDArray[np.bool_]:
        """Within 0.1 mm and 1 mrad, every joint in its range."""
        return np.array([a.verdict.within(TIGHT) for a in self.items], dtype=np.bool_)

    @property
    def free(self) -> NDArray[np.bool_]:
        """Nothing touches."""
        return np.array([a.verdict.free for a in self.items], dtype=np.bool_)

    @property
    def in_place(self) -> NDArray[np.bool_]:
        """The tool's point within 1 mm, whatever its orientation and the limits."""
        return np.array([a.verdict.position_error for a in self.items]) <= LOOSE.position

    @property
    def outside(self) -> NDArray[np.bool_]:
        """A joint outside its range."""
        return np.array([a.verdict.limit_excess for a in self.items]) > 0.0

    @property
    def claimed(self) -> NDArray[np.bool_]:
        """The solver says that it got there."""
        return np.array([a.reason is None for a in self.items], dtype=np.bool_)

    def digest(self) -> str:
        """SHA-256 of all configurations: equal where all answers are equal to the bit."""
        return sha256(np.ascontiguousarray(self.q).tobytes()).hexdigest()


class Outcome(Enum):
    """What became of a target; the value is shown to people."""

    REACHED = "reached, inside the limits, touching nothing"
    COLLIDING = "reached inside the limits, but in collision"
    OUTSIDE = "reached with a joint outside its limits"
    MISSED = "not reached"
    RAISED = "an exception"
    REFUSED = "unreachable, and the right reason named"
    WRONG_REASON = "unreachable, and no or another reason named"


COLOURS: dict[Outcome, tuple[int, int, int]] = {
    Outcome.REACHED: (96, 172, 108),
    Outcome.COLLIDING: (170, 110, 230),
    Outcome.OUTSIDE: (240, 160, 50),
    Outcome.MISSED: (226, 60, 66),
    Outcome.RAISED: (20, 20, 20),
    Outcome.REFUSED: (120, 140, 165),
    Outcome.WRONG_REASON: (235, 205, 60),
}
GOOD = frozenset({Outcome.REACHED, Outcome.REFUSED})


def outcomes(answers: Answers) -> list[Outcome]:
    """What became of each target, in their order."""
    kinds: Sequence[str] = answers.targets.kinds
    return [
        _unreachable(answer, kinds[k]) if kinds else _reachable(answer)
        for k, answer in enumerate(answers.items)
    ]


def _reachable(answer: Answer) -> Outcome:
    verdict = answer.verdict
    if answer.reason == RAISED:
        return Outcome.RAISED
    if verdict.within(LOOSE):
        return Outcome.REACHED if verdict.free else Outcome.COLLIDING
    close = verdict.position_error <= LOOSE.position
    if close and verdict.orientation_error <= LOOSE.orientation:
        return Outcome.OUTSIDE
    return Outcome.MISSED


def _unreachable(answer: Answer, kind: str) -> Outcome:
    if answer.reason == RAISED:
        return Outcome.RAISED
    return Outcome.REFUSED if answer.reason in EXPECTED[kind] else Outcome.WRONG_REASON
