"""The picture of a run: tool path, tracking errors and torques."""

import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np

from robo47_qp.errors import RecordingError
from robo47_qp.report import drawing
from robo47_qp.report.drawing import Picture, write
from robo47_qp.run.scenario import Run


class Plotter:
    """Draws the picture of a run in a process of its own, which gets ready while the run goes on.

    Where Matplotlib is loaded already, this process draws.
    """

    def __init__(self, path: Path) -> None:
        """Get ready to write to the path (PNG)."""
        self._path = path
        self._run: Run | None = None
        self._process: subprocess.Popen[bytes] | None = None
        if "matplotlib.figure" not in sys.modules:
            # Ctrl-C is for the run, not for this process, which ends with its input.
            self._process = subprocess.Popen(
                [sys.executable, "-P", drawing.__file__, str(path)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                start_new_session=True,
            )

    def take(self, run: Run) -> None:
        """Take the run that is to be drawn; `finish` waits until it is."""
        self._run = run
        if self._process is not None and self._process.stdin is not None:
            # Whatever ended that process, `finish` tells it.
            with suppress(BrokenPipeError), self._process.stdin as pipe:
                pipe.write(picture_of(run).packed())
            self._process.stdin = None

    def finish(self) -> None:
        """Return when the picture is written.

        Raises:
            RecordingError: It cannot be written.
        """
        if self._process is None:
            if self._run is not None:
                plot_run(self._run, self._path)
            return
        told = self._process.communicate()[1].decode(errors="replace").splitlines()
        if self._process.returncode:
            raise _unwritten(self._path, told[-1] if told else "its process was ended")

    def close(self) -> None:
        """End the process, if it has not ended."""
        if self._process is not None and self._process.returncode is None:
            self._process.kill()
            self._process.communicate()


def plot_run(run: Run, path: Path) -> None:
    """Write a PNG with the tool path from above and from the side, and the errors.

    Raises:
        RecordingError: The file cannot be written.
    """
    try:
        write(picture_of(run), path)
    except (OSError, ValueError) as error:
        raise _unwritten(path, str(error)) from error


def picture_of(run: Run) -> Picture:
    """Return what is drawn of a run."""
    robot, rows = run.scenario.robot, run.rows
    labels = [label for label, _ in robot.tool_labels()]
    outcome = "success" if run.failure is None else f"failed: {run.failure.cause.value}"
    words = {
        "title": f"{run.scenario.task.name} on {robot.name}: {outcome}",
        "joints": robot.joints,
        "unit": robot.unit("mrad", "mm"),
        "tools": [tool.name for tool in robot.tools],
        "objects": [*run.objects],
        "phases": [phase.name for phase in run.phases],
    }
    places = [rows[f"objects/{name}"][:, :3] for name in run.objects]
    numbers = {
        "time": rows["time"][:, 0],
        "q": 1e3 * rows["errors/q"],
        "tool": np.hstack([1e3 * rows[f"errors/{label}tool_position"] for label in labels]),
        "tau": 100.0 * rows["joints/tau"] / robot.tau_max,
        "asked": np.stack([rows[f"tool/{label}pose_ref"][:, :3] for label in labels], axis=1),
        "at": np.stack([rows[f"tool/{label}pose"][:, :3] for label in labels], axis=1),
        "objects": np.stack(places, axis=1) if places else np.zeros((len(rows), 0, 3)),
        "starts": np.array([phase.start for phase in run.phases]),
    }
    return Picture(words, numbers)


def _unwritten(path: Path, why: str) -> RecordingError:
    return RecordingError(f"The plot {path} cannot be written: {why}.")
