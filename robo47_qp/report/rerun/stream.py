"""RerunStream: a Rerun file that reports when data could not be written."""

import atexit
import ctypes
import os
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from robo47_qp.arrays import Vector
from robo47_qp.errors import RecordingError, RenderingError
from robo47_qp.files import check_writable, free_space

TIMELINE = "time"
"""The timeline of a run: simulated time, a duration."""
_PATIENCE = 5.0
"""Time limit for writing pending data to the file [s]."""
_RESERVE = 16e6
"""Disk space reserved for the end of the file and for other programs [bytes]."""
_TIMED_OUT = "timed out"
"""In the message of the SDK when the file is slow but still being written."""
_END_MARK = b"RRF2FOOT"
"""At the end of every file that was closed properly."""


class RerunStream:
    """Writes a recording to a file, and to a viewer if one is given.

    A viewer that is closed or too slow is dropped; the file goes on.
    """

    def __init__(
        self, path: Path, application: str, blueprint: rrb.Blueprint, viewer: str | None
    ) -> None:
        """Open the file.

        Args:
            path: The file; its folders are created, an existing file is replaced.
            application: Recordings of one application share their layout in the viewer.
            blueprint: The layout.
            viewer: URL of a viewer that receives the same data.

        Raises:
            RecordingError: The file cannot be written.
            RenderingError: There is no viewer at the URL.
        """
        # Otherwise Rerun drops what it cannot log, with a warning. This affects the whole process,
        # so it is done here and not at import.
        rr.set_strict_mode(True)
        self.path = path
        self._until, self._size = 0.0, 0
        check_writable(path)
        self._file: rr.RecordingStream | None = None
        self._viewer: rr.RecordingStream | None = None
        if viewer is not None:
            # Before the file is replaced.
            self._viewer = self._connected(viewer, application, blueprint)
        self._file = self._begun(application)
        try:
            self._file.save(path, default_blueprint=blueprint)
        except RuntimeError as error:
            raise self._broken(str(error)) from error
        self.flush(0.0)

    def _begun(self, application: str) -> rr.RecordingStream:
        stream = rr.RecordingStream(application)
        stream.set_log_time_enabled(False)
        stream.set_log_tick_enabled(False)
        stream.send_recording_name(self.path.stem)
        return stream

    def _connected(
        self, viewer: str, application: str, blueprint: rrb.Blueprint
    ) -> rr.RecordingStream:
        """Return a stream to a viewer that has taken its beginning."""
        stream = self._begun(application)
        stream.connect_grpc(viewer)
        # Not as an argument above, which would wait without a time limit.
        stream.send_blueprint(blueprint, make_active=False)
        try:
            stream.flush(timeout_sec=_PATIENCE)
        except (RuntimeError, OSError) as error:
            _abandon(stream)
            raise RenderingError(
                f"There is no Rerun viewer at {viewer}, or one of another version. Close "
                "it, or record without the live view."
            ) from error
        return stream

    def log(self, entity: str, *archetypes: rr.AsComponents, time: float | None = None) -> None:
        """Log at an instant [s], or for all times.

        Raises:
            RecordingError: The recording is closed.
        """
        for stream in self._streams():
            if time is not None:
                stream.set_time(TIMELINE, duration=np.timedelta64(round(time * 1e9), "ns"))
            stream.log(entity, *archetypes, static=time is None)

    def send(self, entity: str, times: Vector, columns: Sequence[rr.ComponentColumn]) -> None:
        """Log columns of N entries at N times [s].

        Raises:
            RecordingError: The recording is closed.
        """
        # Rounded here: Rerun would truncate, and rows of one instant would not join.
        instants = np.round(times * 1e9).astype("timedelta64[ns]")
        self.send_at(entity, rr.TimeColumn(TIMELINE, duration=instants), columns)

    def send_at(
        self, entity: str, index: rr.TimeColumn, columns: Iterable[rr.ComponentColumn]
    ) -> None:
        """Log many rows at once on any timeline.

        Raises:
            RecordingError: The recording is closed.
        """
        for stream in self._streams():
            stream.send_columns(entity, [index], columns)

    def require_room(self, until: float) -> None:
        """Close the file if disk space runs out: on a full disk, a message would be cut off.

        `until` is the time of the last row [s], for messages, here and below.

        Raises:
            RecordingError: Hardly any disk space is left.
        """
        left = free_space(self.path)
        if left < _RESERVE:
            self.finish(until)
            raise RecordingError(
                f"{self.path} was closed at {until:.3f} s, as there is room for only "
                f"{left / 1e6:.0f} MB more. It is complete up to there; make room, or record to "
                "another disk."
            )

    def flush(self, until: float) -> bool:
        """Wait until all data is in the file; return False if the viewer was dropped now.

        Raises:
            RecordingError: Some data could not be written.
        """
        file, *viewers = self._streams()
        for viewer in viewers:
            try:
                viewer.flush(timeout_sec=_PATIENCE)
            except (RuntimeError, OSError):
                self._viewer = None
                _abandon(viewer)
        try:
            file.flush(timeout_sec=_PATIENCE)
            self._until, self._size = until, self.path.stat().st_size
        except (RuntimeError, OSError) as error:
            raise self._broken(str(error)) from error
        return len(viewers) == len(self._streams()) - 1

    def finish(self, until: float) -> None:
        """Write the end of the file and check that it is there.

        Raises:
            RecordingError: The file is not complete.
        """
        self.flush(until)
        self.close()
        try:
            with self.path.open("rb") as file:
                file.seek(-min(64, self.path.stat().st_size), 2)
                complete = _END_MARK in file.read()
        except OSError as error:
            raise self._broken(str(error)) from error
        if not complete:
            raise self._broken("its end is missing")

    def close(self) -> None:
        """Close the file, complete or not; a second time does nothing."""
        streams = [stream for stream in (self._file, self._viewer) if stream is not None]
        self._file = self._viewer = None
        for stream in streams:
            stream.disconnect()

    def _streams(self) -> list[rr.RecordingStream]:
        """Return the file and, if there is one, the viewer."""
        if self._file is None:
            raise RecordingError(f"{self.path} is closed; nothing more can be recorded in it.")
        return [self._file] if self._viewer is None else [self._file, self._viewer]

    def _broken(self, reason: str) -> RecordingError:
        """Abandon the file and return the error that explains it."""
        stream, self._file = self._file, None
        self.close()
        if stream is not None:
            _abandon(stream)
        hint = "make room or record to another disk"
        try:
            if _TIMED_OUT not in reason:
                # A message that is cut off at the end makes the whole file unreadable.
                os.truncate(self.path, min(self._size, self.path.stat().st_size))
            else:
                hint += f"; if it does not open: rerun rrd optimize {self.path} -o repaired.rrd"
        except OSError as error:
            hint += f"; it cannot be accessed now ({error.strerror})"
        return RecordingError(
            f"{self.path} could not be written to its end: {reason}. What the file holds, up to "
            f"{self._until:.3f} s, can be read; {hint}."
        )


def _abandon(stream: rr.RecordingStream) -> None:
    """Keep a failed stream alive and untouched until the process ends.

    Closing or deleting it, and the shutdown of the SDK at exit, may wait forever for the writer
    thread, which the error ended, or for a viewer that hangs (rerun-sdk 0.41).
    """
    atexit.unregister(rr.rerun_shutdown)
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(stream))
