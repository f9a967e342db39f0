"""Plot of a comparison: success against cost, and where each solver fails."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from robo47_qp.arrays import Vector
from robo47_qp.errors import RecordingError
from robo47_qp.evaluation.benchmarks.ik.answers import COLOURS, GOOD, Answers, Outcome, outcomes
from robo47_qp.model.arm import Arm

_PALETTE = (
    *("#8a8f98", "#e08a1e", "#b5391f", "#2563a8", "#35b0c4", "#2f8f46"),
    *("#8e44ad", "#c2185b", "#6d4c41", "#7cb342", "#f06292"),
)
_RESTARTED = "-multi"
"""Ending of the names of solvers with restarts: drawn in the same colour, with a solid line."""
_MAPS_PER_ROW = 8
_SHOWN = (Outcome.COLLIDING, Outcome.OUTSIDE, Outcome.MISSED, Outcome.RAISED)


def plot_comparison(arm: Arm, fields: Sequence[Sequence[Answers]], path: Path) -> None:
    """Write a PNG, without target sets that cannot be reached.

    Raises:
        RecordingError: The file cannot be written.
    """
    figure = comparison_figure(arm, fields)
    try:
        figure.savefig(path)
    except (OSError, ValueError) as error:
        raise RecordingError(f"The plot {path} cannot be written: {error}.") from error


def comparison_figure(arm: Arm, fields: Sequence[Sequence[Answers]]) -> Figure:
    """Return the figure of `plot_comparison`."""
    shown = [field for field in fields if field[0].targets.reachable is not False]
    if not shown:
        shown = list(fields)
    solvers = [answers.solver for answers in shown[0]]
    rows = -(-len(solvers) // _MAPS_PER_ROW)
    figure = Figure(figsize=(16.0, 8.4 + 3.3 * rows), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    halves: Any = figure.subfigures(2, 1, height_ratios=[8.2, 0.6 + 3.3 * rows])
    curves, maps = halves
    _budgets(curves, shown, _styles(solvers))
    _failures(maps, arm, shown, rows)
    return figure


def _styles(solvers: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Return the colour and line style of each solver."""
    single = {name.removesuffix(_RESTARTED) for name in solvers if name.endswith(_RESTARTED)}
    kinds = list(dict.fromkeys(name.removesuffix(_RESTARTED) for name in solvers))
    return {
        name: (
            _PALETTE[kinds.index(name.removesuffix(_RESTARTED)) % len(_PALETTE)],
            "-" if name.endswith(_RESTARTED) or name not in single else "--",
        )
        for name in solvers
    }


def _budgets(
    figure: SubFigure, fields: Sequence[Sequence[Answers]], styles: dict[str, tuple[str, str]]
) -> None:
    axes = figure.subplots(2, len(fields), sharey=True, squeeze=False)
    for column, field in enumerate(fields):
        for answers in field:
            colour, line = styles[answers.solver]
            for panel, cost in zip(
                axes[:, column],
                (answers.milliseconds, answers.iterations.astype(np.float64)),
                strict=True,
            ):
                if cost.any():
                    _curve(panel, cost, answers, colour, line)
        axes[0, column].set_title(f"{field[0].targets.name}, {field[0].n} targets", fontsize=11)
        axes[0, column].set_xlabel("processor time for a target [ms]")
        axes[1, column].set_xlabel("steps for a target, over all starts")
    for panel in axes.ravel():
        panel.set_xscale("log")
        panel.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
        panel.xaxis.set_minor_formatter(NullFormatter())
        panel.set_ylim(-2.0, 102.0)
        panel.grid(alpha=0.3, lw=0.5)
    for panel in axes[:, 0]:
        panel.set_ylabel("reached within 1 mm, 0.1°,\ninside the limits [% of targets]")
    lines = [Line2D([], [], color=c, ls=s, label=name) for name, (c, s) in styles.items()]
    figure.legend(handles=lines, loc="outside upper center", ncols=7, frameon=False)


def _curve(axes: Axes, cost: Vector, answers: Answers, colour: str, line: str) -> None:
    """Return the share of targets that are reached within each cost."""
    costs = np.sort(cost[answers.success]).astype(np.float64)
    least = max(float(cost[cost > 0].min()), 1e-4)
    x = np.concatenate([[least], np.maximum(costs, least), [float(cost.max())]])
    y = np.concatenate([[0.0], np.arange(1, len(costs) + 1), [len(costs)]])
    axes.step(x, 100.0 * y / answers.n, where="post", color=colour, ls=line, lw=1.5)


def _failures(figure: SubFigure, arm: Arm, fields: Sequence[Sequence[Answers]], rows: int) -> None:
    """Plot a map per solver: distance of the target from the first joint's axis, and height."""
    count = len(fields[0])
    panels = figure.subplots(rows, _MAPS_PER_ROW, sharex=True, sharey=True, squeeze=False)
    for panel in panels.ravel()[count:]:
        panel.set_visible(False)
    for k, panel in enumerate(panels.ravel()[:count]):
        own = [field[k] for field in fields]
        places = np.concatenate([answers.targets.positions(answers.n) for answers in own])
        results = np.array([outcome.name for a in own for outcome in outcomes(a)])
        foot = arm.model.body(int(arm.model.body_rootid[arm.model.jnt_bodyid[0]])).pos
        across = np.hypot(places[:, 0] - foot[0], places[:, 1] - foot[1])
        good = np.isin(results, [outcome.name for outcome in GOOD])
        panel.plot(across[good], places[good, 2], ".", color="#ccd2da", ms=2.5, mew=0)
        for outcome in _SHOWN:
            some = results == outcome.name
            panel.plot(across[some], places[some, 2], ".", color=_share(outcome), ms=3.5, mew=0)
        failed = int((results != Outcome.COLLIDING.name)[~good].sum())
        panel.set_title(f"{own[0].solver}\n{failed} of {len(results)}", fontsize=9)
        panel.set_xlabel("distance [m]", fontsize=9)
        panel.label_outer()
        panel.set_aspect("equal")
        panel.grid(alpha=0.3, lw=0.5)
    figure.supylabel("height of the target [m]", fontsize=10)
    dots = [
        Line2D([], [], marker="o", ls="", ms=5, color=_share(o), label=o.value) for o in _SHOWN[:3]
    ]
    figure.legend(handles=dots, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    figure.suptitle(
        "Where in the workspace each fails, of all targets: height over distance from the axis of "
        "the first joint",
        fontsize=11,
    )


def _share(outcome: Outcome) -> tuple[float, float, float]:
    red, green, blue = COLOURS[outcome]
    return red / 255, green / 255, blue / 255
