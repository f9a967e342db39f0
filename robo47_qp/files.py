"""Files that are written and read: text, JSON, and the checks before; objects as JSON types."""

import dataclasses
import errno
import json
import os
import shutil
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from enum import Enum
from math import isfinite
from pathlib import Path
from typing import IO, Any

import numpy as np
from mink import SE3

from robo47_qp.errors import RecordingError

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl
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
        raise _unwritable(path, error) from error


def _unwritable(path: Path, error: OSError) -> RecordingError:
    taken = isinstance(error, (FileExistsError, NotADirectoryError))
    reason = "its folder is a file" if taken else error.strerror
    return RecordingError(
        f"{path} cannot be written: {reason}. Name a file in a folder that you may write to, "
        "on a disk that is there."
    )


@contextmanager
def claimed(path: Path) -> Iterator[None]:
    """Keep the files of one name to this process: a recording and what lies beside it.

    The file with the ending .lock is locked until the end, or until the process is killed.

    Args:
        path: One of the files.

    Raises:
        RecordingError: Another process has claimed them; nothing can be written there.
    """
    lock = path.with_suffix(".lock")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = lock.open("ab")
        # What was locked may have been removed by the process that had it before.
        while not (_locked(file) and _is_at(file, lock)):
            held = _is_at(file, lock)
            file.close()
            if held:
                raise RecordingError(
                    f"{path} is being written by another process. Wait until that has ended, or "
                    "name another file."
                )
            file = lock.open("ab")
    except OSError as error:
        raise _unwritable(path, error) from error
    try:
        yield
    finally:
        lock.unlink(missing_ok=True)
        file.close()


def _locked(file: IO[bytes]) -> bool:
    """Lock a file until it is closed; return False if another process has locked it.

    Raises:
        OSError: It cannot be locked at all.
    """
    try:
        if sys.platform == "win32":
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno not in (errno.EWOULDBLOCK, errno.EACCES, errno.EDEADLK):
            file.close()
            Path(file.name).unlink(missing_ok=True)
            raise
        return False
    return True


def _is_at(file: IO[bytes], path: Path) -> bool:
    """Return whether an open file is the one at a path."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except OSError:
        return False


def write_text(path: Path, text: str) -> None:
    """Write a text file that ends with a line break; lone surrogates are escaped.

    Raises:
        RecordingError: It cannot be written.
    """
    content = (text + "\n").encode("utf-8", "backslashreplace")
    try:
        path.write_bytes(content)
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
    except OSError as error:
        raise RecordingError(f"{path} cannot be written: {error.strerror}.") from error
    write_text(path, text)


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


def plain(value: object) -> Any:
    """Return a setting as JSON types: dataclasses by field, with the name of their class.

    Infinity and NaN, which JSON lacks, become text; so do paths, and the keys of a mapping. Other
    objects become the name of their class.
    """
    match value:
        case Enum():
            value = value.value
        case np.ndarray() | np.generic():
            value = value.tolist()
        case Path():
            value = str(value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        names = [f.name for f in dataclasses.fields(value)]
        if isinstance(value, SE3):
            names = ["wxyz_xyz"]  # the others are sizes that every SE3 has
        return {"class": type(value).__name__, **{n: plain(getattr(value, n)) for n in names}}
    match value:
        case float() if not isfinite(value):
            return str(value)
        case tuple() | list():
            return [plain(item) for item in value]
        case Mapping():
            return {str(key): plain(item) for key, item in value.items()}
        case None | bool() | int() | float() | str():
            return value
    return {"class": type(value).__name__}
