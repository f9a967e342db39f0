"""The report of a comparison, as JSON that repeats but for its times."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from robo47_qp.evaluation.benchmarks.ik.answers import Answers
from robo47_qp.evaluation.benchmarks.ik.comparison import Comparison
from robo47_qp.evaluation.benchmarks.ik.judge import LOOSE, TIGHT
from robo47_qp.evaluation.benchmarks.ik.rows import (
    Question,
    paired_tests,
    reason_rows,
    rows,
)
from robo47_qp.evaluation.statistics import CONFIDENCE
from robo47_qp.report.run_report import plain, versions


def summary(
    comparison: Comparison,
    fields: Sequence[Sequence[Answers]],
    questions: Collection[Question],
    left_out: Mapping[str, str],
    *,
    complete: bool,
) -> dict[str, Any]:
    """All figures and all settings.

    Args:
        comparison: Who was compared on what.
        fields: The answers, per target set.
        questions: Pairs of solvers that were to be compared before there were figures.
        left_out: Solvers that are not there, with why.
        complete: False where the comparison was interrupted.
    """
    told = [answers for field in fields for answers in field if answers.targets.kinds]
    return {
        "complete": complete,
        "robot": comparison.arm.robot.name,
        "seed": comparison.seed,
        "n": comparison.n,
        "start": comparison.start.value,
        "success_is": plain(LOOSE),
        "tight_is": plain(TIGHT),
        "confidence": CONFIDENCE,
        "clock": "processor time, all solvers in turn on each target",
        "solvers": {name: plain(solver) for name, solver in comparison.solvers.items()},
        "left_out": dict(left_out),
        "rows": [row for field in fields for row in rows(field)],
        "reasons": [row for answers in told for row in reason_rows(answers)],
        "paired": [asdict(test) for test in paired_tests(fields, questions)],
        "versions": versions(),
    }
