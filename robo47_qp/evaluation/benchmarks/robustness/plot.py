"""A picture of robustness: success against each kind of wrongness, one panel each."""

from collections.abc import Sequence
from math import ceil
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from robo47_qp.errors import RecordingError
from robo47_qp.evaluation.benchmarks.robustness.curves import Curve, Point, kinds

_COLOURS = ("#2563a8", "#b5391f", "#2f8f46", "#8a5fb0")
_LINES = ("o-", "s--", "^:", "v-.")
_COLUMNS = 4


def plot_robustness(curves: Sequence[Curve], title: str, path: Path) -> None:
    """Write a PNG; where nothing is wrong stands at the left of each panel, one level away.

    Raises:
        RecordingError: The file cannot be written.
    """
    names = list(dict.fromkeys(curve.kind for curve in curves))
    stacks = list(dict.fromkeys(curve.stack for curve in curves))
    rows = ceil(len(names) / _COLUMNS)
    figure = Figure(figsize=(14.0, 0.8 + 2.8 * rows), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=12)
    panels = figure.subplots(rows, _COLUMNS, squeeze=False).ravel()
    for panel, name in zip(panels, names, strict=False):
        unit, growth, _ = kinds()[name]
        nothing = growth.first / growth.factor
        levels: dict[float, Point] = {}
        for curve in curves:
            if curve.kind != name:
                continue
            which = stacks.index(curve.stack) % len(_COLOURS)
            colour = _COLOURS[which]
            x = [nothing if point.value is None else point.value for point in curve.points]
            bounds = 100.0 * np.array([point.interval for point in curve.points])
            panel.fill_between(x, bounds[:, 0], bounds[:, 1], color=colour, alpha=0.12, lw=0)
            rates = [100.0 * point.rate for point in curve.points]
            panel.plot(x, rates, _LINES[which], ms=5, color=colour, label=curve.stack)
            levels |= dict(zip(x, curve.points, strict=True))
        panel.axhline(50.0, color="0.6", lw=0.7, ls=":")
        panel.set_xscale("log")
        values = [point.value for point in levels.values()]
        labels = ["none" if value is None else f"{value:.3g}" for value in values]
        panel.set_xticks(list(levels), labels, fontsize=8, rotation=45, ha="right")
        panel.set_xticks([], minor=True)
        if growth.factor < 1.0:
            panel.invert_xaxis()
        panel.set(title=name, ylim=(-4.0, 104.0))
        panel.set_xlabel("" if unit == "-" else unit)
        panel.grid(alpha=0.3, lw=0.5)
    for panel in panels[len(names) :]:
        panel.set_axis_off()
    panels[0].set_ylabel("succeeded [%], 95 %")
    panels[0].legend(frameon=False, fontsize=8, loc="lower left")
    try:
        figure.savefig(path)
    except (OSError, ValueError) as error:
        raise RecordingError(f"The plot {path} cannot be written: {error}.") from error
