"""Outcome: what became of a target, in one word and one colour."""

from collections.abc import Sequence
from enum import Enum

from robo47_qp.evaluation.benchmarks.ik.answers import RAISED, Answer, Answers
from robo47_qp.evaluation.benchmarks.ik.judge import LOOSE
from robo47_qp.evaluation.benchmarks.ik.unreachable import EXPECTED


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
