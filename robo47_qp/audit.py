"""The audit: what was promised against what the simulated robot did."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robo47_qp.arm import Arm
from robo47_qp.arrays import Matrix, Vector
from robo47_qp.run import Phase, Run
from robo47_qp.scene import TIMESTEP
from robo47_qp.waypoint import Motion

LIN_COMMANDED = 10e-6
"""How far the reference of a LIN or CIRC motion may leave its line or arc [m]."""
LIN_MEASURED = 0.3e-3
"""How far the tool may leave the line or arc [m]."""
_ROUNDING = 1e-9
"""Relative slack for the rounding of differences."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One promise and whether it was kept."""

    signal: str
    """What was looked at, with the joint where there is one."""
    unit: str
    limit: float
    """What was promised."""
    extreme: float
    """What came closest to the limit, or went furthest beyond it."""
    time: float
    """When [s]."""
    ok: bool


def audit(run: Run) -> list[Finding]:
    """Check a run against the limits of its scenario, from its recorded signals alone."""
    scenario, rows = run.scenario, run.rows
    arm = Arm(scenario.robot)
    robot, joints = scenario.robot, scenario.robot.joints
    profile = scenario.planner.profile.slowed(scenario.planner.speed)
    tau, a_ref = rows["joints/tau_command"], rows["joints/a_ref"]
    unit = robot.units
    efforts = ["N" if u == "m" else "N·m" for u in unit]
    v, a, jerk, rate = (
        [u + per for u in units]
        for units, per in ((unit, "/s"), (unit, "/s²"), (unit, "/s³"), (efforts, "/s"))
    )
    findings = [
        *_within("reference q", unit, joints, rows["joints/q_ref"], arm.q_min, arm.q_max),
        _bounded("reference v", v, joints, rows["joints/v_ref"], profile.v_max),
        _bounded("reference a", a, joints, a_ref, profile.a_max),
        _bounded("reference jerk", jerk, joints, _rate(a_ref), profile.j_max),
        *_within("measured q", unit, joints, rows["joints/q"], arm.q_min, arm.q_max),
        _bounded("measured v", v, joints, rows["joints/v"], robot.rated.v_max),
        _bounded("torque", efforts, joints, tau, robot.tau_max),
        _bounded("torque rate", rate, joints, _rate(tau), robot.tau_rate_max),
    ]
    for motion in (Motion.LIN, Motion.CIRC):
        for signal, column, limit in (
            ("commanded", "tool/pose_ref", LIN_COMMANDED),
            ("measured", "tool/pose", LIN_MEASURED),
        ):
            off = _off_way(run.phases, motion, rows[column][:, :3])
            if off is not None:
                name = f"{motion.name} {signal}"
                findings.append(_bounded(name, ["m"], ("tool",), off, np.array([limit])))
    return findings


def _bounded(
    signal: str, units: Sequence[str], names: Sequence[str], values: Matrix, bound: Vector
) -> Finding:
    """The column that uses most of its symmetric bound."""
    use = np.abs(values) / bound
    row, column = divmod(int(np.argmax(use)), use.shape[1])
    return Finding(
        signal=f"{signal} ({names[column]})",
        unit=units[column],
        limit=float(bound[column]),
        extreme=float(np.abs(values[row, column])),
        time=row * TIMESTEP,
        ok=bool(use[row, column] <= 1.0 + _ROUNDING),
    )


def _within(
    signal: str,
    units: Sequence[str],
    names: Sequence[str],
    values: Matrix,
    low: Vector,
    high: Vector,
) -> list[Finding]:
    """The columns that come closest to their lower and to their upper bound."""
    findings = []
    for side, bound, margin in (("lower", low, values - low), ("upper", high, high - values)):
        row, column = divmod(int(np.argmin(margin)), margin.shape[1])
        findings.append(
            Finding(
                signal=f"{signal} {side} ({names[column]})",
                unit=units[column],
                limit=float(bound[column]),
                extreme=float(values[row, column]),
                time=row * TIMESTEP,
                ok=bool(margin[row, column] >= 0.0),
            )
        )
    return findings


def _rate(values: Matrix) -> Matrix:
    return np.diff(values, axis=0) / TIMESTEP


def _off_way(phases: Sequence[Phase], motion: Motion, positions: Matrix) -> Matrix | None:
    """Distance from line or arc in the rows of such motions (N, 1), 0 elsewhere."""
    off = np.zeros((len(positions), 1))
    found = False
    ends = [phase.start for phase in phases[1:]] + [len(positions)]
    for phase, end in zip(phases, ends, strict=True):
        leg = phase.leg
        if leg is not None and leg.way is not None and leg.waypoint.motion is motion:
            found = True
            off[phase.start : end, 0] = leg.way.distances(positions[phase.start : end])
    return off if found else None
