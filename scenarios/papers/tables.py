"""The tables that README and documentation hold, each made from kept results."""

from collections.abc import Callable
from typing import Any

from scenarios.papers.blocks import markdown_table
from scenarios.papers.kept import kept, origin_line


def evaluations(*names: str) -> str:
    """Success of some evaluations, a row each."""
    results = {name: kept(name) for name in names}
    heads = {
        "task": "---",
        "seeds": "--:",
        "succeeded": "--:",
        "95 % interval": "--:",
        "causes of failure": "---",
        "audits kept": "--:",
        "median cycle": "--:",
    }
    rows = [_evaluation(result) for result in results.values()]
    return f"{markdown_table(heads, rows)}\n\n{origin_line(results)}"


def _evaluation(result: dict[str, Any]) -> list[str]:
    low, high = (100 * bound for bound in result["interval"])
    first, last = result["seeds"]
    causes = ", ".join(f"{cause} {count}" for cause, count in result["causes"].items())
    audits = result["episodes"] - result["errors"] - result["broken_audits"]
    cycle = result["figures"].get("cycle_time_s", {}).get("median")
    return [
        f"`{result['task']}`",
        f"{first} to {last}",
        f"{result['successes']} of {result['episodes']}",
        f"{low:.1f} – {high:.1f} %",
        causes or "–",
        str(audits),
        "–" if cycle is None else f"{cycle:.1f} s",
    ]


TABLES: dict[str, Callable[..., str]] = {"evaluations": evaluations}
"""What writes a table, by the name that a page gives."""
