"""Layout of a recording in the viewer: one page that needs no clicks."""

from collections.abc import Sequence
from math import floor, log10

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import TimelineColumn, VisualizerComponentMapping

from robo47_qp.ik.stream.settings import Event
from robo47_qp.model.gripper import Gripper
from robo47_qp.model.robot import Robot
from robo47_qp.report.rerun.columns import component
from robo47_qp.report.rerun.stream import TIMELINE

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
_LIMIT_COLOUR = (110, 114, 120)
_RIGHT_TOP, _RIGHT_BOTTOM = rrb.Corner2D.RightTop, rrb.Corner2D.RightBottom


def blueprint(robot: Robot, *, followed: bool = False) -> rrb.Blueprint:
    """Return the layout: scene, phases and events on the left, plots on the right.

    Args:
        robot: The robot.
        followed: Whether the run follows a target; it has plots of that then, and none of forces.
    """
    joints, unit = robot.joints, robot.unit
    angle, speed, torque = unit("rad", "m"), unit("rad/s", "m/s"), unit("N·m", "N")
    strong = _rounded_up(float(robot.tau_max.max()))
    texts = rrb.Horizontal(
        rrb.TextLogView(name="Events", origin=EVENTS, columns=_event_columns()),
        rrb.TextDocumentView(name="Summary", origin=SUMMARY),
        column_shares=[3, 2],
    )
    phases = rrb.StateTimelineView(name="Phases", origin=PHASES)
    middle = _following() if followed else _forces(robot.gripper)
    left = (_scene(), phases, middle, texts)
    # A joint has the same colour in all plots: one legend is enough.
    right = rrb.Grid(
        _plot(
            f"Joint position [{angle}]", "joints/q", joints, under="joints/q_ref", limits="limits/q"
        ),
        _plot(f"Joint velocity [{speed}]", "joints/v", joints, limits="limits/v"),
        _plot(
            *(f"Joint torque [{torque}]", "joints/tau", joints),
            limits="limits/tau",
            span=(-1.1 * strong, 1.1 * strong),
            legend=_RIGHT_TOP,
        ),
        _plot(f"Joint tracking error [{angle}]", "errors/q", joints),
        _plot("Tool position error [m]", "errors/tool_position", ("distance",)),
        _plot("Tool angle error [rad]", "errors/tool_angle", ("angle",)),
        grid_columns=2,
    )
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(*left, row_shares=[4.6, 0.95, 1.9, 2.2]),
            right,
            column_shares=[1, 1],
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
        auto_layout=False,
        auto_views=False,
    )


def _forces(gripper: Gripper | None) -> rrb.Container:
    """Return plots of the contact forces and, if there is one, of the gripper."""
    if gripper is None:
        return rrb.Horizontal(_contact())
    wide = _rounded_up(gripper.width_max)
    return rrb.Horizontal(
        _plot(
            "Gripper width [m]",
            "gripper/width",
            ("width",),
            under="gripper/width_command",
            span=(-0.05 * wide, 1.1 * wide),
            legend=_RIGHT_BOTTOM,
        ),
        _plot("Finger force [N]", "gripper/force", gripper.fingers, legend=_RIGHT_TOP),
        _contact(),
    )


def _following() -> rrb.Container:
    """Return plots of how far the tool is from the target, and of what the stream told."""
    events = tuple(event.name.lower().replace("_", " ") for event in Event)
    return rrb.Horizontal(
        _plot("Distance from target [m]", "target/position_error", ("distance",)),
        _plot("Angle from target [rad]", "target/angle_error", ("angle",)),
        _plot("Events", "target/events", events, span=(-0.1, 1.6), legend=_RIGHT_TOP),
    )


def _contact() -> rrb.View:
    """Return a plot of the contact force on the tool, by world axis, and on the links."""
    tool = _lines("contact/tool", ("tool x", "tool y", "tool z"), _PALETTE[:3], 1.25)
    links = _lines("contact/links", ("links",), _PALETTE[3:4], 1.25)
    return rrb.TimeSeriesView(
        name="Contact force [N]",
        origin="/",
        contents=[f"/{SIGNALS}"],
        overrides={SIGNALS: [tool, links]},
        plot_legend=rrb.PlotLegend(_RIGHT_TOP),
        axis_x=rrb.TimeAxis(link="LinkToGlobal"),
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
            position=(1.32, -1.04, 0.88), look_target=(0.28, 0.0, 0.26), eye_up=(0, 0, 1)
        ),
    )


def _event_columns() -> rrb.TextLogColumns:
    """Return columns of level and text: the viewer's column of times is too narrow."""
    hidden = TimelineColumn(TIMELINE, visible=False)
    return rrb.TextLogColumns(timeline_columns=[hidden], text_log_columns=["LogLevel", "Body"])


def _plot(
    name: str,
    signal: str,
    labels: Sequence[str],
    *,
    under: str | None = None,
    limits: str | None = None,
    span: tuple[float, float] | None = None,
    legend: rrb.Corner2D | None = None,
) -> rrb.View:
    """Return a plot of one signal, with its reference and its limits if there are any."""
    colours = [_PALETTE[i % len(_PALETTE)] for i in range(len(labels))]
    lines: dict[rr.encodings.EntityPath | str, list[rrb.Visualizer]] = {
        SIGNALS: [_lines(signal, labels, colours, 1.25)]
    }
    if under is not None:
        names = labels if len(labels) > 1 else ("command",)
        darker = [(r // 2, g // 2, b // 2) for r, g, b in colours]
        lines[SIGNALS].insert(0, _lines(under, names, darker, 3.5))
    if limits is not None:
        count = 2 * len(labels)
        lines[LIMITS] = [_lines(limits, ["limit"] * count, [_LIMIT_COLOUR] * count, 0.75)]
    return rrb.TimeSeriesView(
        name=name,
        origin="/",
        contents=[f"/{entity}" for entity in lines],
        overrides=lines,
        plot_legend=rrb.PlotLegend(legend, visible=legend is not None),
        axis_x=rrb.TimeAxis(link="LinkToGlobal"),
        axis_y=None if span is None else rrb.ScalarAxis(range=span),
    )


def _lines(
    signal: str, names: Sequence[str], colours: Sequence[tuple[int, int, int]], width: float
) -> rrb.Visualizer:
    style = rr.SeriesLines(
        names=list(names),
        colors=list(colours),
        widths=[width] * len(colours),
        # By default the viewer averages, which hides spikes and torque ripple.
        aggregation_policy="MinMax",
    )
    source = VisualizerComponentMapping(
        "Scalars:scalars", "SourceComponent", source_component=component(signal)
    )
    return style.visualizer(mappings=[source])


def _rounded_up(value: float) -> float:
    """Return the next of 1, 2, 5, 10, 20, 50, ...: the viewer labels axes at powers of ten."""
    power = 10.0 ** floor(log10(value))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= value)
