"""Audit of the tool: its distance from lines and arcs, and the bounds of its speed."""

from collections.abc import Iterator
from math import inf

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
from robo47_qp.report.audit.finding import Exempt, Finding, judged
from robo47_qp.run.phase import Phase
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
"""Share of the speed bounds of its profile by which the tool may exceed those of its reference [-]:
it vibrates as much where a step is slow."""
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
_YIELDS = "the tool is compliant and gives way to what it touches, or stops where it has touched"
_PRESSES = "the tool presses, and goes along its axis as the force that it feels asks for"
_TOUCHES = "the tool presses, or gives way to what it touches"


def tool_paths(run: Run) -> list[Finding]:
    """Check the distances from lines and arcs; in contact, of the reference only.

    Where the tool presses, distances of the reference along the axis of that do not count.
    """
    findings = []
    for motion in Motion:
        for signal, limit in (("commanded", LIN_COMMANDED), ("measured", LIN_MEASURED)):
            for label, tool in run.scenario.robot.tool_labels():
                off, covered, free = _off_way(run, motion, (label, tool.name), signal)
                name, which = f"{motion.name} {signal}", tool.name if label else "tool"
                exempt = Exempt(free & (signal == "measured"), _TOUCHES, covered)
                findings += judged(name, ["m"], (which,), off, np.array([limit]), exempt)
    return findings


def tool_rates(run: Run, arm: Arm) -> list[Finding]:
    """Check speed, acceleration and jerk of the tool in LIN and CIRC motions.

    The bounds are those of the tool's profile at the pace of each motion, and the speed that its
    step allows, which a tool that presses exceeds along its axis. The reference must keep all of
    them, the tool itself, which also vibrates, its speeds. Told, but not judged, are the
    speeds of a compliant tool, and but for its speed the reference of one that presses.
    """
    tools = enumerate(run.scenario.robot.tool_labels())
    return [found for i, (label, _) in tools for found in _rates_of(run, arm, i, label)]


def _rates_of(run: Run, arm: Arm, tool: int, label: str) -> list[Finding]:
    findings: list[Finding] = []
    name_of_tool = arm.robot.tools[tool].name
    which = f"{name_of_tool} " if label else ""
    spans = [
        (rows, phase, leg)
        for rows, phase, leg in _spans(run)
        if leg.waypoint.prescribes_path and _is_asked_for(leg, label, name_of_tool)
    ]
    if not spans:
        return []
    rows = np.concatenate([span for span, *_ in spans])
    names = [leg.waypoint.name for span, _, leg in spans for _ in span]
    lengths = [len(span) for span, *_ in spans]
    planner = run.scenario.planner
    usual = np.array([_bounds(planner, leg) for *_, leg in spans])
    allowed = [inf if phase.axis is not None else leg.speed for _, phase, leg in spans]
    bounds = np.array(
        [_bounds(planner.slower(v), leg) for v, (*_, leg) in zip(allowed, spans, strict=True)]
    )
    yields = np.repeat([phase.compliant for _, phase, _ in spans], lengths)
    presses = np.repeat([phase.axis is not None for _, phase, _ in spans], lengths)
    for kind, most in (("reference", bounds), ("measured", bounds + MEASURED_EXCESS * usual)):
        measured = kind == "measured"
        limits = np.repeat(most, lengths, axis=0)
        motion = _motion(run, arm, rows, "" if measured else "_ref", tool)
        for i in _SPEEDS if measured else range(len(_RATES)):
            name, unit = _RATES[i]
            sizes, bounded_at = np.linalg.norm(motion[i], axis=1), np.isfinite(limits[:, i])
            exempt, why = (
                (yields, _YIELDS) if measured else (presses & (i not in _SPEEDS), _PRESSES)
            )
            for judged_at, reason in ((~exempt, ""), (exempt, why)):
                of = judged_at & bounded_at
                if not of.any():
                    continue
                k = int(np.argmax(np.where(of, sizes / limits[:, i], -1.0)))
                limit, extreme = float(limits[k, i]), float(sizes[k])
                told = f"{which}{kind} {name} ({names[k]})"
                findings.append(
                    Finding(
                        signal=f"{told}, exempt" if reason else told,
                        unit=unit,
                        limit=limit,
                        extreme=extreme,
                        time=float(rows[k]) * TIMESTEP,
                        ok=bool(reason) or extreme <= limit * (1.0 + COMMANDED_EXCESS),
                        exempt=reason,
                        share=np.count_nonzero(of) / len(run.rows),
                    )
                )
    return findings


def held_together(run: Run) -> list[Finding]:
    """Check the pose of tools that hold one body, relative to each other, as they move it.

    Told, but not judged, is that of compliant tools; that of their reference is judged.
    """
    findings = []
    for title, kind in (("commanded", "_ref"), ("measured", "")):
        off = np.zeros((len(run.rows), 2))
        covered, yields = np.zeros((2, len(run.rows)), bool)
        for rows, phase, leg in _spans(run):
            holding = leg.waypoint.holding
            if holding is not None and len(holding) > 1:
                off[rows] = _apart(run, rows, holding, kind)
                covered[rows], yields[rows] = True, phase.compliant and not kind
        limits, exempt = np.array([HELD_APART, HELD_TURNED]), Exempt(yields, _YIELDS, covered)
        names, units = ("position", "angle"), ("m", "rad")
        findings += judged(f"relative pose {title}", units, names, off, limits, exempt)
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


def _spans(run: Run) -> Iterator[tuple[NDArray[np.intp], Phase, Leg]]:
    """Yield the rows of each leg, with its phase."""
    for phase, rows in run.spans():
        if phase.leg is not None:
            yield np.arange(rows.start, rows.stop), phase, phase.leg


def _off_way(
    run: Run, motion: Motion, tool: tuple[str, str], signal: str
) -> tuple[Matrix, NDArray[np.bool_], NDArray[np.bool_]]:
    """Return a tool's distance from line or arc (N, 1), and in which rows there is one (N,).

    The tool is given by what its signals begin with, and its name. The last array tells in which
    rows it touches something on purpose (N,).
    """
    label, name = tool
    poses = run.rows[f"tool/{label}pose{'' if signal == 'measured' else '_ref'}"]
    off = np.zeros((len(poses), 1))
    covered, touches = np.zeros((2, len(poses)), bool)
    for rows, phase, leg in _spans(run):
        if leg.waypoint.motion is not motion:
            continue
        if leg.path is not None and not label:
            # Where the tool itself is as it presses is told, not judged: all of it.
            free = None if signal == "measured" else phase.axis
            off[rows, 0] = leg.path.distances(poses[rows, :3], free)
        elif leg.together is not None and leg.tools is not None and name in leg.tools:
            off[rows, 0] = leg.together.distances(name, poses[rows, :3], poses[rows, 3:])
        else:
            continue
        covered[rows], touches[rows] = True, phase.compliant or phase.axis is not None
    return off, covered, touches
