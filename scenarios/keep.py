"""Keep a report for the tables of README and documentation: docs/results/NAME.json."""

import re
import sys
from dataclasses import dataclass
from pathlib import Path

from robo47_qp.report.importing import importing

with importing():
    from rich.console import Console

    from robo47_qp.cli import OK, main
    from robo47_qp.errors import InvalidValueError
    from robo47_qp.files import read_json, write_json
    from scenarios.papers.kept import RESULTS, to_keep
    from scenarios.papers.names import OWN_NAMES


@dataclass(frozen=True, kw_only=True)
class KeepOptions:
    """Options of this scenario."""

    report: Path
    """Report (JSON) of a command, made from a commit without changes."""
    name: str
    """Name of the kept file, without folder and ending."""

    def __post_init__(self) -> None:
        """Check what no type can.

        Raises:
            InvalidValueError: The name is not one of a file.
        """
        if not re.fullmatch(r"[a-z0-9_]+", self.name):
            raise InvalidValueError("--name", self.name, "small letters, digits and _")


def run(options: KeepOptions, console: Console) -> int:
    """Keep a report; returns the exit code."""
    kept = to_keep(read_json(options.report, "Name the report (.json) of a command."))
    kind = options.name.partition("_")[0]
    if kind in OWN_NAMES and options.name != OWN_NAMES[kind](kept):
        raise InvalidValueError(
            "--name", options.name, f"{OWN_NAMES[kind](kept)}, which is what the report is of"
        )
    write_json(RESULTS / f"{options.name}.json", kept)
    console.print(f"kept in docs/results/{options.name}.json; now: make tables", soft_wrap=True)
    return OK


if __name__ == "__main__":
    sys.exit(main(KeepOptions, run, __doc__))
