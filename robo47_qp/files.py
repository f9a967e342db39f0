"""Files that a scenario writes: claimed before it runs, written when it is done."""

import shutil
import sys
from pathlib import Path

from robo47_qp.errors import RecordingError

if sys.platform != "win32":
    import resource


def claim(path: Path) -> None:
    """Make sure that a file can be written, before anything moves.

    Raises:
        RecordingError: It cannot.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        new = not path.exists()
        with path.open("ab"):
            pass
        if new:
            path.unlink()
    except OSError as error:
        raise RecordingError(
            f"{path} cannot be written: {error.strerror}. Name a file in a folder that you may "
            "write to."
        ) from error


def write_text(path: Path, text: str) -> None:
    """Write a text file that ends with a line break.

    Raises:
        RecordingError: It cannot be written.
    """
    try:
        path.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise RecordingError(f"{path} cannot be written: {error.strerror}.") from error


def room(path: Path) -> float:
    """Bytes by which a file can still grow, as far as that can be told."""
    try:
        left = float(shutil.disk_usage(path.parent).free)
        if sys.platform != "win32":
            limit, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
            if limit != resource.RLIM_INFINITY:
                left = min(left, limit - path.stat().st_size)
    except OSError:
        return float("inf")
    return left
