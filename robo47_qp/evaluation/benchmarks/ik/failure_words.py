"""What the recording of a comparison says about a failure, in Markdown."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from robo47_qp.evaluation.benchmarks.ik.answers import Answers
from robo47_qp.evaluation.benchmarks.ik.outcome import COLOURS, Outcome


def why(answers: Answers, k: int, outcome: Outcome, place: str) -> str:
    """One failure: what was wanted, what came back, and the solver's own words.

    Args:
        answers: All answers of the solver.
        k: Which of them.
        outcome: What became of it.
        place: Which failure this is, of how many.
    """
    answer = answers.items[k]
    verdict = answer.verdict
    kinds = answers.targets.kinds
    lines = [
        f"# {answers.solver}: {outcome.value}",
        "",
        f"Failure {place}: target {k} of `{answers.targets.name}`"
        + (f" ({kinds[k]})" if kinds else ""),
        "",
        "| | |",
        "|---|--:|",
        f"| tool off by | {1e3 * verdict.position_error:.3g} mm |",
        f"| and | {np.degrees(verdict.orientation_error):.3g}° |",
        f"| outside the limits by | {verdict.limit_excess:.3g} rad |",
        f"| steps | {answer.iterations} |",
        f"| restarts | {answer.restarts} |",
        f"| processor time | {1e3 * answer.seconds:.3g} ms |",
    ]
    if verdict.pair is not None:
        first, second = verdict.pair
        lines.append(f"| {first} in {second} | {1e3 * verdict.penetration:.1f} mm |")
    said = "reached" if answer.reason is None else answer.reason
    lines += ["", f"The solver says: **{said}**. {answer.explanation}", ""]
    lines += ["q = " + " ".join(f"{value:.4f}" for value in answer.q) + " rad"]
    return "\n".join(lines)


def legend() -> str:
    """What the colours of the targets mean."""
    lines = ["| colour (red, green, blue) | outcome |", "|---|---|"]
    lines += [f"| {COLOURS[outcome]} | {outcome.value} |" for outcome in Outcome]
    return "\n".join(lines)


def figures_markdown(summary: Mapping[str, Any]) -> str:
    """The rows of a report as tables."""
    rows: Sequence[Mapping[str, Any]] = summary["rows"]
    lines = [f"# Inverse kinematics of {summary['robot']}, seed {summary['seed']}", ""]
    for name in dict.fromkeys(row["targets"] for row in rows):
        own = [row for row in rows if row["targets"] == name]
        lines += [
            f"## {name}, {own[0]['n']} targets",
            "",
            "| solver | success % | 95 % interval | tight % | collision-free % | outside limits "
            "| median ms | p95 ms | p99 ms |",
            "|---|--:|--:|--:|--:|--:|--:|--:|--:|",
        ]
        lines += [
            f"| {row['solver']} | {100 * row['success']:.2f} | {100 * row['interval'][0]:.2f} – "
            f"{100 * row['interval'][1]:.2f} | {100 * row['tight']:.2f} | "
            f"{100 * row['collision_free']:.2f} | {row['limit_violations']} | "
            f"{row['median_ms']:.3f} | {row['p95_ms']:.3f} | {row['p99_ms']:.3f} |"
            for row in own
        ]
        lines.append("")
    return "\n".join(lines)
