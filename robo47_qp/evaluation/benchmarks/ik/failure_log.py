"""Recording of a comparison: targets coloured by outcome, and the arm at each failure."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from robo47_qp.arrays import Vector
from robo47_qp.evaluation.benchmarks.ik.answers import COLOURS, GOOD, Answers, Outcome, outcomes
from robo47_qp.model.mjcf import compiled, robot_spec
from robo47_qp.model.robot import Robot
from robo47_qp.report.rerun.columns import xyzw
from robo47_qp.report.rerun.scene import body_name, body_shapes
from robo47_qp.report.rerun.stream import RerunStream

MOST = 200
"""Largest number of failures shown per solver; of more, an evenly spaced selection."""
_AXIS_COLOURS = ((225, 70, 70), (80, 190, 90), (80, 130, 240))
_GAP = (255, 70, 150)
_LENGTH = 0.1
"""Length of the axes of a target [m]."""


class Failure(NamedTuple):
    """A target on which a solver failed."""

    answers: Answers
    k: int
    outcome: Outcome

    @property
    def q(self) -> Vector | None:
        """The solver's configuration (n,) [rad]; None where that is none."""
        q = self.answers.items[self.k].q
        return q if np.isfinite(q).all() else None

    @property
    def target(self) -> Vector:
        """Return the target pose, wxyz and position (7,)."""
        return np.asarray(self.answers.targets.targets[self.k].wxyz_xyz)


class FailureLog:
    """Writes the recording of a comparison, without the hostile targets, which are no poses."""

    def __init__(self, path: Path, robot: Robot, solvers: Sequence[str]) -> None:
        """Open the file.

        Raises:
            RecordingError: The file cannot be written.
        """
        self._stream = RerunStream(path, f"robo47_qp ik {robot.name}", pages(solvers), None)
        self._model = compiled(robot_spec(robot), robot.mjcf)
        self._data = mujoco.MjData(self._model)
        self._q = [int(self._model.joint(name).qposadr[0]) for name in robot.joints]
        self._tcp = self._model.site(robot.tcp).id
        self._home = np.asarray(robot.home)

    def write(self, fields: Sequence[Sequence[Answers]], figures: str) -> None:
        """Write all targets and failures, and the figures as Markdown.

        Raises:
            RecordingError: The file cannot be written.
        """
        text = f"{figures}\n\n{legend()}"
        document = rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)
        self._stream.log(FIGURES, document)
        drawn = [field for field in fields if field[0].targets.name != "hostile"]
        for own in zip(*drawn, strict=True):
            self._stream.require_room(0.0)
            self._solver(rr.escape_entity_path_part(own[0].solver), own)
        self._stream.finish(0.0)

    def close(self) -> None:
        """Close the file, complete or not; may be called twice."""
        self._stream.close()

    def _solver(self, root: str, own: Sequence[Answers]) -> None:
        failures: list[Failure] = []
        for answers in own:
            found = outcomes(answers)
            places = answers.targets.positions(answers.n)
            colours = [COLOURS[outcome] for outcome in found]
            points = rr.Points3D(places, colors=colours, radii=rr.Radius.ui_points(2.5))
            self._stream.log(f"{root}/targets/{answers.targets.name}", points)
            failures += [Failure(answers, k, o) for k, o in enumerate(found) if o not in GOOD]
        count = len(failures)
        picked = np.unique(np.linspace(0, count - 1, min(count, MOST)).round().astype(int))
        self._arm(root, [failures[i] for i in picked])
        words = [
            why(failures[i].answers, failures[i].k, failures[i].outcome, f"{i + 1} of {count}")
            for i in picked
        ]
        self._words(root, words or [f"# {own[0].solver}\n\nNo failures."])
        if failures:
            self._goals(root, [failures[i] for i in picked])

    def _arm(self, root: str, failures: Sequence[Failure]) -> None:
        """Log the geometry of all bodies, and their poses at each failure, or at home."""
        m = self._model
        positions, quaternions = [], []
        for q in [failure.q for failure in failures] or [None]:
            d = self._at(q)
            positions.append(d.xpos.copy())
            quaternions.append(xyzw(d.xquat))
        index = _index(len(positions))
        for body in range(1, m.nbody):
            shapes = list(body_shapes(m, body))
            path = f"{root}/arm/{rr.escape_entity_path_part(body_name(m, body))}"
            for kind, shape in shapes:
                self._stream.log(f"{path}/{kind}", shape)
            if shapes:
                columns = rr.Transform3D.columns(
                    translation=[p[body] for p in positions],
                    quaternion=[x[body] for x in quaternions],
                )
                self._stream.send_at(path, index, columns)

    def _goals(self, root: str, failures: Sequence[Failure]) -> None:
        """Log the target's frame, and the line from the tool to it."""
        axes = rr.Arrows3D(vectors=_LENGTH * np.eye(3), colors=_AXIS_COLOURS, radii=0.004)
        self._stream.log(f"{root}/goal/axes", axes)
        self._stream.log(f"{root}/gap", rr.LineStrips3D.from_fields(colors=_GAP, radii=0.003))
        targets = np.array([failure.target for failure in failures])
        gaps = []
        for failure, target in zip(failures, targets, strict=True):
            tool = self._at(failure.q).site_xpos[self._tcp]
            gaps.append(np.array([tool, target[4:]], dtype=np.float32))
        index = _index(len(failures))
        pose = rr.Transform3D.columns(translation=targets[:, 4:], quaternion=xyzw(targets[:, :4]))
        self._stream.send_at(f"{root}/goal", index, pose)
        self._stream.send_at(f"{root}/gap", index, rr.LineStrips3D.columns(strips=gaps))

    def _at(self, q: Vector | None) -> mujoco.MjData:
        """Place the robot at a configuration; at home where there is none."""
        d = self._data
        d.qpos[:] = self._model.qpos0
        d.qpos[self._q] = self._home if q is None else q
        mujoco.mj_kinematics(self._model, d)
        return d

    def _words(self, root: str, words: Sequence[str]) -> None:
        kinds = [rr.MediaType.MARKDOWN] * len(words)
        columns = rr.TextDocument.columns(text=list(words), media_type=kinds)
        self._stream.send_at(f"{root}/why", _index(len(words)), columns)


def _index(count: int) -> rr.TimeColumn:
    return rr.TimeColumn(FAILURE, sequence=range(1, count + 1))


FAILURE = "failure"
"""Timeline: number of the failure, counted per solver."""
FIGURES = "figures"
"""Entity path of the tables."""


def pages(solvers: Sequence[str]) -> rrb.Blueprint:
    """Return the layout: one tab per solver, with the figures first."""
    return rrb.Blueprint(
        rrb.Tabs(
            rrb.TextDocumentView(name="Figures", origin=f"/{FIGURES}"),
            *(_page(solver) for solver in solvers),
            active_tab=min(1, len(solvers)),
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=FAILURE, play_state="paused", fps=2.0),
        auto_layout=False,
        auto_views=False,
    )


def _page(solver: str) -> rrb.Horizontal:
    origin = f"/{rr.escape_entity_path_part(solver)}"
    scene = rrb.Spatial3DView(
        name="Targets and failures",
        origin=origin,
        contents=["$origin/**", "- $origin/why"],
        background=(24, 27, 32),
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            position=(1.9, -1.5, 1.25), look_target=(0.0, 0.0, 0.4), eye_up=(0, 0, 1)
        ),
    )
    why = rrb.TextDocumentView(name="This failure", origin=f"{origin}/why")
    return rrb.Horizontal(scene, why, column_shares=[3, 1], name=solver)


def why(answers: Answers, k: int, outcome: Outcome, place: str) -> str:
    """Describe one failure: the target, the result and the solver's message.

    Args:
        answers: All results of the solver.
        k: Index of the target.
        outcome: Its outcome.
        place: Number of this failure and count of all.
    """
    answer = answers.items[k]
    verdict = answer.verdict
    kinds = answers.targets.kinds
    lines = [
        f"# {answers.solver}: {outcome.value}",
        "",
        f"Failure {place}: target {k} of `{answers.targets.name}`"
        + (f" ({kinds[k]})" if kinds else ""),
        "",
        "| | |",
        "|---|--:|",
        f"| tool off by | {1e3 * verdict.position_error:.3g} mm |",
        f"| and | {np.degrees(verdict.orientation_error):.3g}° |",
        f"| outside the limits by | {verdict.limit_excess:.3g} rad |",
        f"| steps | {answer.iterations} |",
        f"| restarts | {answer.restarts} |",
        f"| processor time | {1e3 * answer.seconds:.3g} ms |",
    ]
    if verdict.pair is not None:
        first, second = verdict.pair
        lines.append(f"| {first} in {second} | {1e3 * verdict.penetration:.1f} mm |")
    said = "reached" if answer.reason is None else answer.reason
    lines += ["", f"The solver says: **{said}**. {answer.explanation}", ""]
    lines += ["q = " + " ".join(f"{value:.4f}" for value in answer.q) + " rad"]
    return "\n".join(lines)


def legend() -> str:
    """Return the legend of the targets' colours as Markdown."""
    lines = ["| colour (red, green, blue) | outcome |", "|---|---|"]
    lines += [f"| {COLOURS[outcome]} | {outcome.value} |" for outcome in Outcome]
    return "\n".join(lines)


def figures_markdown(summary: Mapping[str, Any]) -> str:
    """Return the rows of a report as Markdown tables."""
    rows: Sequence[Mapping[str, Any]] = summary["rows"]
    lines = [f"# Inverse kinematics of {summary['robot']}, seed {summary['seed']}", ""]
    for name in dict.fromkeys(row["targets"] for row in rows):
        own = [row for row in rows if row["targets"] == name]
        lines += [
            f"## {name}, {own[0]['n']} targets",
            "",
            "| solver | success % | 95 % interval | tight % | collision-free % | outside limits "
            "| median ms | p95 ms | p99 ms |",
            "|---|--:|--:|--:|--:|--:|--:|--:|--:|",
        ]
        lines += [
            f"| {row['solver']} | {100 * row['success']:.2f} | {100 * row['interval'][0]:.2f} – "
            f"{100 * row['interval'][1]:.2f} | {100 * row['tight']:.2f} | "
            f"{100 * row['collision_free']:.2f} | {row['limit_violations']} | "
            f"{row['median_ms']:.3f} | {row['p95_ms']:.3f} | {row['p99_ms']:.3f} |"
            for row in own
        ]
        lines.append("")
    return "\n".join(lines)
