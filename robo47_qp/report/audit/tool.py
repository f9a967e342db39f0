"""Audit of the tool: its distance from lines and arcs, and the bounds of its speed."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.model.arm import Arm
from robo47_qp.model.tool_poses import ToolPoses
from robo47_qp.motion.planner import Leg, Planner
from robo47_qp.motion.tool_motion import ToolMotion, tool_motion
from robo47_qp.motion.waypoint import Motion
from robo47_qp.report.audit.finding import Exempt, Finding, bounded, judged
from robo47_qp.run.scenario import Run

LIN_COMMANDED = 10e-6
"""Distance of the reference of a LIN or CIRC motion from its line or arc at most [m]."""
LIN_MEASURED = 0.3e-3
"""Distance of the tool from the line or arc at most [m]."""
HELD_APART, HELD_TURNED = 0.5e-3, 1e-3
"""Largest error of the pose of tools that hold one body, relative to each other [m, rad]."""
COMMANDED_EXCESS = 2e-3
"""Share by which the reference may exceed the bounds of the tool [-]: the planner bounds means
over up to three periods, and its joint paths are splines that approximate a line."""
MEASURED_EXCESS = 0.05
"""Share by which the tool may exceed the speed bounds of its reference [-]."""
_RATES = (
    ("tool speed", "m/s"),
    ("tool acceleration", "m/s²"),
    ("tool jerk", "m/s³"),
    ("tool turning speed", "rad/s"),
    ("tool turning acceleration", "rad/s²"),
    ("tool turning jerk", "rad/s³"),
)
"""Quantities in the order of `ToolMotion`."""
_SPEEDS = (0, 3)
_YIELDS = "the tool is compliant and gives way to what it touches"


def tool_paths(run: Run) -> list[Finding]:
    """Check the distances from lines and arcs; in compliant motions, of the reference only."""
    findings = []
    for motion in Motion:
        for signal, limit in (("commanded", LIN_COMMANDED), ("measured", LIN_MEASURED)):
            for label, tool in run.scenario.robot.tool_labels():
                off, covered, yields = _off_way(run, motion, (label, tool.name), signal)
                name, which = f"{motion.name} {signal}", tool.name if label else "tool"
                free = yields & (signal == "measured")
                exempt = Exempt(free, _YIELDS, covered)
                findings += judged(name, ["m"], (which,), off, np.array([limit]), exempt)
    return findings


def tool_rates(run: Run, arm: Arm) -> list[Finding]:
    """Check speed, acceleration and jerk of the tool in LIN and CIRC motions.

    The bounds are those of the tool's profile at the pace of each motion. The reference must keep
    all of them, the tool itself, which also vibrates, its speeds; those of a compliant tool are
    told, but not judged.
    """
    tools = enumerate(run.scenario.robot.tool_labels())
    return [found for i, (label, _) in tools for found in _rates_of(run, arm, i, label)]


def _rates_of(run: Run, arm: Arm, tool: int, label: str) -> list[Finding]:
    findings: list[Finding] = []
    name_of_tool = arm.robot.tools[tool].name
    which = f"{name_of_tool} " if label else ""
    for kind, yields in (("reference", None), ("measured", False), ("measured", True)):
        title, measured = which + kind, kind == "measured"
        spans = [
            span
            for span in _spans(run, yields)
            if span[1].waypoint.prescribes_path and _is_asked_for(span[1], label, name_of_tool)
        ]
        if not spans:
            continue
        rows = np.concatenate([span for span, _ in spans])
        names = [leg.waypoint.name for span, leg in spans for _ in span]
        bounds = np.array([_bounds(run.scenario.planner, leg) for _, leg in spans])
        if measured:
            bounds *= 1.0 + MEASURED_EXCESS
        limits = np.repeat(bounds, [len(span) for span, _ in spans], axis=0)
        motion = _motion(run, arm, rows, "" if measured else "_ref", tool)
        for i, (part, (name, unit)) in enumerate(zip(motion, _RATES, strict=True)):
            if (measured and i not in _SPEEDS) or not np.isfinite(bounds[:, i]).any():
                continue
            sizes = np.linalg.norm(part, axis=1)
            k = int(np.argmax(sizes / limits[:, i]))
            limit, extreme = float(limits[k, i]), float(sizes[k])
            findings.append(
                Finding(
                    signal=f"{title} {name} ({names[k]})" + (", exempt" if yields else ""),
                    unit=unit,
                    limit=limit,
                    extreme=extreme,
                    time=float(rows[k]) * TIMESTEP,
                    ok=bool(yields) or extreme <= limit * (1.0 + COMMANDED_EXCESS),
                    exempt=_YIELDS if yields else "",
                    share=len(rows) / len(run.rows),
                )
            )
    return findings


def held_together(run: Run) -> list[Finding]:
    """Check the pose of tools that hold one body, relative to each other, as they move it."""
    findings = []
    for title, kind in (("commanded", "_ref"), ("measured", "")):
        off = np.zeros((len(run.rows), 2))
        found = False
        for rows, leg in _spans(run, None if kind else False):
            holding = leg.waypoint.holding
            if holding is not None and len(holding) > 1:
                found = True
                off[rows] = _apart(run, rows, holding, kind)
        if found:
            limits = np.array([HELD_APART, HELD_TURNED])
            signal = f"relative pose {title}"
            findings.append(bounded(signal, ["m", "rad"], ("position", "angle"), off, limits))
    return findings


def _apart(run: Run, rows: NDArray[np.intp], holding: ToolPoses, kind: str) -> Matrix:
    """Return by how much tools are not where the first one wants them [m, rad] (N, 2)."""
    labels = {tool.name: label for label, tool in run.scenario.robot.tool_labels()}
    first, *others = holding
    worst = np.zeros((len(rows), 2))
    p, R = _places(run.rows[f"tool/{labels[first]}pose{kind}"][rows])
    for name in others:
        asked = holding[first].inverse() @ holding[name]
        p_other, R_other = _places(run.rows[f"tool/{labels[name]}pose{kind}"][rows])
        shift = R.inv().apply(p_other - p) - asked.translation()
        R_asked = Rotation.from_quat(asked.rotation().wxyz, scalar_first=True)
        turn = (R_asked.inv() * R.inv() * R_other).magnitude()
        apart = np.column_stack([np.linalg.norm(shift, axis=1), turn])
        worst = np.maximum(worst, apart)
    return worst


def _places(poses: Matrix) -> tuple[Matrix, Rotation]:
    return poses[:, :3], Rotation.from_quat(poses[:, 3:], scalar_first=True)


def _is_asked_for(leg: Leg, label: str, name: str) -> bool:
    """Return whether a leg moves a tool."""
    return not label if leg.tools is None else name in leg.tools


def _motion(run: Run, arm: Arm, rows: NDArray[np.intp], kind: str, tool: int) -> ToolMotion:
    """Return the motion of a tool in some rows; with kind "_ref", that of its reference."""
    q, v, a = (run.rows[f"joints/{name}{kind}"] for name in "qva")
    # Mean jerk of the period that a row begins; the last row begins none.
    after = a[np.minimum(rows + 1, len(a) - 1)]
    return tool_motion(arm, q[rows], v[rows], a[rows], (after - a[rows]) / TIMESTEP, tool)


def _bounds(planner: Planner, leg: Leg) -> Vector:
    """Return the bounds of the tool on the path of a leg, in the order of `ToolMotion` (6,)."""
    alone = leg.path is not None or leg.together is not None
    straight = alone and leg.waypoint.motion.type.straight
    profile = planner.lin.profile if straight else planner.continuous.profile
    slowed = profile.slowed(planner.pace * leg.waypoint.pace)
    bounds = np.array([*slowed.linear, *slowed.angular])
    if straight and not planner.law.bounds_jerk:
        bounds[[2, 5]] = np.inf
    return bounds


def _spans(run: Run, yields: bool | None = None) -> Iterator[tuple[NDArray[np.intp], Leg]]:
    """Yield the rows of each leg; if asked, only of those that are compliant, or are not."""
    for phase, rows in run.spans():
        if phase.leg is not None and yields in (None, phase.compliant):
            yield np.arange(rows.start, rows.stop), phase.leg


def _off_way(
    run: Run, motion: Motion, tool: tuple[str, str], signal: str
) -> tuple[Matrix, NDArray[np.bool_], NDArray[np.bool_]]:
    """Return a tool's distance from line or arc (N, 1), and in which rows there is one (N,).

    The tool is given by what its signals begin with, and its name. The last array tells in which
    rows it is compliant (N,).
    """
    label, name = tool
    poses = run.rows[f"tool/{label}pose{'' if signal == 'measured' else '_ref'}"]
    off = np.zeros((len(poses), 1))
    covered, compliant = np.zeros((2, len(poses)), bool)
    for yields in (False, True):
        for rows, leg in _spans(run, yields):
            if leg.waypoint.motion is not motion:
                continue
            if leg.path is not None and not label:
                off[rows, 0] = leg.path.distances(poses[rows, :3])
            elif leg.together is not None and leg.tools is not None and name in leg.tools:
                off[rows, 0] = leg.together.distances(name, poses[rows, :3], poses[rows, 3:])
            else:
                continue
            covered[rows], compliant[rows] = True, yields
    return off, covered, compliant
