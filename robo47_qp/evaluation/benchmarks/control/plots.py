"""A picture of a comparison of controllers: the tool's error over time, for each condition."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import RecordingError
from robo47_qp.evaluation.benchmarks.control.trial import Trial
from robo47_qp.report.drawing import line_look

_PER_ROW = 5
_LOWEST = 1e-6
"""Errors below are drawn there [m]."""


def plot_trials(by_condition: Sequence[Sequence[Trial]], path: Path) -> None:
    """Write a PNG.

    Raises:
        RecordingError: The file cannot be written.
    """
    columns = min(_PER_ROW, len(by_condition))
    rows = -(-len(by_condition) // columns)
    figure = Figure(figsize=(3.6 * columns, 0.6 + 3.1 * rows), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(rows, columns, sharey=True, squeeze=False)
    for axes in grid.flat[len(by_condition) :]:
        axes.set_visible(False)
    for axes, trials in zip(grid.flat, by_condition, strict=False):
        for i, trial in enumerate(trials):
            size = np.maximum(np.linalg.norm(trial.tool_errors, axis=1), _LOWEST)
            t = TIMESTEP * np.arange(len(size))
            label = trial.controller if trial.stable else f"{trial.controller} (unstable)"
            axes.semilogy(t, 1e3 * size, lw=0.9, label=label, **line_look(i))
        axes.axvline(trials[0].moving * TIMESTEP, color="#9aa3ad", lw=0.6, ls=":")
        axes.set_title(trials[0].condition, fontsize=10)
        axes.grid(alpha=0.3, lw=0.5)
        axes.set_xlabel("time [s]", fontsize=8)
    for axes in grid[:, 0]:
        axes.set_ylabel("tool error [mm]")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2 * columns, frameon=False)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path)
    except (OSError, ValueError) as error:
        raise RecordingError(f"The plot {path} cannot be written: {error}.") from error
