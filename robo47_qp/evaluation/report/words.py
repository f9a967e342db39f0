"""An evaluation in words: the report as Markdown, and a line for the terminal."""

from collections.abc import Mapping, Sequence
from typing import Any

MOST = 50
"""Failures that are listed one by one."""
SEEDS = 20
"""Seeds that are listed of a promise that broke."""
VARIED = "Of the task, what it is without a seed: each episode draws its own objects and places."


def rate_line(figures: Mapping[str, Any]) -> str:
    """Successes with their interval."""
    low, high = figures["interval"]
    return (
        f"{figures['successes']} of {figures['episodes']} succeeded, "
        f"{100 * figures['rate']:.1f} % (95 %: {100 * low:.1f} to {100 * high:.1f} %)"
    )


def causes_tail(figures: Mapping[str, Any]) -> str:
    """Causes of failure, to follow the rate; nothing where there is none."""
    counts = [f"{cause} {count}" for cause, count in figures["causes"].items()]
    return f"; failed: {', '.join(counts)}" if counts else ""


def comparison_line(comparison: Mapping[str, Any]) -> str:
    """A paired comparison in a sentence."""
    low, high = (100 * bound for bound in comparison["interval"])
    return (
        f"{comparison['a']} against {comparison['b']} on {comparison['episodes']} episodes: "
        f"{100 * comparison['difference']:+.1f} points (95 %: {low:+.1f} to {high:+.1f}); "
        f"{comparison['only_a']} to {comparison['only_b']} that only one solved, "
        + p_words(comparison)
    )


def p_words(comparison: Mapping[str, Any]) -> str:
    """The p of a comparison; of one among several, the corrected one."""
    if "p_holm" not in comparison:
        return f"p = {comparison['p']:.3g} (McNemar, exact)"
    return f"p = {comparison['p_holm']:.3g} (McNemar, exact; corrected by Holm)"


def counted(count: int, what: str) -> str:
    """A number of things."""
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def broken_line(figures: Mapping[str, Any]) -> str:
    """How many episodes broke a promise, and which; nothing where none did."""
    if not figures["broken_audits"]:
        return ""
    promises = ", ".join(f"{signal} {len(seeds)}" for signal, seeds in _broken(figures).items())
    return f"{counted(figures['broken_audits'], 'episode')} broke the audit: {promises}"


def cause_lines(figures: Mapping[str, Any]) -> list[str]:
    """Each cause of failure with the evidence of the first episode."""
    first = {e["cause"]: e for e in reversed(figures["entries"]) if e["cause"] is not None}
    return [
        f"  {cause:<10} {count}; seed {first[cause]['seed']}: {first[cause]['evidence']}"
        for cause, count in figures["causes"].items()
    ]


def markdown(figures: Mapping[str, Any], pictures: Sequence[str]) -> str:
    """The report; `pictures` are files beside it."""
    lines = [f"# {figures['task']} with {figures['policy']}", "", rate_line(figures) + ".", ""]
    if figures["errors"]:
        ended = counted(figures["errors"], "episode")
        lines += [f"**{ended} ended with an error of our own.**", ""]
    if "comparison" in figures:
        lines += [comparison_line(figures["comparison"]) + ".", ""]
    if figures["causes"]:
        lines += ["## Why episodes failed", "", *table(("cause", "episodes"), _causes(figures))]
    if figures["broken_audits"]:
        lines += ["## Promises of the audit that broke", ""]
        lines += table(("promise", "episodes", "seeds"), _promises(figures))
    if figures["figures"]:
        lines += ["## Figures of the successes", ""]
        lines += table(("figure", "median", "95th percentile", "largest"), _rows(figures))
    lines += [f"![{name}]({name})\n" for name in pictures]
    failures = [e for e in figures["entries"] if not e["success"]]
    if failures:
        lines += ["## Failures", ""]
        lines += table(("seed", "cause", "step", "time s", "evidence"), map(_failure, failures))
    if figures.get("timing"):
        lines += ["## Throughput", "", throughput_line(figures["timing"]) + ".", ""]
    lines += ["## Settings", "", VARIED, ""]
    lines += table(("setting", "value"), settings_rows(figures["settings"]))
    lines += ["## Versions", "", *table(("package", "version"), figures["versions"].items())]
    return "\n".join(lines)


def throughput_line(timing: Mapping[str, Any]) -> str:
    """How fast it went."""
    return (
        f"{counted(timing['episodes'], 'episode')} in {timing['wall_s']:.1f} s on "
        f"{counted(timing['workers'], 'worker')}: {timing['episodes_per_minute']:.1f} per minute, "
        f"{timing['episodes_per_minute_per_worker']:.1f} per worker"
    )


def table(head: Sequence[str], rows: Any) -> list[str]:
    """A table with as many rows as are read; the rest is told."""
    every = list(rows)
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(map(_cell, row)) + " |" for row in every[:MOST]]
    if len(every) > MOST:
        lines.append(f"\n{len(every) - MOST} more are in the JSON file.")
    return [*lines, ""]


def _broken(figures: Mapping[str, Any]) -> dict[str, list[int]]:
    """Seeds by the promise that broke, the one that broke most often first."""
    seeds: dict[str, list[int]] = {}
    for entry in figures["entries"]:
        for signal in entry["broken_promises"]:
            seeds.setdefault(signal, []).append(entry["seed"])
    return dict(sorted(seeds.items(), key=lambda item: -len(item[1])))


def _promises(figures: Mapping[str, Any]) -> list[tuple[str, int, str]]:
    rows = []
    for signal, seeds in _broken(figures).items():
        more = f" and {len(seeds) - SEEDS} more" if len(seeds) > SEEDS else ""
        rows.append((signal, len(seeds), ", ".join(map(str, seeds[:SEEDS])) + more))
    return rows


def _causes(figures: Mapping[str, Any]) -> list[tuple[str, int]]:
    return list(figures["causes"].items())


def _rows(figures: Mapping[str, Any]) -> list[tuple[str, ...]]:
    return [
        (name, *(f"{column[key]:.4g}" for key in ("median", "p95", "max")))
        for name, column in figures["figures"].items()
    ]


def settings_rows(settings: Mapping[str, Any]) -> list[tuple[str, object]]:
    """One row for each; the versions have a table of their own."""
    rows: list[tuple[str, object]] = []
    for name, value in settings.items():
        if name == "versions":
            continue
        if isinstance(value, Mapping):
            rows += [(f"{name}: {inner}", one) for inner, one in value.items()]
        else:
            rows.append((name, value))
    return rows


def _failure(entry: Mapping[str, Any]) -> tuple[Any, ...]:
    if entry["error"] is not None:
        return entry["seed"], "error", "", "", entry["error"].splitlines()[-1]
    time = "" if entry["time"] is None else f"{entry['time']:.2f}"
    return entry["seed"], entry["cause"], entry["step"] or "", time, entry["evidence"]


def _cell(value: object) -> str:
    return str(value).replace("|", "\\|").replace("\n", " ")
