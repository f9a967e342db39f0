"""Journal: every finished episode in a line of its own, on disk before the next one counts."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TextIO

from robo47_qp.errors import RecordingError, Robo47Error
from robo47_qp.evaluation.episode import EpisodeResult


class JournalError(Robo47Error):
    """A journal that cannot be gone on with."""


class Journal:
    """A file of JSON lines: first the settings, then results as they come."""

    def __init__(self, path: Path, settings: Mapping[str, Any], *, resume: bool) -> None:
        """Open the file.

        Args:
            path: The file. Without `resume`, one that is there is kept beside it, as .old.
            settings: What the results depend on.
            resume: Go on with the file, if there is one.

        Raises:
            JournalError: The file is of an evaluation with other settings, or no journal.
            RecordingError: It cannot be read or written.
        """
        self.path = path
        self.results: dict[int, EpisodeResult] = {}
        """Finished episodes by their seeds."""
        header = {"journal": 1, **settings}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.exists() and not resume:
                path.replace(path.with_name(f"{path.name}.old"))
            kept = self._read(header) if path.exists() else 0
            with path.open("ab") as file:
                file.truncate(kept)
            self._file: TextIO = path.open("a", encoding="utf-8")
            if not kept:
                self._write(header)
        except OSError as error:
            raise RecordingError(f"{path} cannot be written: {error.strerror}.") from error

    def add(self, result: EpisodeResult) -> None:
        """Write a result and wait until it is on the disk.

        Raises:
            RecordingError: It cannot be written.
        """
        try:
            self._write(result.entry())
        except OSError as error:
            raise RecordingError(
                f"{self.path} cannot be written to: {error.strerror}. It holds "
                f"{len(self.results)} episodes; make room and go on with --resume."
            ) from error
        self.results[result.seed] = result

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _write(self, content: Mapping[str, Any]) -> None:
        line = json.dumps(content, allow_nan=False, ensure_ascii=False)
        self._file.write(line + "\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def _read(self, header: Mapping[str, Any]) -> int:
        """Take the results of a file; returns how many of its bytes are whole lines.

        A line without an end was being written when the evaluation was killed.
        """
        content = self.path.read_bytes()
        whole = content.rfind(b"\n") + 1
        lines = content[:whole].decode("utf-8", errors="replace").splitlines()
        if not lines:
            return 0
        try:
            first, *entries = [json.loads(line) for line in lines]
            results = [EpisodeResult.of_entry(entry) for entry in entries]
        except (ValueError, TypeError, KeyError) as error:
            raise JournalError(
                f"{self.path} is no journal of an evaluation: {error}. Name another file with "
                "--log, or start anew without --resume."
            ) from error
        if first != json.loads(json.dumps(header)):
            others = ", ".join(_differences(first, header)) or "its form"
            raise JournalError(
                f"{self.path} is of another evaluation; these differ: {others}. Ask for the "
                "same settings, name another file with --log, or start anew without --resume."
            )
        self.results = {result.seed: result for result in results}
        return whole


def _differences(found: Any, asked: Mapping[str, Any]) -> list[str]:
    if not isinstance(found, Mapping):
        return []
    names = [*asked, *(name for name in found if name not in asked)]
    plain = json.loads(json.dumps(asked))
    return [name for name in names if found.get(name) != plain.get(name)]
