"""Observers that slow a run down: to real time, and for MuJoCo's interactive viewer."""

import os
import sys
from time import perf_counter, sleep

from robo47_qp.arrays import Matrix
from robo47_qp.errors import RenderingError
from robo47_qp.motion.planner import Leg
from robo47_qp.sim.simulation import Simulation


class Observer:
    """Base class of observers of a run; its methods do nothing."""

    def planned(self, time: float, leg: Leg, tool_path: Matrix) -> None:
        """A leg starts; its reference tool positions are (N, 3) [m]."""

    def phase(self, time: float, name: str) -> None:
        """A phase starts."""

    def note(self, time: float, text: str, level: str) -> None:
        """An event is reported; level is INFO, WARN or ERROR."""

    def tick(self, simulation: Simulation) -> None:
        """Called every few control periods; may sleep to slow the run down."""

    def close(self) -> None:
        """The run is over, however it ended."""


class RealTime(Observer):
    """Keeps simulated time from running ahead of the clock."""

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
    """MuJoCo's interactive viewer; if it is closed, the run continues."""

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
        """Show the current state."""
        if self._handle.is_running():
            self._handle.sync()

    def close(self) -> None:
        """Close the window."""
        self._handle.close()
