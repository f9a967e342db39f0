"""Files that are written and read: text, JSON, and the checks before."""

import json
import shutil
import sys
from pathlib import Path
from typing import Any

from robo47_qp.errors import RecordingError

if sys.platform != "win32":
    import resource


def check_writable(path: Path) -> None:
    """Check that a file can be written, before anything moves.

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
        taken = isinstance(error, (FileExistsError, NotADirectoryError))
        reason = "its folder is a file" if taken else error.strerror
        raise RecordingError(
            f"{path} cannot be written: {reason}. Name a file in a folder that you may write to, "
            "on a disk that is there."
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


def free_space(path: Path) -> float:
    """Return the bytes by which a file can still grow; infinite where that is not known."""
    try:
        left = float(shutil.disk_usage(path.parent).free)
        if sys.platform != "win32":
            limit, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
            if limit != resource.RLIM_INFINITY:
                left = min(left, limit - path.stat().st_size)
    except OSError:
        return float("inf")
    return left


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write an object, its folder included; numbers keep all of their digits.

    Raises:
        RecordingError: The file cannot be written, or holds NaN or infinity.
    """
    try:
        text = json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False)
    except ValueError as error:
        raise RecordingError(f"{path} must hold finite numbers: {error}.") from error
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise RecordingError(f"{path} cannot be written: {error.strerror}.") from error


def read_json(path: Path, remedy: str) -> dict[str, Any]:
    """Read an object.

    Args:
        path: The file.
        remedy: What makes it, for the message.

    Raises:
        RecordingError: The file is missing or holds something else.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror}. {remedy}") from error
    except ValueError as error:
        raise RecordingError(f"{path} does not hold JSON: {error}. {remedy}") from error
    if not isinstance(content, dict):
        found = type(content).__name__
        raise RecordingError(f"{path} must hold an object; found a {found}. {remedy}")
    return content
