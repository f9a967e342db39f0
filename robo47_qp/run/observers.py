"""Observers that slow a run down: to real time, and for MuJoCo's interactive viewer."""

import os
import sys
from collections.abc import Mapping
from time import perf_counter, sleep
from typing import Protocol

from robo47_qp.arrays import Matrix
from robo47_qp.errors import RenderingError
from robo47_qp.motion.planner import Leg
from robo47_qp.sim.simulation import Simulation


class Observer:
    """Base class of observers of a run; its methods do nothing."""

    def planned(self, time: float, leg: Leg, tool_paths: Mapping[str, Matrix]) -> None:
        """A leg starts; of each tool that it moves, the reference positions are (N, 3) [m]."""

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


class Operator(Protocol):
    """Someone who moves the target of a run in the viewer's window."""

    @property
    def moves(self) -> str:
        """Name of the body that is selected to be dragged with the mouse."""

    def press(self, key: int) -> None:
        """A key is pressed in the window; called from another thread."""

    def leave(self) -> None:
        """The window was closed."""


class ViewerWindow(Observer):
    """MuJoCo's interactive viewer, its side panels closed (Tab and Shift-Tab open them).

    If it is closed, a run without an operator continues.
    """

    def __init__(self, simulation: Simulation, operator: Operator | None = None) -> None:
        """Open the window.

        Args:
            simulation: What is shown.
            operator: Gets the keys and is told when the window is closed.

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
            self._handle = mujoco.viewer.launch_passive(
                simulation.model,
                simulation.data,
                key_callback=None if operator is None else operator.press,
                show_left_ui=False,
                show_right_ui=False,
            )
        except (RuntimeError, mujoco.FatalError) as error:
            raise RenderingError(f"--viewer cannot open its window: {error}") from error
        self._operator = operator
        if operator is not None:
            with self._handle.lock():
                self._handle.perturb.select = simulation.model.body(operator.moves).id

    def tick(self, simulation: Simulation) -> None:
        """Show the current state, and move what is dragged with the mouse."""
        if self._handle.is_running():
            self._handle.sync()
        elif self._operator is not None:
            self._operator.leave()

    def close(self) -> None:
        """Close the window."""
        self._handle.close()
