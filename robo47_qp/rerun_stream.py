"""RerunStream: a Rerun file that tells when something did not get into it."""

import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import TypeAlias

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from robo47_qp.arrays import Vector
from robo47_qp.errors import RecordingError

TIMELINE = "time"
"""The only timeline: simulated time, a duration."""
_PATIENCE = 5.0
"""How long the file may take to receive what was written [s]."""
_END_MARK = b"RRF2FOOT"
"""Stands at the end of every file that was closed in order."""
_Sink: TypeAlias = rr.FileSink | rr.GrpcSink


class RerunStream:
    """A recording on its way into a file, and to a viewer if one is named."""

    def __init__(
        self, path: Path, application: str, blueprint: rrb.Blueprint, viewer: str | None
    ) -> None:
        """Open the file.

        Args:
            path: The file; its folders are made, a file in its place is replaced.
            application: Recordings of the same application share a layout in the viewer.
            blueprint: The layout that the recording opens with.
            viewer: URL of a viewer that gets the same data.

        Raises:
            RecordingError: The file cannot be written.
        """
        # Without it Rerun drops what it cannot log, with a warning. It is a switch of the whole
        # process: thrown here, because an import must not change anything.
        rr.set_strict_mode(True)
        self.path = path
        self._until = 0.0
        _check_writable(path)
        stream = rr.RecordingStream(application)
        stream.set_log_time_enabled(False)
        stream.set_log_tick_enabled(False)
        sinks: list[_Sink] = [rr.FileSink(path)]
        if viewer is not None:
            sinks.append(rr.GrpcSink(viewer))
        self._stream: rr.RecordingStream | None = stream
        try:
            stream.set_sinks(*sinks, default_blueprint=blueprint)
            stream.send_recording_name(path.stem)
        except RuntimeError as error:
            raise self._broken(str(error)) from error
        self.flush(0.0)

    def log(self, entity: str, *archetypes: rr.AsComponents, time: float | None = None) -> None:
        """Log at an instant [s], or for all times.

        Raises:
            RecordingError: The recording is closed.
        """
        stream = self._opened()
        if time is not None:
            stream.set_time(TIMELINE, duration=np.timedelta64(round(time * 1e9), "ns"))
        stream.log(entity, *archetypes, static=time is None)

    def send(self, entity: str, times: Vector, columns: Iterable[rr.ComponentColumn]) -> None:
        """Log many instants at once.

        Args:
            entity: Where.
            times: The instants (N,) [s].
            columns: Columns of N entries.

        Raises:
            RecordingError: The recording is closed.
        """
        # Rounded here: Rerun would truncate, and rows of one instant would not join.
        instants = np.round(times * 1e9).astype("timedelta64[ns]")
        index = rr.TimeColumn(TIMELINE, duration=instants)
        self._opened().send_columns(entity, [index], columns)

    def flush(self, until: float) -> None:
        """Wait until everything is in the file.

        Args:
            until: The instant up to which there are rows [s], for messages.

        Raises:
            RecordingError: Not everything got there.
        """
        try:
            self._opened().flush(timeout_sec=_PATIENCE)
        except (RuntimeError, OSError) as error:
            raise self._broken(str(error)) from error
        self._until = until

    def finish(self) -> None:
        """Write the end of the file and make sure that it is there.

        Raises:
            RecordingError: The file is not complete.
        """
        self.flush(self._until)
        self.close()
        with self.path.open("rb") as file:
            file.seek(-min(64, self.path.stat().st_size), 2)
            if _END_MARK not in file.read():
                raise self._broken("the end of the file is missing")

    def close(self) -> None:
        """Close the file, complete or not; a second time does nothing."""
        stream, self._stream = self._stream, None
        if stream is not None:
            stream.disconnect()

    def _opened(self) -> rr.RecordingStream:
        if self._stream is None:
            raise RecordingError(f"{self.path} is closed; nothing more can be recorded in it.")
        return self._stream

    def _broken(self, reason: str) -> RecordingError:
        free = shutil.disk_usage(self.path.parent).free
        return RecordingError(
            f"{self.path} could not be written to its end: {reason}. The disk has "
            f"{free / 1e6:.0f} MB left. What is in the file, up to {self._until:.3f} s, can be "
            "read; make room or record to another disk."
        )


def _check_writable(path: Path) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb"):
            pass
    except OSError as error:
        raise RecordingError(
            f"{path} cannot be written: {error.strerror}. Name a file in a folder that you may "
            "write to, on a disk that is there."
        ) from error
