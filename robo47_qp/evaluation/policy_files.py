"""Files that a policy depends on: all in its folder, without what evaluations leave there."""

import os
from collections.abc import Collection, Iterable
from contextlib import suppress
from hashlib import file_digest, sha256
from pathlib import Path

from robo47_qp.errors import InvalidValueError

MOST = 10_000
"""Files in a policy's folder at most; where there are more, it is not a folder of its own."""
_SKIPPED = ("__pycache__", "logs")
_ENDINGS = (".rrd", ".rows", ".json", ".jsonl", ".jsonl.old", ".md", ".png", ".lock")
"""Of files that an evaluation or a run writes beside each other, under one name."""
_JOURNAL = b'{"journal":'
"""How a journal begins; other people's files of JSON lines are a policy's own."""


def package_folder(file: Path) -> Path | None:
    """Return the folder of the outermost package that a module belongs to; None for a lone one."""
    folder = None
    while (file.parent / "__init__.py").is_file():
        folder = file = file.parent
    return folder


def files_in(folder: Path) -> list[Path]:
    """Return all files in a folder and in those inside, links followed.

    Left out are hidden names, environments, caches of Python, folders called logs, what
    evaluations and runs have written, and where the output of this process goes.

    Raises:
        InvalidValueError: There are more than `MOST`.
    """
    found: list[Path] = []
    seen: set[Path] = set()
    for at, inside, names in os.walk(folder, followlinks=True):
        here = Path(at)
        written = _written(here, names)
        found += [here / n for n in names if n[0] != "." and n not in written]
        if len(found) > MOST:
            raise InvalidValueError(
                "policy",
                f"one in {folder} with more than that",
                f"in a folder of its own, with what it reads (at most {MOST} files): the files "
                "there are a part of it",
            )
        # A link may lead back to a folder above it.
        seen.add(here.resolve())
        inside[:] = sorted(n for n in inside if _counts(here / n, seen))
    return [path for path in sorted(found) if path.is_file() and not _is_output(path)]


def _is_output(path: Path) -> bool:
    """Return whether what this process prints is redirected to a file."""
    for stream in (1, 2):
        # A stream may be closed.
        with suppress(OSError):
            if os.path.samestat(path.stat(), os.fstat(stream)):
                return True
    return False


def digest_of(files: Iterable[Path], folder: Path | None) -> str:
    """Return the SHA-256 of files with their places in the folder, or their names elsewhere.

    What is no file, such as a pipe, does not count.
    """
    digest = sha256()
    for path in sorted(path for path in files if path.is_file()):
        inside = folder is not None and path.is_relative_to(folder)
        name = path.relative_to(folder or path).as_posix() if inside else path.name
        try:
            with path.open("rb") as file:
                content = file_digest(file, "sha256").digest()
        except (FileNotFoundError, PermissionError):
            continue  # the policy cannot read it, either
        digest.update(name.encode("utf-8", "surrogateescape") + b"\0" + content)
    return digest.hexdigest()


def _counts(folder: Path, seen: Collection[Path]) -> bool:
    if folder.name.startswith(".") or folder.name in _SKIPPED:
        return False
    return not (folder / "pyvenv.cfg").exists() and folder.resolve() not in seen


def _written(folder: Path, names: Collection[str]) -> set[str]:
    """Return what evaluations and runs have written: files named as a recording or a journal."""
    stems = {n.partition(".")[0] for n in names if n.endswith(".rrd") or _journal(folder / n)}
    return {n for n in names if n.endswith(_ENDINGS) and n.partition(".")[0] in stems}


def _journal(path: Path) -> bool:
    if path.suffix != ".jsonl":
        return False
    try:
        with path.open("rb") as file:
            return file.read(len(_JOURNAL)) == _JOURNAL
    except OSError:
        return False
