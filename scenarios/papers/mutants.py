"""The table of mistakes made on purpose, from the kept result of tests/mutants.py."""

from pathlib import PurePath

from scenarios.papers.blocks import markdown_table
from scenarios.papers.kept import is_kept, kept, origin_line


def mutants() -> str:
    """Mistakes tried and caught: a row for each room of the package."""
    if not is_kept("mutants"):
        return "No result of this kind is kept yet."
    found, rooms = kept("mutants"), dict[str, list[bool]]()
    for row in found["rows"]:
        top, *rest = PurePath(row["file"]).parts
        rooms.setdefault(top if top == "tasks" else rest[0], []).append(row["by"] is not None)
    rows = [[f"`{room}`", str(len(caught)), str(sum(caught))] for room, caught in rooms.items()]
    rows.append(["all", str(found["mutants"]), str(found["caught"])])
    heads = {"room": "---", "mistakes": "--:", "caught": "--:"}
    return f"{markdown_table(heads, rows)}\n\n{origin_line({'mutants': found})}"
