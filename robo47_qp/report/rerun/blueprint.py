"""Layout of a recording in the viewer: one page that needs no clicks."""

from collections.abc import Mapping, Sequence
from math import floor, log10

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import TimelineColumn, VisualizerComponentMapping

from robo47_qp.ik.stream.settings import Event
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
_XYZ = ("x", "y", "z")
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
    left = (_scene(), phases, _following() if followed else _forces(robot), texts)
    names = {label: tool.name for label, tool in robot.tool_labels()}
    several = _RIGHT_TOP if len(names) > 1 else None
    position = {f"errors/{label}tool_position": (name,) for label, name in names.items()}
    turned = {f"errors/{label}tool_angle": (name,) for label, name in names.items()}
    # A joint has the same colour in all plots: one legend is enough.
    right = rrb.Grid(
        _plot(
            f"Joint position [{angle}]",
            {"joints/q": joints},
            under={"joints/q_ref": joints},
            limits="limits/q",
        ),
        _plot(f"Joint velocity [{speed}]", {"joints/v": joints}, limits="limits/v"),
        _plot(
            f"Joint torque [{torque}]",
            {"joints/tau": joints},
            limits="limits/tau",
            span=(-1.1 * strong, 1.1 * strong),
            legend=_RIGHT_TOP,
        ),
        _plot(f"Joint tracking error [{angle}]", {"errors/q": joints}),
        _plot("Tool position error [m]", position, legend=several),
        _plot("Tool angle error [rad]", turned, legend=several),
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


def _forces(robot: Robot) -> rrb.Container:
    """Return plots of the contact forces and, if there are any, of the grippers."""
    names = {label: tool.name for label, tool in robot.tool_labels()}
    force = {f"contact/{label}tool": [f"{name} {x}" for x in _XYZ] for label, name in names.items()}
    contact = _plot("Contact force [N]", {**force, "contact/links": ("links",)}, legend=_RIGHT_TOP)
    grips = {label: tool.gripper for label, tool in robot.tool_labels() if tool.gripper is not None}
    if not grips:
        return rrb.Horizontal(contact)
    wide = _rounded_up(max(gripper.width_max for gripper in grips.values()))
    of = {label: f"{names[label]} " if len(names) > 1 else "" for label in grips}
    return rrb.Horizontal(
        _plot(
            "Gripper width [m]",
            {f"gripper/{label}width": (f"{name}width",) for label, name in of.items()},
            under={
                f"gripper/{label}width_command": (f"{name}command",) for label, name in of.items()
            },
            span=(-0.05 * wide, 1.1 * wide),
            legend=_RIGHT_BOTTOM,
        ),
        _plot(
            "Finger force [N]",
            {f"gripper/{label}force": gripper.fingers for label, gripper in grips.items()},
            legend=_RIGHT_TOP,
        ),
        contact,
    )


def _following() -> rrb.Container:
    """Return plots of how far the tool is from the target, and of what the stream told."""
    events = tuple(event.name.lower().replace("_", " ") for event in Event)
    return rrb.Horizontal(
        _plot("Distance from target [m]", {"target/position_error": ("distance",)}),
        _plot("Angle from target [rad]", {"target/angle_error": ("angle",)}),
        _plot("Events", {"target/events": events}, span=(-0.1, 1.6), legend=_RIGHT_TOP),
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
    signals: Mapping[str, Sequence[str]],
    *,
    under: Mapping[str, Sequence[str]] | None = None,
    limits: str | None = None,
    span: tuple[float, float] | None = None,
    legend: rrb.Corner2D | None = None,
) -> rrb.View:
    """Return a plot of signals, with the names of their lines, and what lies under them.

    Lines of `under` have the colours of those above them; limits are of all lines.
    """
    shown = []
    for lines, dim, width in ((under or {}, 2, 3.5), (signals, 1, 1.25)):
        first = 0
        for signal, labels in lines.items():
            colours = [_PALETTE[(first + i) % len(_PALETTE)] for i in range(len(labels))]
            dimmed = [(r // dim, g // dim, b // dim) for r, g, b in colours]
            shown.append(_lines(signal, labels, dimmed, width))
            first += len(labels)
    lines_of: dict[rr.encodings.EntityPath | str, list[rrb.Visualizer]] = {SIGNALS: shown}
    if limits is not None:
        count = 2 * sum(len(labels) for labels in signals.values())
        lines_of[LIMITS] = [_lines(limits, ["limit"] * count, [_LIMIT_COLOUR] * count, 0.75)]
    return rrb.TimeSeriesView(
        name=name,
        origin="/",
        contents=[f"/{entity}" for entity in lines_of],
        overrides=lines_of,
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
