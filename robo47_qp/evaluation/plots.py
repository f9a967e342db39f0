"""A picture of an evaluation: how sure the rate is, why episodes failed, how long they took."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from robo47_qp.errors import RecordingError
from robo47_qp.statistics import wilson

_GOOD, _BAD, _BAND = "#2f8f46", "#b5391f", "#2563a8"
_CYCLE = "cycle_time_s"


def plot_evaluation(figures: Mapping[str, Any], path: Path) -> None:
    """Write a PNG.

    Raises:
        RecordingError: The file cannot be written.
    """
    figure = Figure(figsize=(13.0, 7.5), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    rate, causes, cycle, spread = figure.subplots(2, 2).ravel()
    figure.suptitle(f"{figures['task']} with {figures['policy']}", fontsize=12)
    _rate(rate, figures)
    _causes(causes, figures)
    _cycle_times(cycle, figures)
    _disturbance(spread, figures)
    for axes in (rate, causes, cycle, spread):
        axes.grid(alpha=0.3, lw=0.5)
    try:
        figure.savefig(path)
    except (OSError, ValueError) as error:
        raise RecordingError(f"The plot {path} cannot be written: {error}.") from error


def _rate(axes: Axes, figures: Mapping[str, Any]) -> None:
    """Success rate over the episodes, with its interval."""
    won = np.cumsum([entry["success"] for entry in figures["entries"]])
    n = np.unique(np.linspace(1, len(won), min(len(won), 200)).round().astype(int))
    bounds = 100.0 * np.array([wilson(int(won[k - 1]), int(k)) for k in n])
    axes.fill_between(n, bounds[:, 0], bounds[:, 1], color=_BAND, alpha=0.2, lw=0)
    axes.plot(n, 100.0 * won[n - 1] / n, color=_BAND)
    axes.set(xlabel="episodes", ylabel="succeeded [%], 95 %", ylim=(-2.0, 102.0))


def _causes(axes: Axes, figures: Mapping[str, Any]) -> None:
    counts = {"success": figures["successes"], **figures["causes"], "error": figures["errors"]}
    names = [name for name, count in counts.items() if count][::-1]
    colours = [_GOOD if name == "success" else _BAD for name in names]
    bars = axes.barh(names, [counts[name] for name in names], color=colours)
    axes.bar_label(bars, padding=3)
    axes.set(xlabel="episodes")
    axes.margins(x=0.12)


def _cycle_times(axes: Axes, figures: Mapping[str, Any]) -> None:
    groups = []
    for success in (True, False):
        entries = [e for e in figures["entries"] if e["success"] is success]
        groups.append([e["metrics"][_CYCLE] for e in entries if _CYCLE in e["metrics"]])
    if any(groups):
        axes.hist(groups, bins=30, stacked=True, color=[_GOOD, _BAD], label=["succeeded", "failed"])
        axes.legend(frameon=False)
    axes.set(xlabel="cycle time [s]", ylabel="episodes")


def _disturbance(axes: Axes, figures: Mapping[str, Any]) -> None:
    """Where, in mass and friction, episodes fail."""
    for success, colour, marker in ((True, _GOOD, "."), (False, _BAD, "x")):
        wrong = [e["disturbance"] for e in figures["entries"] if e["success"] is success]
        drawn = [w for w in wrong if "object_mass_factor" in w]
        axes.plot(
            [w["object_mass_factor"] for w in drawn],
            [w["friction_factor"] for w in drawn],
            marker,
            color=colour,
            alpha=0.7,
        )
    axes.set(xlabel="mass of the objects / believed", ylabel="friction / believed")
