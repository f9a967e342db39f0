"""Observers that slow a run down: to real time, and for MuJoCo's interactive viewer."""

import os
import sys
from time import perf_counter, sleep

from robo47_qp.errors import RenderingError
from robo47_qp.observer import Observer
from robo47_qp.simulation import Simulation


class RealTime(Observer):
    """Lets simulated time pass no faster than the clock."""

    def __init__(self) -> None:
        """Start the clock at the first tick."""
        self._lead: float | None = None

    def tick(self, simulation: Simulation) -> None:
        """Sleep until the clock has caught up."""
        if self._lead is None:
            self._lead = perf_counter() - simulation.time
        ahead = simulation.time + self._lead - perf_counter()
        if ahead > 0.0:
            sleep(ahead)


class ViewerWindow(Observer):
    """MuJoCo's interactive viewer; closing it lets the run go on without it."""

    def __init__(self, simulation: Simulation) -> None:
        """Open the window.

        Raises:
            RenderingError: There is no display, or the window cannot be opened.
        """
        if sys.platform == "linux" and not (
            os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
        ):
            raise RenderingError(
                "--viewer needs a display and neither DISPLAY nor WAYLAND_DISPLAY is set; "
                "run without it and open the recording, or use --video."
            )
        import mujoco.viewer

        try:
            self._handle = mujoco.viewer.launch_passive(simulation.model, simulation.data)
        except (RuntimeError, mujoco.FatalError) as error:
            raise RenderingError(f"--viewer cannot open its window: {error}") from error

    def tick(self, simulation: Simulation) -> None:
        """Show the present state."""
        if self._handle.is_running():
            self._handle.sync()

    def close(self) -> None:
        """Close the window."""
        self._handle.close()
