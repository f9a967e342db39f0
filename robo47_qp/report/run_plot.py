"""Plots of a run: tool path, tracking errors and torques."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from robo47_qp.arrays import Vector
from robo47_qp.errors import RecordingError
from robo47_qp.run.recording import Rows
from robo47_qp.run.scenario import Run

_MARGINS = {
    "left": 0.07,
    "right": 0.99,
    "bottom": 0.075,
    "top": 0.945,
    "wspace": 0.18,
    "hspace": 0.32,
}
"""Edges of the panels and spaces between them, as shares of the figure and of a panel."""
_BLUE, _RED, _GREY = "#2563a8", "#c2410c", "#9aa3ad"


def plot_run(run: Run, path: Path) -> None:
    """Write a PNG with the tool path from above and from the side, and the errors.

    Raises:
        RecordingError: The file cannot be written.
    """
    figure = Figure(figsize=(12.0, 7.2), dpi=110)
    FigureCanvasAgg(figure)
    # Fixed margins: a layout by the size of all labels takes half of the time of drawing.
    axes = figure.subplot_mosaic(
        [["above", "joint"], ["above", "tool"], ["side", "torque"]],
        width_ratios=[1.0, 1.6],
        gridspec_kw=_MARGINS,
    )
    robot, rows, t = run.scenario.robot, run.rows, run.rows["time"][:, 0]
    _tool_path(axes["above"], rows, run, (0, 1))
    _tool_path(axes["side"], rows, run, (1, 2))
    axes["above"].legend(loc="upper right", frameon=False)
    for i, joint in enumerate(robot.joints):
        axes["joint"].plot(t, 1e3 * rows["errors/q"][:, i], lw=0.8, label=joint)
        axes["torque"].plot(t, 100 * rows["joints/tau"][:, i] / robot.tau_max[i], lw=0.8)
    axes["joint"].set_ylabel(f"joint error [{robot.unit('mrad', 'mm')}]")
    axes["joint"].legend(
        ncols=len(robot.joints), frameon=False, fontsize=8, loc="upper center", borderpad=0
    )
    axes["joint"].margins(y=0.25)
    axes["tool"].plot(t, 1e3 * rows["errors/tool_position"][:, 0], lw=0.8, color=_BLUE)
    axes["tool"].set_ylabel("tool error [mm]")
    axes["torque"].set_ylabel("torque [% of limit]")
    axes["torque"].set_xlabel("time [s]")
    _mark_phases(axes["tool"], run)
    for name in ("joint", "tool", "torque"):
        axes[name].set_xlim(0.0, float(t[-1]))
        axes[name].grid(alpha=0.3, lw=0.5)
        for phase in run.phases[1:]:
            axes[name].axvline(float(t[phase.start]), color=_GREY, lw=0.5, ls=":")
    outcome = "success" if run.failure is None else f"failed: {run.failure.cause.value}"
    figure.suptitle(f"{run.scenario.task.name} on {robot.name}: {outcome}")
    _save(figure, path)


def plot_curves(panels: Mapping[str, Mapping[str, tuple[Vector, Vector]]], path: Path) -> None:
    """Write a PNG with a panel per label, and in it a curve per name: times [s] and values.

    Raises:
        RecordingError: The file cannot be written.
    """
    figure = Figure(figsize=(10.0, 2.4 * len(panels)), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    for axes, (label, curves) in zip(
        np.ravel(figure.subplots(len(panels), sharex=True)), panels.items(), strict=True
    ):
        for name, (t, values) in curves.items():
            axes.plot(t, values, lw=1.0, label=name)
        axes.set_ylabel(label)
        axes.grid(alpha=0.3, lw=0.5)
    figure.axes[0].legend(frameon=False, ncols=4)
    figure.axes[-1].set_xlabel("time [s]")
    _save(figure, path)


def _save(figure: Figure, path: Path) -> None:
    try:
        figure.savefig(path)
    except (OSError, ValueError) as error:
        raise RecordingError(f"The plot {path} cannot be written: {error}.") from error


def _tool_path(axes: Axes, rows: Rows, run: Run, plane: tuple[int, int]) -> None:
    i, j = plane
    reference, measured = rows["tool/pose_ref"], rows["tool/pose"]
    axes.plot(
        measured[:, i], measured[:, j], color=_BLUE, lw=4.0, alpha=0.4, label="tool, measured"
    )
    axes.plot(reference[:, i], reference[:, j], color=_RED, lw=1.0, label="tool, reference")
    for name in run.objects:
        pose = rows[f"objects/{name}"]
        axes.plot(pose[:, i], pose[:, j], color=_GREY, lw=1.2, label=name, zorder=1)
        axes.plot(pose[-1, i], pose[-1, j], "s", color=_GREY, ms=7, zorder=1)
    axes.set_xlabel(f"{'xyz'[i]} [m]")
    axes.set_ylabel(f"{'xyz'[j]} [m]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(alpha=0.3, lw=0.5)


def _mark_phases(axes: Axes, run: Run) -> None:
    t = run.rows["time"][:, 0]
    axes.margins(y=0.35)
    for phase, rows in run.spans():
        if rows.stop - rows.start > 0.05 * len(t):
            middle = float(np.mean(t[[rows.start, rows.stop - 1]]))
            place: Any = {"transform": axes.get_xaxis_transform(), "ha": "center", "va": "top"}
            axes.text(middle, 0.96, phase.name, fontsize=8, **place)
