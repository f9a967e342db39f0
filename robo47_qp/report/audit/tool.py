"""Audit of the tool: its distance from lines and arcs, and the bounds of its speed."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.model.arm import Arm
from robo47_qp.motion.planner import Leg, Planner
from robo47_qp.motion.tool_motion import ToolMotion, tool_motion
from robo47_qp.motion.waypoint import Motion
from robo47_qp.report.audit.finding import Finding, bounded
from robo47_qp.run.scenario import Run

LIN_COMMANDED = 10e-6
"""Distance of the reference of a LIN or CIRC motion from its line or arc at most [m]."""
LIN_MEASURED = 0.3e-3
"""Distance of the tool from the line or arc at most [m]."""
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


def tool_paths(run: Run) -> list[Finding]:
    """Check the distances from lines and arcs; in compliant motions, of the reference only."""
    findings = []
    for motion in Motion:
        for signal, column, limit in (
            ("commanded", "tool/pose_ref", LIN_COMMANDED),
            ("measured", "tool/pose", LIN_MEASURED),
        ):
            measured = signal == "measured"
            off = _off_way(run, motion, run.rows[column][:, :3], measured)
            if off is not None:
                name = f"{motion.name} {signal}"
                findings.append(bounded(name, ["m"], ("tool",), off, np.array([limit])))
    return findings


def tool_rates(run: Run, arm: Arm) -> list[Finding]:
    """Check speed, acceleration and jerk of the tool in LIN and CIRC motions.

    The bounds are those of the tool's profile at the pace of each motion. The reference must keep
    all of them, the tool itself, which also vibrates, its speeds; a compliant tool is not checked.
    """
    findings: list[Finding] = []
    for title, measured in (("reference", False), ("measured", True)):
        spans = [span for span in _spans(run, measured) if span[1].waypoint.prescribes_path]
        if not spans:
            continue
        rows = np.concatenate([span for span, _ in spans])
        names = [leg.waypoint.name for span, leg in spans for _ in span]
        bounds = np.array([_bounds(run.scenario.planner, leg) for _, leg in spans])
        if measured:
            bounds *= 1.0 + MEASURED_EXCESS
        limits = np.repeat(bounds, [len(span) for span, _ in spans], axis=0)
        motion = _motion(run, arm, rows, "" if measured else "_ref")
        for i, (part, (name, unit)) in enumerate(zip(motion, _RATES, strict=True)):
            if (measured and i not in _SPEEDS) or not np.isfinite(bounds[:, i]).any():
                continue
            sizes = np.linalg.norm(part, axis=1)
            k = int(np.argmax(sizes / limits[:, i]))
            limit, extreme = float(limits[k, i]), float(sizes[k])
            findings.append(
                Finding(
                    signal=f"{title} {name} ({names[k]})",
                    unit=unit,
                    limit=limit,
                    extreme=extreme,
                    time=float(rows[k]) * TIMESTEP,
                    ok=extreme <= limit * (1.0 + COMMANDED_EXCESS),
                )
            )
    return findings


def _motion(run: Run, arm: Arm, rows: NDArray[np.intp], kind: str) -> ToolMotion:
    """Return the motion of the tool in some rows; with kind "_ref", that of its reference."""
    q, v, a = (run.rows[f"joints/{name}{kind}"] for name in "qva")
    # Mean jerk of the period that a row begins; the last row begins none.
    after = a[np.minimum(rows + 1, len(a) - 1)]
    return tool_motion(arm, q[rows], v[rows], a[rows], (after - a[rows]) / TIMESTEP)


def _bounds(planner: Planner, leg: Leg) -> Vector:
    """Return the bounds of the tool on the path of a leg, in the order of `ToolMotion` (6,)."""
    straight = leg.path is not None and leg.waypoint.motion.type.straight
    profile = planner.lin.profile if straight else planner.continuous.profile
    slowed = profile.slowed(planner.pace * leg.waypoint.pace)
    bounds = np.array([*slowed.linear, *slowed.angular])
    if straight and not planner.law.bounds_jerk:
        bounds[[2, 5]] = np.inf
    return bounds


def _spans(run: Run, measured: bool) -> Iterator[tuple[NDArray[np.intp], Leg]]:
    """Yield the rows of each leg; for the measured tool, only of those that are not compliant."""
    for phase, rows in run.spans():
        if phase.leg is not None and not (measured and phase.compliant):
            yield np.arange(rows.start, rows.stop), phase.leg


def _off_way(run: Run, motion: Motion, positions: Matrix, measured: bool) -> Matrix | None:
    """Return the distance from line or arc in the rows of such motions (N, 1), 0 elsewhere."""
    off = np.zeros((len(positions), 1))
    found = False
    for rows, leg in _spans(run, measured):
        if leg.path is not None and leg.waypoint.motion is motion:
            found = True
            off[rows, 0] = leg.path.distances(positions[rows])
    return off if found else None
