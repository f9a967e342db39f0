"""Recordings of runs that were killed, made from the rows that they left."""

from pathlib import Path

from robo47_qp.errors import RecordingError
from robo47_qp.files import claimed
from robo47_qp.model.robots import load_robot
from robo47_qp.report.rerun.log import RerunLog
from robo47_qp.run import signals
from robo47_qp.run.recording import CHUNK_ROWS, Rows
from robo47_qp.run.row_file import ENDING, read_rows

_TOLD = "the run was killed; this was made from the rows that it left"


def recover(path: Path) -> tuple[Path, float]:
    """Make the recording of a run that was killed, in place of the unfinished one beside it.

    The row file is removed once the recording is complete.

    Args:
        path: The row file.

    Returns:
        The recording, and the simulated time up to which it goes [s].

    Raises:
        RecordingError: The run still goes on; the file cannot be read or holds no row, or the
            recording cannot be written.
        UnknownNameError: No robot has the name of the one in the file.
    """
    if path.suffix != ENDING:
        raise RecordingError(f"{path} cannot be recovered: its name must end with {ENDING}.")
    if not path.is_file():
        raise RecordingError(f"{path} cannot be read: there is no such file.")
    with claimed(path):
        kept = read_rows(path)
        rows, robot = kept.rows, load_robot(kept.robot)
        if not len(rows):
            raise RecordingError(f"{path} cannot be recovered: the run was killed before a row.")
        recording = path.with_suffix(".rrd")
        signals.derive(rows, robot)
        log = RerunLog(recording, kept.model, robot, rows.signals)
        try:
            for first in range(0, len(rows), CHUNK_ROWS):
                log.write(Rows(rows.signals, rows.values[first : first + CHUNK_ROWS]))
            for event in kept.events:
                try:
                    log.draw(event)
                except (KeyError, TypeError, ValueError) as error:
                    told = f"{path} cannot be read: it is damaged (no event: {event!r:.200})."
                    raise RecordingError(told) from error
            end = float(rows["time"][-1, 0])
            log.note(end, _TOLD, "ERROR")
            log.break_off()
        finally:
            log.close()
        path.unlink()
    return recording, end
