"""Result files that the repository keeps, docs/results/*.json."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from robo47_qp.errors import RecordingError
from robo47_qp.files import read_json

RESULTS = Path(__file__).resolve().parents[2] / "docs" / "results"
"""Folder of the kept results."""
REPRODUCED = "reproduced"
"""Name of the figures that `make reproduce` gives, beside that folder."""
ORIGIN = ("command", "commit", "changed", "date", "machine", "versions")
"""What every kept result tells of its making, as `robo47_qp.report.provenance` does."""


def is_kept(name: str) -> bool:
    """Return whether a result of a name is kept."""
    return (RESULTS / f"{name}.json").is_file()


def kept(name: str) -> dict[str, Any]:
    """Read a kept result by the name of its file.

    Raises:
        RecordingError: There is none, or it does not tell where it comes from.
    """
    content = read_json(RESULTS / f"{name}.json", "Keep a report first: scenarios/keep.py")
    missing = [key for key in ORIGIN if key not in content]
    if missing:
        raise RecordingError(f"docs/results/{name}.json does not tell its {', '.join(missing)}.")
    return content


def to_keep(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return what is kept of a report: its origin first; of episodes, what stopped the failed ones.

    Raises:
        RecordingError: The report does not tell its origin, or was not made by a commit.
    """
    origin = report.get("provenance", {key: report[key] for key in ORIGIN if key in report})
    missing = [key for key in ORIGIN if key not in origin]
    if missing:
        raise RecordingError(
            f"The report must tell its {', '.join(missing)}; make it with a command that does."
        )
    if origin["commit"] is None or origin["changed"]:
        raise RecordingError(
            "The report was made by files that no commit holds: commit them and make it again."
        )
    # Which folder a report was written to is of that machine alone.
    origin = {**origin, "command": re.sub(r"(?<![^\s='])/(?:[^\s/']+/)*", "", origin["command"])}
    rest = {k: v for k, v in report.items() if k not in ORIGIN and k != "provenance"}
    if "entries" in rest:
        entries = rest.pop("entries")
        rest["seeds"] = [entries[0]["seed"], entries[-1]["seed"]] if entries else []
        rest["failures"] = [
            {key: entry[key] for key in ("seed", "cause", "evidence", "step", "error")}
            for entry in entries
            if not entry["success"]
        ]
        rest["broken"] = {
            str(entry["seed"]): entry["broken_promises"]
            for entry in entries
            if entry["broken_promises"]
        }
    return {**origin, **rest}


def reproduced() -> dict[str, Any]:
    """Read the figures of `make keep`, which tests hold to those of the code as it is."""
    return read_json(RESULTS.parent / f"{REPRODUCED}.json", "Make them with `make keep`.")


def origin_line(results: Mapping[str, Mapping[str, Any]], files: str | None = None) -> str:
    """Return where the figures of some kept results come from, as a line of Markdown.

    Args:
        results: The results by name.
        files: What stands for their names; None names each.
    """
    commits = dict.fromkeys(result["commit"][:10] for result in results.values())
    dates = sorted({result["date"] for result in results.values()})
    named = ", ".join(f"`docs/results/{name}.json`" for name in ([files] if files else results))
    when = dates[0] if len(dates) == 1 else f"{dates[0]} to {dates[-1]}"
    word = "Commit" if len(commits) == 1 else "Commits"
    return f"{word} {', '.join(f'`{one}`' for one in commits)}, {when}; {named}."
