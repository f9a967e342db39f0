"""Results of one solver on one target set, and the outcome of each."""

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
"""Reason recorded where a solver raised an exception."""


class Answer(NamedTuple):
    """Result of one solve, with its cost and its independent evaluation."""

    q: Vector
    """Configuration (n,) [rad]; NaN where the solver raised."""
    reason: str | None
    """Name of the solver's failure reason; None where it reports success, RAISED if it raised."""
    explanation: str
    """The solver's message."""
    iterations: int
    restarts: int
    seconds: float
    """Processor time of the call, measured outside the solver."""
    own_seconds: float
    """What of it the solver itself took: of another package's, its call alone, without what makes
    its arguments and judges its answer."""
    judge_seconds: float
    """What `ik.solver.judged` alone takes for the answer."""
    verdict: IkVerdict


@dataclass(frozen=True, kw_only=True, eq=False)
class Answers:
    """All results of one solver on one target set, so far."""

    solver: str
    targets: TargetSet
    q_seeds: Matrix
    """Seed configuration of each target (targets, n) [rad]."""
    first_seconds: float
    """Processor time of an untimed first solve, which builds what is kept per robot."""
    items: list[Answer] = field(default_factory=list)
    """In the order of the targets; grows while the comparison runs."""

    @property
    def n(self) -> int:
        """Number of results so far."""
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
    def own_milliseconds(self) -> Vector:
        """What of it the solvers themselves took [ms]."""
        return 1e3 * np.array([answer.own_seconds for answer in self.items])

    @property
    def judge_milliseconds(self) -> Vector:
        """What judging the answers takes [ms]."""
        return 1e3 * np.array([answer.judge_seconds for answer in self.items])

    @property
    def iterations(self) -> NDArray[np.int64]:
        """Iterations of each call, over all starts."""
        return np.array([answer.iterations for answer in self.items], dtype=np.int64)

    @property
    def restarts(self) -> NDArray[np.int64]:
        """Restarts of each call: its starts after the first."""
        return np.array([answer.restarts for answer in self.items], dtype=np.int64)

    @property
    def success(self) -> NDArray[np.bool_]:
        """True where the pose is within 1 mm and 0.1 degrees and all joints are within limits."""
        return np.array([a.verdict.within(LOOSE) for a in self.items], dtype=np.bool_)

    @property
    def tight(self) -> NDArray[np.bool_]:
        """True where the pose is within 0.1 mm and 1 mrad and all joints are within limits."""
        return np.array([a.verdict.within(TIGHT) for a in self.items], dtype=np.bool_)

    @property
    def free(self) -> NDArray[np.bool_]:
        """True where nothing collides."""
        return np.array([a.verdict.free for a in self.items], dtype=np.bool_)

    @property
    def in_place(self) -> NDArray[np.bool_]:
        """True where the position error is within 1 mm, whatever the orientation and the limits."""
        return np.array([a.verdict.position_error for a in self.items]) <= LOOSE.position

    @property
    def outside(self) -> NDArray[np.bool_]:
        """True where a joint is outside its limits."""
        return np.array([a.verdict.limit_excess for a in self.items]) > 0.0

    @property
    def claimed(self) -> NDArray[np.bool_]:
        """True where the solver reports success."""
        return np.array([a.reason is None for a in self.items], dtype=np.bool_)

    def digest(self) -> str:
        """Return the SHA-256 of all configurations, equal if they are equal to the bit."""
        return sha256(np.ascontiguousarray(self.q).tobytes()).hexdigest()


class Outcome(Enum):
    """Outcome of one target; its value is the text in reports and plots."""

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
    """Return the outcome of each target, in their order."""
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
