"""A picture of an evaluation: how sure the rate is, why episodes failed, how long they took."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from robo47_qp.errors import RecordingError
from robo47_qp.evaluation.statistics import wilson

_GOOD, _BAD, _BAND = "#2f8f46", "#b5391f", "#2563a8"
_CYCLE, _FORCE = "cycle_time_s", "peak_contact_force_N"


def plot_evaluation(figures: Mapping[str, Any], path: Path) -> None:
    """Write a PNG.

    Raises:
        RecordingError: The file cannot be written.
    """
    figure = Figure(figsize=(13.0, 7.5), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    rate, causes, cycle, last = figure.subplots(2, 2).ravel()
    figure.suptitle(f"{figures['task']} with {figures['policy']}", fontsize=12)
    _rate(rate, figures)
    _causes(causes, figures)
    _spread(cycle, figures, _CYCLE, "cycle time [s]")
    if len({_factors(entry) for entry in figures["entries"]}) > 1:
        _disturbance(last, figures)
    else:
        _spread(last, figures, _FORCE, "largest contact force on the tool [N]")
    for axes in (rate, causes, cycle, last):
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
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))


def _causes(axes: Axes, figures: Mapping[str, Any]) -> None:
    counts = {"success": figures["successes"], **figures["causes"], "error": figures["errors"]}
    names = [name for name, count in counts.items() if count][::-1]
    colours = [_GOOD if name == "success" else _BAD for name in names]
    bars = axes.barh(names, [counts[name] for name in names], height=0.5, color=colours)
    axes.bar_label(bars, padding=3)
    axes.set(xlabel="episodes", ylim=(-1.0, len(names)))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.margins(x=0.12)


def _spread(axes: Axes, figures: Mapping[str, Any], metric: str, label: str) -> None:
    """How a metric is spread over the episodes that succeeded and failed."""
    groups = {}
    for success, name in ((True, "succeeded"), (False, "failed")):
        entries = [e for e in figures["entries"] if e["success"] is success]
        values = [e["metrics"][metric] for e in entries if metric in e["metrics"]]
        if values:
            groups[name] = values
    if groups:
        colours = [_GOOD if name == "succeeded" else _BAD for name in groups]
        axes.hist(list(groups.values()), bins=30, stacked=True, color=colours, label=list(groups))
        axes.legend(frameon=False)
        axes.set_xlim(left=max(0.0, axes.get_xlim()[0]))
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel=label, ylabel="episodes")


def _factors(entry: Mapping[str, Any]) -> tuple[float, float] | None:
    """Mass of the objects and friction over what is believed; None where they are not known."""
    wrong = entry["disturbance"]
    if "object_mass_factor" not in wrong:
        return None
    return wrong["object_mass_factor"], wrong["friction_factor"]


def _disturbance(axes: Axes, figures: Mapping[str, Any]) -> None:
    """Where, in mass and friction, episodes fail."""
    for success, colour, marker in ((True, _GOOD, "."), (False, _BAD, "x")):
        entries = [e for e in figures["entries"] if e["success"] is success]
        drawn = [factors for factors in map(_factors, entries) if factors is not None]
        axes.plot(*np.reshape(drawn, (-1, 2)).T, marker, color=colour, alpha=0.7)
    axes.set(xlabel="mass of the objects / believed", ylabel="friction / believed")
