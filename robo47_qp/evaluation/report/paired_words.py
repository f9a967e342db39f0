"""A comparison of several policies in words: Markdown."""

from collections.abc import Iterator, Mapping
from typing import Any

from robo47_qp.evaluation.report.paired import CYCLE
from robo47_qp.evaluation.report.words import (
    VARIED,
    comparison_line,
    settings_rows,
    table,
)

_POLICIES = ("policy", "succeeded", "95 %", "causes of failure", "audits broken", "cycle time s")
_DIFFERENCES = (
    "against the baseline",
    "points",
    "95 %",
    "p",
    "p (Holm)",
    "only it solved",
    "only the baseline solved",
    "cycle time s",
)
_SEEDS = ("seed", "solved by", "not by", "cause", "step", "time s", "evidence")


def paired_markdown(figures: Mapping[str, Any]) -> str:
    """The report; the links are files beside it."""
    policies, comparisons = figures["policies"], figures["comparisons"]
    lines = [f"# {figures['task']}: {len(policies)} policies on the same seeds", ""]
    lines += [f"{figures['episodes']} episodes each; Wilson intervals.", ""]
    lines += table(_POLICIES, map(_policy, policies))
    lines += [f"## Against {figures['baseline']}", ""]
    lines += table(_DIFFERENCES, map(_difference, comparisons))
    lines += [
        "Points are percentage points of success, with Bonett and Price's interval; p is that of "
        "McNemar's exact test, and beside it what Holm's correction for several comparisons makes "
        "of it. Cycle times differ by the median over the episodes that both solved.",
        "",
    ]
    for comparison in comparisons:
        lines += [f"## {comparison['a']}", "", f"{comparison_line(comparison)}.", ""]
        if comparison["identical"]:
            lines += [f"{comparison['identical']} episodes are the same to the bit.", ""]
        if comparison["differing"]:
            lines += ["Episodes that only one solved:", ""]
            lines += table(_SEEDS, _seeds(comparison))
    lines += ["## Settings", "", VARIED, ""]
    lines += table(("setting", "value"), settings_rows(figures["settings"]))
    lines += ["## Versions", "", *table(("package", "version"), figures["versions"].items())]
    return "\n".join(lines)


def _policy(own: Mapping[str, Any]) -> tuple[str, ...]:
    causes = {**own["causes"], **({"error of our own": own["errors"]} if own["errors"] else {})}
    median = own[f"median_{CYCLE}"]
    return (
        f"[{own['policy']}]({own['report']})",
        f"{own['successes']} of {own['episodes']}",
        "{:.1f} to {:.1f} %".format(*(100.0 * bound for bound in own["interval"])),
        ", ".join(f"{cause} {count}" for cause, count in causes.items()) or "none",
        str(own["broken_audits"]),
        "" if median is None else f"{median:.2f}",
    )


def _difference(comparison: Mapping[str, Any]) -> tuple[str, ...]:
    median = comparison[CYCLE]["median_difference"]
    return (
        comparison["a"],
        f"{100.0 * comparison['difference']:+.1f}",
        "{:+.1f} to {:+.1f}".format(*(100.0 * bound for bound in comparison["interval"])),
        f"{comparison['p']:.3g}",
        f"{comparison['p_holm']:.3g}",
        str(comparison["only_a"]),
        str(comparison["only_b"]),
        "" if median is None else f"{median:+.2f}",
    )


def _seeds(comparison: Mapping[str, Any]) -> Iterator[tuple[Any, ...]]:
    for episode in comparison["differing"]:
        winner = episode["solved_by"]
        time = "" if episode["time"] is None else f"{episode['time']:.2f}"
        yield (
            episode["seed"],
            comparison[winner],
            comparison["b" if winner == "a" else "a"],
            episode["cause"],
            episode["step"] or "",
            time,
            episode["evidence"],
        )
