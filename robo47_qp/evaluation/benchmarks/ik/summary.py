"""Statistics of a comparison: success, time, failure reasons, paired tests, report."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robo47_qp.evaluation.benchmarks.ik.answers import RAISED, Answers
from robo47_qp.evaluation.benchmarks.ik.comparison import Comparison
from robo47_qp.evaluation.benchmarks.ik.judge import LOOSE, TIGHT
from robo47_qp.evaluation.benchmarks.ik.unreachable import EXPECTED
from robo47_qp.evaluation.statistics import CONFIDENCE, holm, mcnemar, wilson
from robo47_qp.files import plain

Question = tuple[str, str]
"""A planned comparison of two solvers, chosen before the results were known."""


@dataclass(frozen=True, kw_only=True)
class PairedTest:
    """Paired comparison of two solvers: McNemar's exact test on targets that only one solved."""

    targets: str
    a: str
    b: str
    only_a: int
    """Number of targets that only a solved."""
    only_b: int
    """Number of targets that only b solved."""
    p: float
    """Two-sided p-value of the exact test."""
    p_holm: float
    """p-value with the correction of Holm (1979); planned and other tests are corrected
    separately."""
    planned: bool
    """True for a planned comparison."""


def row(answers: Answers, reached: NDArray[np.bool_]) -> dict[str, Any]:
    """Return the statistics of one solver on one target set, as JSON.

    Success rates refer to all n targets. Times refer to targets that at least one solver reached;
    times of the others are listed separately. "own" is the time of the solver itself: of another
    package's, its call without what makes its arguments and judges its answer; "judge" is the time
    of judging alone, which the solvers of this package include.

    Args:
        answers: The solver's results.
        reached: For each target, whether a solver of the comparison reached it within TIGHT.
    """
    timed = reached if reached.any() else np.ones(answers.n, dtype=np.bool_)
    in_vain = answers.milliseconds[~reached]
    reached_by_any = int(reached.sum())
    n, success, tight = answers.n, answers.success, answers.tight
    free = success & answers.free
    times = np.percentile(answers.milliseconds[timed], [50.0, 95.0, 99.0, 100.0])
    reasons = Counter(answer.reason for answer in answers.items)
    return {
        "solver": answers.solver,
        "targets": answers.targets.name,
        "n": n,
        "success": float(success.mean()),
        "interval": list(wilson(int(success.sum()), n)),
        "tight": float(tight.mean()),
        "tight_interval": list(wilson(int(tight.sum()), n)),
        "collision_free": float(free.mean()),
        "collision_free_interval": list(wilson(int(free.sum()), n)),
        "position_only": float(answers.in_place.mean()),
        "median_ms": float(times[0]),
        "p95_ms": float(times[1]),
        "p99_ms": float(times[2]),
        "max_ms": float(times[3]),
        "own_median_ms": float(np.median(answers.own_milliseconds[timed])),
        "own_p99_ms": float(np.percentile(answers.own_milliseconds[timed], 99.0)),
        "judge_median_ms": float(np.median(answers.judge_milliseconds[timed])),
        "in_vain_median_ms": float(np.median(in_vain)) if len(in_vain) else 0.0,
        "first_ms": 1e3 * answers.first_seconds,
        "limit_violations": int(answers.outside.sum()),
        "reached_by_any": reached_by_any,
        "missed": reached_by_any - int(tight.sum()),
        "false_claims": int((answers.claimed & ~success).sum()),
        "raised": reasons[RAISED],
        "median_iterations": float(np.median(answers.iterations)),
        "mean_restarts": float(answers.restarts.mean()),
        "reasons": dict(sorted((k, v) for k, v in reasons.items() if k is not None)),
        "sha256": answers.digest(),
    }


def rows(field: Sequence[Answers]) -> list[dict[str, Any]]:
    """Return the statistics of all solvers on one target set."""
    some = np.logical_or.reduce([answers.tight for answers in field])
    return [row(answers, some) for answers in field]


def reason_rows(answers: Answers) -> list[dict[str, Any]]:
    """Return how often each solver named the right class of reason, per kind of target."""
    kinds = np.array(answers.targets.kinds[: answers.n])
    found = []
    for kind in dict.fromkeys(kinds.tolist()):
        said = [
            (answer.reason, answer.seconds)
            for answer, own in zip(answers.items, kinds, strict=True)
            if own == kind
        ]
        right = sum(reason in EXPECTED[kind] for reason, _ in said)
        found.append(
            {
                "solver": answers.solver,
                "targets": answers.targets.name,
                "kind": kind,
                "n": len(said),
                "right": right,
                "expected": sorted(EXPECTED[kind]),
                "said": dict(sorted(Counter(reason or "REACHED" for reason, _ in said).items())),
                "p99_ms": float(np.percentile([1e3 * seconds for _, seconds in said], 99.0)),
            }
        )
    return found


def paired_tests(
    fields: Sequence[Sequence[Answers]], planned: Collection[Question]
) -> list[PairedTest]:
    """Return the paired tests of all solvers on all target sets that can be reached.

    Success means within 1 mm and 0.1 degrees, inside the limits.
    """
    tests = []
    for field in fields:
        solved = {answers.solver: answers.success for answers in field}
        if field[0].targets.reachable is False:
            continue
        for a, b in combinations(solved, 2):
            only_a, only_b, p = mcnemar(solved[a], solved[b])
            tests.append(
                PairedTest(
                    targets=field[0].targets.name,
                    a=a,
                    b=b,
                    only_a=only_a,
                    only_b=only_b,
                    p=p,
                    p_holm=p,
                    planned=(a, b) in planned,
                )
            )
    return [test for family in (True, False) for test in _corrected(tests, family)]


def _corrected(tests: Sequence[PairedTest], planned: bool) -> list[PairedTest]:
    family = [test for test in tests if test.planned is planned]
    corrected = holm([test.p for test in family])
    return [replace(test, p_holm=p) for test, p in zip(family, corrected, strict=True)]


def summary(
    comparison: Comparison,
    fields: Sequence[Sequence[Answers]],
    questions: Collection[Question],
    left_out: Mapping[str, str],
    origin: Mapping[str, Any],
    *,
    complete: bool,
) -> dict[str, Any]:
    """Return the report: all statistics and all settings.

    Args:
        comparison: The comparison.
        fields: The results, per target set.
        questions: Planned comparisons of two solvers.
        left_out: Solvers that are not installed, with the reason.
        origin: What `provenance` told before the comparison.
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
        **origin,
    }
