"""RerunLog: writes a run to a Rerun file with its own layout, while the run goes on."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import rerun as rr

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.model.robot import Robot
from robo47_qp.motion.planner import Leg
from robo47_qp.report.rerun import blueprint as layout
from robo47_qp.report.rerun.body_poses import BodyPoses
from robo47_qp.report.rerun.columns import (
    PoseColumns,
    SignalColumn,
    check_rows,
    limit_columns,
    xyzw,
)
from robo47_qp.report.rerun.scene import body_name, body_shapes, undrawn
from robo47_qp.report.rerun.stream import RerunStream
from robo47_qp.run.observers import Observer
from robo47_qp.run.recording import Rows
from robo47_qp.run.signals import is_followed
from robo47_qp.sim.signal import Signal
from robo47_qp.sim.simulation import Simulation

FRAME_RATE = 60.0
"""Poses of the scene per second [1/s]."""
FLUSH_INTERVAL = 1.0
"""Time between two checks for write errors [s]. Rerun writes in the background; flushing only finds
errors, and costs as much as half a chunk."""
_ROOT = "tf#/"
"""Rerun's name of the world frame, in which the 3-D view is drawn."""
_AXES = np.eye(3) * 0.06
"""Arrows of a frame [m] and their colours: x red, y green, z blue."""
_AXIS_COLOURS = ((225, 70, 70), (80, 190, 90), (80, 130, 240))
_PATH_COLOUR = (255, 70, 150)


class RerunLog(Observer):
    """Sink and observer of a run: writes rows in large pieces, and events as they come.

    What a killed process has not written yet is in its `RowFile`.
    """

    def __init__(
        self,
        path: Path,
        model: mujoco.MjModel,
        robot: Robot,
        signals: Sequence[Signal],
        *,
        viewer: str | None = None,
        keep: Callable[[Mapping[str, Any]], None] | None = None,
    ) -> None:
        """Open the file and write what does not change.

        Args:
            path: The file; its folders are created, an existing file is replaced.
            model: The scene.
            robot: The robot in it.
            signals: The signals of the rows.
            viewer: URL of a viewer that shows the recording while it is made.
            keep: Gets every event that is drawn, as JSON types, for `draw` of another log.

        Raises:
            RecordingError: The file cannot be written.
            RenderingError: There is no viewer at the URL.
        """
        self._keep = keep
        page = layout.blueprint(robot, followed=is_followed(signals))
        self._stream = RerunStream(path, f"robo47_qp {robot.name}", page, viewer)
        self._poses = BodyPoses(model, robot)
        self._columns = [SignalColumn(signal) for signal in signals if signal.shown]
        self._limits = limit_columns(model, robot)
        self._unit = robot.unit("rad", "m")
        self._markers: dict[str, Vector] = {}
        self._tools = [label for label, _ in robot.tool_labels()]
        self._last_frame = -1.0
        self._last_tools = [np.empty((0, 3)) for _ in self._tools]
        self._now = self._next_flush = 0.0
        moving = [body_name(model, body) for body in self._poses.moving]
        tools = [f"{label}{layout.TOOL}" for label in self._tools]
        self._frames = PoseColumns([*moving, *tools], _ROOT)
        self._describe(signals)
        self._draw_scene(model)
        self._stream.flush(0.0)

    def write(self, rows: Rows) -> None:
        """See `Sink.write`.

        Raises:
            RecordingError: A value is not finite, a quaternion has no unit length, or the
                file cannot be written.
        """
        check_rows(rows)
        self._stream.require_room(self._now)
        times = rows["time"][:, 0]
        if self._now >= self._next_flush:
            self._next_flush = self._now + FLUSH_INTERVAL
            self._draw_limits(times[[0, -1]])
            # The previous chunk has been written by now: flushing does not wait.
            if not self._stream.flush(self._now):
                self.note(self._now, "the viewer was closed; the recording continues", "WARN")
        self._stream.send(layout.SIGNALS, times, [column.of(rows) for column in self._columns])
        self._draw_frames(rows)
        self._now = float(times[-1])

    def planned(self, time: float, leg: Leg, tool_paths: Mapping[str, Matrix]) -> None:
        """Draw a leg with its tools' positions (N, 3) [m], and log how it was planned."""
        waypoint, ik = leg.waypoint, leg.ik
        goals = [leg.T_world_goal] if leg.tools is None else list(leg.tools.values())
        paths = [path[:: max(1, len(path) // 60)].tolist() for path in tool_paths.values()]
        self._event(
            {
                "event": "planned",
                "time": time,
                "colour": list(waypoint.motion.type.colour),
                "paths": paths,
                "goals": [goal.as_matrix().tolist() for goal in goals],
            }
        )
        self.note(
            time,
            f"{waypoint.motion.name} to '{waypoint.name}', {leg.trajectory.duration:.2f} s; IK "
            f"{ik.iterations} steps, {ik.restarts} restarts, {1e3 * ik.seconds:.2f} ms, error "
            f"{1e6 * ik.position_error:.2g} µm and {1e6 * ik.orientation_error:.2g} µrad, "
            f"{ik.limit_margin:.2f} {self._unit} from a joint limit",
        )

    def phase(self, time: float, name: str) -> None:
        """Record that a phase starts at `time` [s]."""
        self._event({"event": "phase", "time": time, "name": name})

    def note(self, time: float, text: str, level: str = "INFO") -> None:
        """Add a line to the events at `time` [s]; level is INFO, WARN or ERROR."""
        self._event({"event": "note", "time": time, "text": text, "level": level})

    def tick(self, simulation: Simulation) -> None:
        """Draw the markers that have moved."""
        for name in simulation.markers:
            pose = simulation.marker_pose(name).wxyz_xyz
            if name not in self._markers or (pose != self._markers[name]).any():
                # The first pose of a marker holds from the start.
                time = simulation.time if name in self._markers else 0.0
                self._markers[name] = pose
                place = {"position": pose[4:].tolist(), "wxyz": pose[:4].tolist()}
                self._event({"event": "marker", "time": time, "name": name, **place})

    def draw(self, event: Mapping[str, Any]) -> None:
        """Draw an event that another log has kept.

        Raises:
            KeyError: It is none.
        """
        time: float = event["time"]
        match event["event"]:
            case "planned":
                self._draw_plan(time, event)
            case "phase":
                self._stream.log(layout.PHASES, rr.StateChange(state=event["name"]), time=time)
            case "note":
                line = rr.TextLog(f"{time:.2f} s  {event['text']}", level=event["level"])
                self._stream.log(layout.EVENTS, line, time=time)
            case "marker":
                place = rr.Transform3D(
                    translation=event["position"],
                    quaternion=rr.Quaternion(xyzw=xyzw(np.array(event["wxyz"]))),
                    child_frame=event["name"],
                    parent_frame=_ROOT,
                )
                self._stream.log(f"{layout.FRAMES}/markers", place, time=time)
            case other:
                raise KeyError(other)

    def finish(self, summary: str) -> None:
        """Add a summary in Markdown and close the file.

        Raises:
            RecordingError: The file is not complete.
        """
        document = rr.TextDocument(summary, media_type=rr.MediaType.MARKDOWN)
        self._stream.log(layout.SUMMARY, document)
        self.break_off()

    def break_off(self) -> None:
        """Close the file of a run that was interrupted, which has no summary.

        Raises:
            RecordingError: The file is not complete.
        """
        self._draw_limits(np.full(2, self._now))
        self._stream.finish(self._now)

    def close(self) -> None:
        """Close the file, complete or not; a second time does nothing."""
        self._stream.close()

    def _event(self, event: Mapping[str, Any]) -> None:
        if self._keep is not None:
            self._keep(event)
        self.draw(event)

    def _draw_plan(self, time: float, event: Mapping[str, Any]) -> None:
        """Draw the path and the goals of a planned leg."""
        # Dashed and thick, so that the thin line of the tool is visible in between.
        dashes = rr.LineStrips3D(
            [path[k : k + 2] for path in event["paths"] for k in range(0, len(path) - 1, 2)],
            colors=event["colour"],
            radii=0.004,
        )
        self._stream.log(layout.PLANNED, dashes, time=time)
        for i, goal in enumerate(event["goals"]):
            entity = f"{layout.GOALS}/{i}" if i else layout.GOALS
            self._stream.log(entity, _frame(np.array(goal)), time=time)

    def _describe(self, signals: Sequence[Signal]) -> None:
        labels = {signal.name: list(signal.labels) for signal in signals}
        units = {signal.name: signal.unit for signal in signals}
        self._stream.log(
            layout.SIGNALS,
            rr.DynamicArchetype("labels", components=labels),
            rr.DynamicArchetype("units", components=units),
        )

    def _draw_scene(self, model: mujoco.MjModel) -> None:
        for body, position, quaternion in zip(
            self._poses.fixed, *self._poses.of_fixed(), strict=True
        ):
            path = f"{layout.WORLD}/{rr.escape_entity_path_part(body_name(model, body))}"
            T = rr.Transform3D(
                translation=position, quaternion=rr.Quaternion(xyzw=xyzw(quaternion))
            )
            self._stream.log(path, T)
        for body in range(model.nbody):
            name = body_name(model, body)
            path = f"{layout.WORLD}/{rr.escape_entity_path_part(name)}"
            frame = [] if body in self._poses.fixed else [rr.CoordinateFrame(name)]
            for kind, shape in body_shapes(model, body):
                self._stream.log(f"{path}/{kind}", shape, *frame)
        style = rr.LineStrips3D.from_fields(colors=_PATH_COLOUR, radii=0.0018)
        for label in self._tools:
            tool = f"{label}{layout.TOOL}"
            self._stream.log(_of_tool(layout.PATH, label), style)
            axes = _of_tool(layout.TOOL, label)
            self._stream.log(axes, _frame(np.eye(4)), rr.CoordinateFrame(tool))
        for geom in undrawn(model):
            self.note(0.0, f"geom {geom!r} has a type that is not drawn", "WARN")

    def _draw_limits(self, times: Vector) -> None:
        self._stream.send(layout.LIMITS, times, self._limits)

    def _draw_frames(self, rows: Rows) -> None:
        """Draw the poses of all moving frames, and the path of the tool."""
        frames = np.floor(rows["time"][:, 0] * FRAME_RATE + 1e-6)
        picked = np.flatnonzero(np.diff(frames, prepend=self._last_frame) > 0.0)
        if not picked.size:
            return
        self._last_frame = float(frames[-1])
        times = rows["time"][picked, 0]
        tools = np.stack([rows[f"tool/{label}pose"][picked] for label in self._tools], axis=1)
        positions, quaternions = self._poses.of_moving(rows, picked)
        columns = self._frames.of(
            np.concatenate((positions, tools[:, :, :3]), axis=1),
            np.concatenate((quaternions, tools[:, :, 3:]), axis=1),
        )
        count = positions.shape[1] + len(self._tools)
        self._stream.send(layout.FRAMES, np.repeat(times, count), columns)
        for i, label in enumerate(self._tools):
            way = np.concatenate((self._last_tools[i], tools[:, i, :3]))
            self._last_tools[i] = tools[-1:, i, :3].copy()
            if len(way) > 1:
                strips = np.stack((way[:-1], way[1:]), axis=1).astype(np.float32)
                lines = rr.LineStrips3D.columns(strips=strips)
                self._stream.send(_of_tool(layout.PATH, label), times[-len(strips) :], list(lines))


def _of_tool(entity: str, label: str) -> str:
    """Return the entity of a tool, below that of the main one."""
    return f"{entity}/{label}{entity}" if label else entity


def _frame(T: Matrix) -> rr.Arrows3D:
    """Return the axes of a frame at pose T (4, 4)."""
    vectors = _AXES @ T[:3, :3].T
    return rr.Arrows3D(
        vectors=vectors, origins=np.tile(T[:3, 3], (3, 1)), colors=_AXIS_COLOURS, radii=0.002
    )
