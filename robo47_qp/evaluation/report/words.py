"""An evaluation as text: lines for the terminal, and reports in Markdown."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from robo47_qp.evaluation.episode import EpisodeResult
from robo47_qp.evaluation.report.not_judged import NotJudged
from robo47_qp.evaluation.report.paired import PairedComparison
from robo47_qp.evaluation.report.report import (
    EvaluationReport,
    PolicyComparison,
    Throughput,
    median_cycle_time,
)
from robo47_qp.run.policy.child import one_line

MOST = 50
"""Rows of a table at most."""
SEEDS = 20
"""Seeds that are listed per violated limit."""
_VARIED = "The task is given without a seed: each episode draws its own objects and places."
_TOLD = "What the audit tells with its true values, and does not judge for some of the time."
_EXEMPT = (
    *("quantity", "episodes", "% of their time: median", "most"),
    *("furthest", "its limit", "seed", "why"),
)
_POLICIES = ("policy", "succeeded", "95 %", "causes of failure", "audits broken", "cycle time s")
_DIFFERENCES = (
    *("against the baseline", "points", "95 %", "p", "p (Holm)"),
    *("only it solved", "only the baseline solved", "cycle time s"),
)
_UNEQUAL = ("seed", "solved by", "not by", "cause", "step", "time s", "evidence")


def rate_line(report: EvaluationReport) -> str:
    """Return successes, those at the first attempt as far as measured, and their interval."""
    if not report.judged:
        return "no episode was judged"
    low, high = report.interval
    first = report.first_attempts
    retried = "" if first is None else f" ({first} at the first attempt)"
    return (
        f"{report.successes} of {report.judged} succeeded{retried}, "
        f"{100 * report.rate:.1f} % (95 %: {100 * low:.1f} to {100 * high:.1f} %)"
    )


def causes_tail(report: EvaluationReport) -> str:
    """Return the causes of failure, to follow the rate; empty without failures."""
    counts = [f"{cause} {count}" for cause, count in report.causes.items()]
    return f"; failed: {', '.join(counts)}" if counts else ""


def comparison_line(comparison: PairedComparison) -> str:
    """Return a paired comparison as a sentence, with the corrected p if there is one.

    Settings beside the policy that differ are told.
    """
    low, high = (100 * bound for bound in comparison.interval)
    p = f"p = {comparison.p:.3g} (McNemar, exact)"
    if comparison.p_holm is not None:
        p = f"p = {comparison.p_holm:.3g} (McNemar, exact; corrected by Holm)"
    names = ", ".join(comparison.settings)
    also = f"; not the policy alone differs, also: {names}" if names else ""
    return (
        f"{comparison.a} against {comparison.b} on {comparison.episodes} episodes: "
        f"{100 * comparison.difference:+.1f} points (95 %: {low:+.1f} to {high:+.1f}); "
        f"{comparison.only_a} to {comparison.only_b} that only one solved, {p}{also}"
    )


def counted(count: int, what: str) -> str:
    """Return a number with its noun."""
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def broken_line(report: EvaluationReport) -> str:
    """Return how many episodes violated the audit, and which limits; empty if none did."""
    if not report.broken_audits:
        return ""
    limits = ", ".join(f"{signal} {len(seeds)}" for signal, seeds in _broken(report).items())
    return f"{counted(report.broken_audits, 'episode')} violated the audit: {limits}"


def cause_lines(report: EvaluationReport) -> list[str]:
    """Return each cause of failure with the evidence of its first episode."""
    first = {r.cause: r for r in reversed(report.results) if r.cause is not None}
    return [
        f"  {cause:<10} {count}; seed {first[cause].seed}: {first[cause].evidence}"
        for cause, count in report.causes.items()
    ]


def throughput_line(timing: Throughput) -> str:
    """Return how fast the evaluation ran."""
    return (
        f"{counted(timing.episodes, 'episode')} in {timing.wall_s:.1f} s on "
        f"{counted(timing.workers, 'worker')}: {timing.episodes_per_minute:.1f} per minute, "
        f"{timing.episodes_per_minute_per_worker:.1f} per worker"
    )


def markdown(report: EvaluationReport, pictures: Sequence[str]) -> str:
    """Return the report of one policy; `pictures` are files beside it."""
    lines = [f"# {report.task} with {report.policy}", "", rate_line(report) + ".", ""]
    if report.errors:
        lines += [f"**{counted(len(report.errors), 'episode')} ended with an internal error.**", ""]
    if report.comparison is not None:
        lines += [comparison_line(report.comparison) + ".", ""]
    if report.causes:
        lines += ["## Causes of failure", ""]
        lines += _table(("cause", "episodes"), report.causes.items())
    if report.broken_audits:
        lines += ["## Violated limits", ""]
        lines += _table(("limit", "episodes", "seeds"), _violations(report))
    if report.not_judged:
        lines += ["## Not judged", "", _TOLD, ""]
        lines += _table(_EXEMPT, map(_not_judged, report.not_judged))
    if report.figures:
        lines += ["## Figures of the successful episodes", ""]
        rows = (
            (name, *(f"{value:.4g}" for value in (figure.median, figure.p95, figure.max)))
            for name, figure in report.figures.items()
        )
        lines += _table(("figure", "median", "95th percentile", "largest"), rows)
    lines += [f"![{name}]({name})\n" for name in pictures]
    failures = [result for result in report.results if not result.success]
    if failures:
        lines += ["## Failures", ""]
        head = ("seed", "cause", "step", "time s", "evidence")
        lines += _table(head, ((r.seed, *_stopped(r)) for r in failures))
    if report.timing is not None:
        lines += ["## Throughput", "", throughput_line(report.timing) + ".", ""]
    return "\n".join([*lines, *_settings(report.settings, report.versions)])


def _not_judged(one: NotJudged) -> tuple[object, ...]:
    shares = (f"{100.0 * share:.1f}" for share in (one.median_share, one.max_share))
    values = (f"{value:.4g} {one.unit}" for value in (one.extreme, one.limit))
    return (one.signal, one.episodes, *shares, *values, one.seed, one.why)


def paired_markdown(comparison: PolicyComparison) -> str:
    """Return the report of several policies; the links are files beside it."""
    first = comparison.baseline
    lines = [f"# {first.task}: {len(comparison.reports)} policies on the same seeds", ""]
    lines += [f"{first.episodes} episodes each; Wilson intervals.", ""]
    lines += _table(_POLICIES, (_policy(*named) for named in comparison.reports.items()))
    lines += [f"## Against {first.policy}", ""]
    lines += _table(_DIFFERENCES, map(_difference, comparison.comparisons))
    lines += [
        "Points are percentage points of the success rate, with the interval of Bonett and Price; "
        "p is that of McNemar's exact test, followed by p after Holm's correction for several "
        "comparisons. The difference of cycle times is the median over the episodes that both "
        "solved.",
        "",
    ]
    for one in comparison.comparisons:
        lines += [f"## {one.a}", "", f"{comparison_line(one)}.", ""]
        if one.identical:
            lines += [f"{counted(one.identical, 'episode')} identical bit by bit.", ""]
        if one.differing:
            lines += ["Episodes that only one solved:", "", *_table(_UNEQUAL, _unequal(one))]
    return "\n".join([*lines, *_settings(comparison.settings, first.versions)])


def _policy(file: str, report: EvaluationReport) -> tuple[str, ...]:
    causes = dict(report.causes)
    if report.errors:
        causes["internal error"] = len(report.errors)
    low, high = report.interval
    return (
        f"[{report.policy}]({file})",
        f"{report.successes} of {report.judged}",
        f"{100.0 * low:.1f} to {100.0 * high:.1f} %",
        ", ".join(f"{cause} {count}" for cause, count in causes.items()) or "none",
        str(report.broken_audits),
        _optional(median_cycle_time(report), ".2f"),
    )


def _difference(comparison: PairedComparison) -> tuple[object, ...]:
    low, high = comparison.interval
    return (
        comparison.a,
        f"{100.0 * comparison.difference:+.1f}",
        f"{100.0 * low:+.1f} to {100.0 * high:+.1f}",
        f"{comparison.p:.3g}",
        _optional(comparison.p_holm, ".3g"),
        comparison.only_a,
        comparison.only_b,
        _optional(comparison.cycle_time_s.median_difference, "+.2f"),
    )


def _unequal(comparison: PairedComparison) -> Iterator[tuple[object, ...]]:
    names = comparison.a, comparison.b
    for one in comparison.differing:
        solved, failed = names if one.solved_by == "a" else names[::-1]
        time = _optional(one.time, ".2f")
        yield one.seed, solved, failed, one.cause, one.step or "", time, one.evidence


def _stopped(result: EpisodeResult) -> tuple[object, ...]:
    time = _optional(result.time, ".2f")
    return result.failure, result.step or "", time, result.explanation


def _optional(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)


def _broken(report: EvaluationReport) -> dict[str, list[int]]:
    """Return the seeds by violated limit, the most frequent one first."""
    seeds: dict[str, list[int]] = {}
    for result in report.results:
        for signal in result.broken_promises:
            seeds.setdefault(signal, []).append(result.seed)
    return dict(sorted(seeds.items(), key=lambda item: -len(item[1])))


def _violations(report: EvaluationReport) -> Iterator[tuple[str, int, str]]:
    for signal, seeds in _broken(report).items():
        more = f" and {len(seeds) - SEEDS} more" if len(seeds) > SEEDS else ""
        yield signal, len(seeds), ", ".join(map(str, seeds[:SEEDS])) + more


def _settings(settings: Mapping[str, Any], versions: Mapping[str, str]) -> list[str]:
    rows: list[tuple[str, object]] = []
    for name, value in settings.items():
        if name == "versions":
            continue
        inner = value.items() if isinstance(value, Mapping) else None
        rows += [(name, value)] if inner is None else [(f"{name}: {key}", v) for key, v in inner]
    lines = ["## Settings", "", _VARIED, "", *_table(("setting", "value"), rows)]
    return [*lines, "## Versions", "", *_table(("package", "version"), versions.items())]


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    """Return a table of at most `MOST` rows, and how many were left out."""
    every = list(rows)
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(map(_cell, row)) + " |" for row in every[:MOST]]
    if len(every) > MOST:
        lines.append(f"\n{len(every) - MOST} more are in the JSON file.")
    return [*lines, ""]


def _cell(value: object) -> str:
    """Return a value as text that ends neither its cell nor the table, whoever wrote it."""
    return one_line(str(value)).replace("|", "\\|").replace("<", "&lt;")
