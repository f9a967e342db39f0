"""Journal: a file to which every finished episode is written at once."""

import json
import os
from collections.abc import Mapping, Sequence
from itertools import chain, count
from pathlib import Path
from typing import Any

from robo47_qp.errors import RecordingError, Robo47Error
from robo47_qp.evaluation.episode import EpisodeResult

_CHANGED = "changed"
"""Of a line that is no result: the settings that changed while the results were written."""


class JournalError(Robo47Error):
    """A journal that cannot be continued."""


class Journal:
    """A file of JSON lines: the settings, then the results in the order they arrive."""

    def __init__(self, path: Path, settings: Mapping[str, Any], *, resume: bool) -> None:
        """Open the file; `resume` continues it, otherwise an existing one is put aside.

        It is then called eval.jsonl.old, or eval.2.jsonl.old and so on where that is there.

        Raises:
            JournalError: The file has other settings, or is not a journal.
            RecordingError: It cannot be read or written.
        """
        self.path = path
        self.results: dict[int, EpisodeResult] = {}
        """Results by seed."""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.exists() and not resume:
                path.replace(_aside(path))
            whole = _whole_lines(path)
            self.results = _results(path, whole, settings)
            with path.open("ab") as file:
                file.truncate(len(whole))
            # Unbuffered: what a full disk does not take must not be written again when closing.
            self._file = path.open("ab", buffering=0)
            if not whole:
                self._write(_header(settings))
        except OSError as error:
            raise RecordingError(f"{path} cannot be written: {error.strerror}.") from error

    @property
    def judged(self) -> dict[int, EpisodeResult]:
        """Results by seed, without internal errors, which are run again."""
        return {seed: one for seed, one in self.results.items() if one.error is None}

    @staticmethod
    def read(path: Path, settings: Mapping[str, Any]) -> dict[int, EpisodeResult]:
        """Return the results in a file by seed; none if there is no file.

        Raises:
            JournalError: See `Journal`.
        """
        return _results(path, _whole_lines(path), settings)

    def add(self, result: EpisodeResult) -> None:
        """Write a result and wait until it is on the disk.

        Raises:
            RecordingError: It cannot be written.
        """
        self._add(result.entry())
        self.results[result.seed] = result

    def spoil(self, changed: Sequence[str]) -> None:
        """Write which settings have changed while it was written: it is never continued.

        Raises:
            RecordingError: It cannot be written.
        """
        self._add({_CHANGED: list(changed)})

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _add(self, content: Mapping[str, Any]) -> None:
        try:
            self._write(content)
        except OSError as error:
            raise RecordingError(
                f"{self.path} cannot be written to: {error.strerror}. It holds "
                f"{len(self.results)} episodes; make room and continue with --resume."
            ) from error

    def _write(self, content: Mapping[str, Any]) -> None:
        line = json.dumps(content, allow_nan=False, ensure_ascii=False)
        left = memoryview(f"{line}\n".encode())
        while left:
            left = left[self._file.write(left) :]
        os.fsync(self._file.fileno())


def _aside(path: Path) -> Path:
    """Return a name for an old journal that no other one has."""
    names = chain([path.name], (f"{path.stem}.{n}{path.suffix}" for n in count(2)))
    return next(old for name in names if not (old := path.with_name(f"{name}.old")).exists())


def _header(settings: Mapping[str, Any]) -> dict[str, Any]:
    return {"journal": 1, **settings}


def _whole_lines(path: Path) -> bytes:
    """Return the content of a file up to its last line break; empty if there is no file.

    An incomplete line was being written when the evaluation was killed.
    """
    content = path.read_bytes() if path.exists() else b""
    return content[: content.rfind(b"\n") + 1]


def _results(path: Path, whole: bytes, settings: Mapping[str, Any]) -> dict[int, EpisodeResult]:
    if not whole:
        return {}
    try:
        # Not `splitlines`: evidence may hold other characters that end a line.
        lines = whole.decode("utf-8").removesuffix("\n").split("\n")
        first, *entries = map(json.loads, lines)
        changed = [entry[_CHANGED] for entry in entries if _CHANGED in entry]
        results = [EpisodeResult.of_entry(entry) for entry in entries if _CHANGED not in entry]
        mixed = ", ".join(map(str, changed[0])) if changed else ""
    except (ValueError, TypeError, KeyError) as error:
        raise JournalError(
            f"{path} is not the journal of an evaluation: {error}. Name another file with --log, "
            "or start again without --resume."
        ) from error
    if changed:
        raise JournalError(
            f"{path} holds episodes of two versions; these changed while they ran: {mixed}. Name "
            "another file with --log, or start again without --resume."
        )
    differences = differences_of(first, json.loads(json.dumps(_header(settings))))
    if differences:
        raise JournalError(
            f"{path} is of another evaluation; these differ: {', '.join(differences)}. Ask for "
            "the same settings, name another file with --log, or start again without --resume."
        )
    return {result.seed: result for result in results}


def differences_of(found: Any, asked: Mapping[str, Any]) -> list[str]:
    """Return the names of the settings that differ, those asked for first."""
    if not isinstance(found, Mapping):
        return ["its form"]
    names = [*asked, *(name for name in found if name not in asked)]
    return [name for name in names if name not in found or found[name] != asked.get(name)]
