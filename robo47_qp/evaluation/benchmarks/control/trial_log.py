"""The recording of a comparison of controllers: errors and torques over time."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.evaluation.benchmarks.control.trial import Trial
from robo47_qp.report.rerun.stream import TIMELINE, RerunStream

_FIGURES = "figures"
_SIGNALS = {"tool_error": "Tool error [mm]", "torque_use": "Largest torque [% of its limit]"}


def write_trials(by_condition: Sequence[Sequence[Trial]], figures: str, path: Path) -> None:
    """Write a Rerun file with a tab for each condition.

    Args:
        by_condition: The trials, those of one condition together.
        figures: The table, as Markdown.
        path: The file.

    Raises:
        RecordingError: The file cannot be written.
    """
    conditions = [trials[0].condition for trials in by_condition]
    stream = RerunStream(path, "robo47_qp controllers", _blueprint(conditions), None)
    try:
        stream.log(_FIGURES, rr.TextDocument(figures, media_type=rr.MediaType.MARKDOWN))
        for trials in by_condition:
            stream.require_room(0.0)
            _write_condition(stream, trials)
        stream.finish(0.0)
    finally:
        stream.close()


def _write_condition(stream: RerunStream, trials: Sequence[Trial]) -> None:
    names = [trial.controller for trial in trials]
    root = rr.escape_entity_path_part(trials[0].condition)
    times: Vector = TIMESTEP * np.arange(len(trials[0].torque_use), dtype=np.float64)
    errors = [1e3 * np.linalg.norm(trial.tool_errors, axis=1) for trial in trials]
    uses = [100.0 * trial.torque_use for trial in trials]
    for signal, columns in zip(_SIGNALS, (errors, uses), strict=True):
        values: Matrix = np.array(columns).T
        entity = f"{root}/{signal}"
        style = rr.SeriesLines(names=names, aggregation_policy="MinMax")
        stream.log(entity, style)
        scalars = rr.Scalars.columns(scalars=values.ravel())
        stream.send(entity, times, list(scalars.partition([len(names)] * len(times))))


def _blueprint(conditions: Sequence[str]) -> rrb.Blueprint:
    return rrb.Blueprint(
        rrb.Tabs(
            rrb.TextDocumentView(name="Figures", origin=f"/{_FIGURES}"),
            *(_page(condition) for condition in conditions),
            active_tab=min(1, len(conditions)),
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        auto_layout=False,
        auto_views=False,
    )


def _page(condition: str) -> rrb.Vertical:
    root = rr.escape_entity_path_part(condition)
    views = [
        rrb.TimeSeriesView(name=title, origin=f"/{root}/{signal}")
        for signal, title in _SIGNALS.items()
    ]
    return rrb.Vertical(*views, name=condition)
