"""A picture of an evaluation: success rate, causes of failure, cycle times, contact forces."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from robo47_qp.errors import RecordingError
from robo47_qp.evaluation.episode import EpisodeResult
from robo47_qp.evaluation.report.report import CYCLE, EvaluationReport
from robo47_qp.evaluation.statistics import wilson

_GOOD, _BAD, _BAND = "#2f8f46", "#b5391f", "#2563a8"
_FORCE = "peak_contact_force_N"


def plot_evaluation(report: EvaluationReport, path: Path) -> None:
    """Write a PNG.

    Raises:
        RecordingError: The file cannot be written.
    """
    figure = Figure(figsize=(13.0, 7.5), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    rate, causes, cycle, last = figure.subplots(2, 2).ravel()
    figure.suptitle(f"{report.task} with {report.policy}", fontsize=12)
    results = [result for result in report.results if result.error is None]
    _rate(rate, results)
    _causes(causes, report)
    _spread(cycle, results, CYCLE, "cycle time [s]")
    if len(set(map(_factors, results))) > 1:
        _disturbance(last, results)
    else:
        _spread(last, results, _FORCE, "largest contact force on the tool [N]")
    for axes in (rate, causes, cycle, last):
        axes.grid(alpha=0.3, lw=0.5)
    try:
        figure.savefig(path)
    except (OSError, ValueError) as error:
        raise RecordingError(f"The plot {path} cannot be written: {error}.") from error


def _rate(axes: Axes, results: Sequence[EpisodeResult]) -> None:
    """Plot the success rate over the episodes that were judged, with its interval."""
    won = np.cumsum([result.success for result in results])
    n = np.unique(np.linspace(1, len(won), min(len(won), 200)).round().astype(int))
    bounds = 100.0 * np.reshape([wilson(int(won[k - 1]), int(k)) for k in n], (-1, 2))
    axes.fill_between(n, bounds[:, 0], bounds[:, 1], color=_BAND, alpha=0.2, lw=0)
    axes.plot(n, 100.0 * won[n - 1] / n, color=_BAND)
    axes.set(xlabel="episodes", ylabel="succeeded [%], 95 %", ylim=(-2.0, 102.0))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))


def _causes(axes: Axes, report: EvaluationReport) -> None:
    counts = {"success": report.successes, **report.causes, "error": len(report.errors)}
    names = [name for name, count in counts.items() if count][::-1]
    colours = [_GOOD if name == "success" else _BAD for name in names]
    bars = axes.barh(names, [counts[name] for name in names], height=0.5, color=colours)
    axes.bar_label(bars, padding=3)
    axes.set(xlabel="episodes", ylim=(-1.0, len(names)))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.margins(x=0.12)


def _spread(axes: Axes, results: Sequence[EpisodeResult], metric: str, label: str) -> None:
    """Plot the distribution of a metric over successful and failed episodes."""
    groups = {}
    for success, name in ((True, "succeeded"), (False, "failed")):
        held = [r.metrics for r in results if r.success is success]
        if values := [figures[metric] for figures in held if metric in figures]:
            groups[name] = values
    if groups:
        colours = [_GOOD if name == "succeeded" else _BAD for name in groups]
        axes.hist(list(groups.values()), bins=30, stacked=True, color=colours, label=list(groups))
        axes.legend(frameon=False, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
        axes.set_xlim(left=max(0.0, axes.get_xlim()[0]))
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel=label, ylabel="episodes")


def _factors(result: EpisodeResult) -> tuple[float, float] | None:
    """Return mean mass of the objects relative to the models, and friction.

    None if they are unknown, or there are no objects.
    """
    wrong = result.disturbance
    masses = np.atleast_1d(wrong.get("object_mass_factor", ()))
    if wrong.get("friction") is None or not masses.size:
        return None
    return float(masses.mean()), wrong["friction"]


def _disturbance(axes: Axes, results: Sequence[EpisodeResult]) -> None:
    """Plot at which masses and friction episodes succeed and fail."""
    for success, colour, marker in ((True, _GOOD, "."), (False, _BAD, "x")):
        drawn = [f for r in results if r.success is success and (f := _factors(r)) is not None]
        axes.plot(*np.reshape(drawn, (-1, 2)).T, marker, color=colour, alpha=0.7)
    axes.set(xlabel="mass of the objects / modelled", ylabel="friction [-]")
