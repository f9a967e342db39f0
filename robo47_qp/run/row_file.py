"""RowFile: the rows and events of a run in a file that survives the end of its process.

The file is a sequence of parts: 4 bytes of kind, 4 of zero, 8 of length, then the content, filled
up to 8 bytes; numbers are little-endian.

- HEAD: JSON with the version of this form, the robot, the signals (name, labels, unit, in the
  order of the columns), and the versions of what wrote it.
- MJCB: the scene in MuJoCo's binary form.
- ROWS: a count, then rows of float64; those from the count on are not filled yet.
- NOTE: JSON of one event.

A part that the end of the file cuts off was being written when the process was killed.
"""

import json
import mmap
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from struct import Struct
from typing import Any
from zlib import crc32

import mujoco
import numpy as np
from numpy.typing import NDArray

from robo47_qp.arrays import Matrix
from robo47_qp.errors import RecordingError
from robo47_qp.model.robot import Robot
from robo47_qp.run.recording import Rows
from robo47_qp.sim.signal import Signal

ENDING = ".rows"
"""Ending of row files; they lie beside the recording of the same name."""
_FORM = 1
_MAGIC = b"robo47 rows\n\0\0\0\0"
_PART = Struct("<4s4xQ")
_NUMBER = 8
_TYPE = np.dtype("<f8")
_COUNT = np.dtype("<i8")


class RowFile:
    """Gives a recording its memory: blocks of rows that are mapped from a file.

    What has been written into them is in the file even if the process is killed: only the machine
    itself may not stop.
    """

    def __init__(
        self, path: Path, model: mujoco.MjModel, robot: Robot, signals: Sequence[Signal]
    ) -> None:
        """Make the file.

        Args:
            path: The file; its folders are created, an existing file is replaced.
            model: The scene.
            robot: The robot in it.
            signals: The signals of the rows.

        Raises:
            RecordingError: The file cannot be written.
        """
        self.path = path
        self._counts: list[NDArray[np.int64]] = []
        self._width = sum(len(signal.labels) for signal in signals)
        scene = np.empty(mujoco.mj_sizeModel(model), np.uint8)
        mujoco.mj_saveModel(model, None, scene)
        head = {
            "form": _FORM,
            "robot": robot.name,
            "signals": [
                {"name": s.name, "labels": list(s.labels), "unit": s.unit, "shown": s.shown}
                for s in signals
            ],
            "versions": _versions(),
            "scene_crc32": crc32(scene.tobytes()),
        }
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("w+b", buffering=0)
            self._write(_MAGIC)
            self._add(b"HEAD", _text(head))
            self._add(b"MJCB", scene.tobytes())
        except OSError as error:
            raise self._broken(error) from error

    def block(self, rows: int) -> tuple[Matrix, NDArray[np.int64]]:
        """Add a block.

        Returns:
            Its rows (rows, columns), all zero, and the count of those that are filled (1,), which
            is to be set whenever one more is.

        Raises:
            RecordingError: There is no room for it.
        """
        size = _NUMBER * (1 + rows * self._width)
        try:
            start = self._file.seek(0, os.SEEK_END)
            self._write(_PART.pack(b"ROWS", size))
            # Written, not left out: a page that the disk has no room for would end the process.
            self._write(bytes(size))
            first = start + _PART.size
            page = first - first % mmap.ALLOCATIONGRANULARITY
            mapped = mmap.mmap(self._file.fileno(), first + size - page, offset=page)
        except OSError as error:
            raise self._broken(error) from error
        count = np.frombuffer(mapped, _COUNT, 1, first - page)
        self._counts.append(count)
        values = np.frombuffer(mapped, _TYPE, rows * self._width, first - page + _NUMBER)
        return values.reshape(rows, self._width), count

    def add(self, event: Mapping[str, Any]) -> None:
        """Add an event, which JSON can hold.

        Raises:
            RecordingError: There is no room for it.
        """
        try:
            self._file.seek(0, os.SEEK_END)
            self._add(b"NOTE", _text(event))
        except OSError as error:
            raise self._broken(error) from error

    def close(self) -> None:
        """Close the file, and keep it if there are rows in it; a second time does nothing."""
        if not (self._file.closed or any(self._counts)):
            self.path.unlink(missing_ok=True)
        self._file.close()

    def remove(self) -> None:
        """Remove the file, once its content is elsewhere."""
        self.close()
        self.path.unlink(missing_ok=True)

    def _add(self, kind: bytes, content: bytes) -> None:
        self._write(_PART.pack(kind, len(content)) + content + bytes(-len(content) % _NUMBER))

    def _write(self, content: bytes) -> None:
        left = memoryview(content)
        while left:
            left = left[self._file.write(left) :]

    def _broken(self, error: OSError) -> RecordingError:
        return RecordingError(
            f"{self.path} cannot be written: {error.strerror}. Make room, or record to another "
            "disk."
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class KeptRows:
    """What a row file holds."""

    robot: str
    """Name of the robot."""
    model: mujoco.MjModel
    """The scene."""
    rows: Rows
    """The rows that were filled, in memory; columns that follow from others may be zero."""
    events: Sequence[Mapping[str, Any]]
    """The events, in order."""


def read_rows(path: Path) -> KeptRows:
    """Read a row file, of a run that was killed, too.

    Raises:
        RecordingError: There is no such file, it is not a row file, it is damaged, or its scene is
            of another version of MuJoCo.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror}.") from error
    if not content.startswith(_MAGIC):
        raise RecordingError(f"{path} cannot be read: it does not hold the rows of a run.")
    parts: dict[bytes, list[memoryview]] = {b"HEAD": [], b"MJCB": [], b"ROWS": [], b"NOTE": []}
    for kind, part in _parts(memoryview(content)):
        if kind not in parts:
            raise RecordingError(f"{path} cannot be read: it is damaged at a part {kind!r}.")
        parts[kind].append(part)
    if not (parts[b"HEAD"] and parts[b"MJCB"]):
        raise RecordingError(f"{path} cannot be read: the run was killed before it began.")
    try:
        head = json.loads(bytes(parts[b"HEAD"][0]))
        signals = [
            Signal(name=s["name"], labels=tuple(s["labels"]), unit=s["unit"], shown=s["shown"])
            for s in head["signals"]
        ]
        written, robot, form = head["versions"], str(head["robot"]), head["form"]
        of = written["mujoco"]
        scene = bytes(parts[b"MJCB"][0])
        if crc32(scene) != head["scene_crc32"]:
            raise ValueError("its scene is not the one that was written")
        events = [json.loads(bytes(part)) for part in parts[b"NOTE"]]
        blocks = [_block(part, sum(len(s.labels) for s in signals)) for part in parts[b"ROWS"]]
    except (ValueError, KeyError, TypeError) as error:
        raise RecordingError(f"{path} cannot be read: it is damaged ({error!r}).") from error
    if form != _FORM or of != mujoco.__version__:
        raise RecordingError(
            f"{path} was written in form {form} with {_listed(written)}; here are form {_FORM} and "
            f"{_listed(_versions())}. Read it with those."
        )
    # Of the same version, and as it was written: MuJoCo does not check what it reads.
    model = mujoco.MjModel.from_binary_path("scene.mjb", {"scene.mjb": scene})
    width = sum(len(s.labels) for s in signals)
    rows = Rows(signals, np.concatenate([np.empty((0, width)), *blocks]))
    return KeptRows(robot=robot, model=model, rows=rows, events=events)


def _parts(content: memoryview) -> Iterator[tuple[bytes, memoryview]]:
    """Yield kind and content of every whole part."""
    start = len(_MAGIC)
    while start + _PART.size <= len(content):
        kind, size = _PART.unpack_from(content, start)
        start += _PART.size
        if start + size > len(content):
            return
        yield kind, content[start : start + size]
        start += size + -size % _NUMBER


def _block(part: memoryview, width: int) -> Matrix:
    """Return the filled rows of a block.

    Raises:
        ValueError: It is none of this width, or counts more rows than it has.
    """
    count = int(np.frombuffer(part, _COUNT, 1)[0])
    values: Matrix = np.frombuffer(part, _TYPE, offset=_NUMBER).reshape(-1, width)
    if not 0 <= count <= len(values):
        raise ValueError(f"{count} of {len(values)} rows filled")
    return values[:count]


def _versions() -> dict[str, str]:
    return {"robo47_qp": version("robo47_qp"), "mujoco": mujoco.__version__}


def _listed(versions: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {number}" for name, number in versions.items())


def _text(content: Mapping[str, Any]) -> bytes:
    return json.dumps(content, allow_nan=False, ensure_ascii=False).encode()
