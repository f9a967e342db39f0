"""How a recording looks when it is opened: one page that can be read without a click."""

from collections.abc import Sequence

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import VisualizerComponentMapping

from robo47_qp.robot import Robot
from robo47_qp.rerun_columns import component
from robo47_qp.rerun_stream import TIMELINE

SIGNALS, LIMITS, PHASES, EVENTS, SUMMARY = "signals", "limits", "phases", "events", "summary"
"""Entities outside the 3-D scene."""
WORLD, TOOL, PATH, PLANNED, GOALS = "world", "tool", "path", "planned", "goals"
"""Entities of the 3-D scene."""
FRAMES = "frames"
"""Entity with the poses of everything that moves."""

_PALETTE = (
    (86, 156, 255),
    (255, 146, 57),
    (91, 201, 110),
    (240, 90, 100),
    (183, 134, 255),
    (240, 200, 70),
    (90, 210, 220),
)
"""One colour per joint, the same in every plot."""
_LIMIT_COLOUR = (120, 124, 130)
_REFERENCE_COLOUR = (205, 208, 214)


def blueprint(robot: Robot) -> rrb.Blueprint:
    """The layout: the scene and what happened on the left, plots on the right."""
    joints = robot.joints
    plots = [
        _plot("Joint position [rad]", "joints/q", joints, under=("joints/q_ref",), limit="q"),
        _plot("Joint velocity [rad/s]", "joints/v", joints, limit="v"),
        _plot("Joint torque [N·m]", "joints/tau", joints, limit="tau"),
        _plot("Joint tracking error [rad]", "errors/q", joints),
        _plot("Tool position error [m]", "errors/tool_position", ("distance",)),
        _plot("Tool angle error [rad]", "errors/tool_angle", ("angle",)),
        _plot("Gripper width [m]", "gripper/width", ("width",), under=("gripper/width_command",)),
        _plot("Finger force [N]", "gripper/force", robot.gripper.fingers),
    ]
    left = rrb.Vertical(
        _scene(),
        rrb.StateTimelineView(name="Phases", origin=PHASES),
        rrb.Horizontal(
            rrb.TextLogView(name="Events", origin=EVENTS),
            rrb.TextDocumentView(name="Summary", origin=SUMMARY),
        ),
        row_shares=[6, 1.2, 2.5],
    )
    return rrb.Blueprint(
        rrb.Horizontal(left, rrb.Grid(*plots, grid_columns=2), column_shares=[1, 1]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
        auto_layout=False,
        auto_views=False,
    )


def _scene() -> rrb.View:
    so_far = rrb.VisibleTimeRanges(
        timeline=TIMELINE,
        start=rrb.TimeRangeBoundary.infinite(),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    return rrb.Spatial3DView(
        name="Scene",
        origin="/",
        contents=[f"/{name}/**" for name in (WORLD, TOOL, PATH, PLANNED, GOALS)],
        overrides={name: [so_far] for name in (PATH, PLANNED, GOALS)},
        background=(24, 27, 32),
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            position=(1.55, -1.25, 0.95), look_target=(0.28, 0.0, 0.28), eye_up=(0, 0, 1)
        ),
    )


def _plot(
    name: str,
    signal: str,
    labels: Sequence[str],
    *,
    under: Sequence[str] = (),
    limit: str | None = None,
) -> rrb.View:
    """A plot of one signal, over its references and limits where there are any."""
    colours = [_PALETTE[i % len(_PALETTE)] for i in range(len(labels))]
    overrides: dict[str, list[rrb.Visualizer]] = {SIGNALS: []}
    for reference in under:
        overrides[SIGNALS].append(
            _lines(reference, ["reference"] * len(labels), [_REFERENCE_COLOUR] * len(labels), 2.5)
        )
    overrides[SIGNALS].append(_lines(signal, labels, colours, 1.25))
    if limit is not None:
        count = 2 * len(labels)
        overrides[LIMITS] = [
            _lines(f"limits/{limit}", ["limit"] * count, [_LIMIT_COLOUR] * count, 0.75)
        ]
    return rrb.TimeSeriesView(
        name=name,
        origin="/",
        contents=[f"/{entity}" for entity in overrides],
        overrides=overrides,
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=True),
        axis_x=rrb.TimeAxis(link="LinkToGlobal"),
    )


def _lines(
    signal: str, names: Sequence[str], colours: Sequence[tuple[int, int, int]], width: float
) -> rrb.Visualizer:
    style = rr.SeriesLines(
        names=list(names),
        colors=list(colours),
        widths=[width] * len(names),
        # The viewer's default averages: spikes and torque ripple would be gone.
        aggregation_policy="MinMax",
    )
    source = VisualizerComponentMapping(
        "Scalars:scalars", "SourceComponent", source_component=component(signal)
    )
    return style.visualizer(mappings=[source])
