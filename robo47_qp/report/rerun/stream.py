"""RerunStream: a Rerun file that tells when something did not get into it."""

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
from robo47_qp.files import free_space

TIMELINE = "time"
"""The timeline of a run: simulated time, a duration."""
_PATIENCE = 5.0
"""How long the file may take to receive what was written [s]."""
_RESERVE = 16e6
"""Room that is kept for the end of the file, and for what else writes to the disk [bytes]."""
_TIMED_OUT = "timed out"
"""In the SDK's message when the file is slow, and still being written."""
_END_MARK = b"RRF2FOOT"
"""Stands at the end of every file that was closed in order."""


class RerunStream:
    """A recording on its way into a file, and to a viewer if one is named.

    The file is what counts: a viewer that is closed, or too slow, is given up.
    """

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
            RenderingError: What listens at the URL is no viewer.
        """
        # Without it Rerun drops what it cannot log, with a warning. It is a switch of the whole
        # process: thrown here, because an import must not change anything.
        rr.set_strict_mode(True)
        self.path = path
        self._until, self._size = 0.0, 0
        _check_writable(path)
        self._file: rr.RecordingStream | None = rr.RecordingStream(application)
        self._viewer: rr.RecordingStream | None = None
        try:
            self._file.save(path, default_blueprint=blueprint)
        except RuntimeError as error:
            raise self._broken(str(error)) from error
        if viewer is not None:
            self._viewer = rr.RecordingStream(application)
            self._viewer.connect_grpc(viewer)
            # Not as an argument above: then it would be waited for without a time limit.
            self._viewer.send_blueprint(blueprint, make_active=False)
        for stream in self._streams():
            stream.set_log_time_enabled(False)
            stream.set_log_tick_enabled(False)
            stream.send_recording_name(path.stem)
        if not self.flush(0.0):
            self.close()
            raise RenderingError(
                f"What listens at {viewer} is no Rerun viewer, or one of another version. Close "
                "it, or record without the live view."
            )

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
        """Close the file while it can still be closed properly, if space runs out.

        The SDK does not survive a full disk: its writer dies in the middle of a message.

        Args:
            until: The instant up to which there are rows [s], for messages.

        Raises:
            RecordingError: There is hardly any room left.
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
        """Wait until everything is in the file.

        Args:
            until: The instant up to which there are rows [s], for messages.

        Returns:
            False if the viewer was given up this time.

        Raises:
            RecordingError: Not everything got into the file.
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
        """Write the end of the file and make sure that it is there.

        Args:
            until: The instant up to which there are rows [s], for messages.

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
        """The file and, while there is one, the viewer."""
        if self._file is None:
            raise RecordingError(f"{self.path} is closed; nothing more can be recorded in it.")
        return [self._file] if self._viewer is None else [self._file, self._viewer]

    def _broken(self, reason: str) -> RecordingError:
        """Give the file up and say what happened."""
        stream, self._file = self._file, None
        self.close()
        if stream is not None:
            _abandon(stream)
        hint = "make room or record to another disk"
        try:
            if _TIMED_OUT not in reason:
                # Readers refuse a whole file for a torn message at its end.
                os.truncate(self.path, min(self._size, self.path.stat().st_size))
            else:
                hint += f"; if it does not open: rerun rrd optimize {self.path} -o repaired.rrd"
        except OSError as error:
            hint += f"; it is out of reach now ({error.strerror})"
        return RecordingError(
            f"{self.path} could not be written to its end: {reason}. What the file holds, up to "
            f"{self._until:.3f} s, can be read; {hint}."
        )


def _abandon(stream: rr.RecordingStream) -> None:
    """Never touch a stream again that failed.

    Closing it, dropping it and the SDK's own shutdown at exit wait, now and then for ever,
    for the thread that wrote the file and has died of the error, or for a viewer that hangs
    (rerun-sdk 0.41).
    """
    atexit.unregister(rr.rerun_shutdown)
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(stream))


def _check_writable(path: Path) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb"):
            pass
    except OSError as error:
        taken = isinstance(error, (FileExistsError, NotADirectoryError))
        reason = "its folder is a file" if taken else error.strerror
        raise RecordingError(
            f"{path} cannot be written: {reason}. Name a file in a folder that you may "
            "write to, on a disk that is there."
        ) from error
