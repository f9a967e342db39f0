"""Where a figure comes from: command, commit, versions, date and machine."""

import os
import platform
import shlex
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import robo47_qp
from robo47_qp.report.run_report import versions


def provenance() -> dict[str, Any]:
    """Return what a result that is kept has to say about its making (JSON types).

    To be called before the work begins: files may change while it runs. `commit` is that of the
    checkout from which the package was imported, None for an installed
    one; `changed` tells that its files were not those of the commit.
    """
    commit, program = _git("rev-parse", "HEAD"), Path(sys.argv[0]).name
    return {
        "command": shlex.join(["robo47" if program == "__main__.py" else program, *sys.argv[1:]]),
        "commit": commit,
        "changed": commit is not None and bool(_git("status", "--porcelain")),
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "machine": {
            "processor": platform.machine(),
            "system": platform.system(),
            "cores": os.cpu_count(),
            "load": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
        },
        "versions": versions(),
    }


def _git(*arguments: str) -> str | None:
    """Return what git tells about the checkout; None where there is neither."""
    folder = Path(robo47_qp.__file__).parents[1]
    if not (folder / ".git").exists():
        return None
    try:
        told = subprocess.run(
            ["git", "-C", str(folder), *arguments],
            capture_output=True,
            text=True,
            check=True,
            timeout=10,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return told.stdout.strip()
