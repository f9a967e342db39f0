"""Audit of the joints: their ranges and bounds, and that the reference continues itself."""

import numpy as np
from numpy.typing import NDArray

from robo47_qp.arrays import Matrix
from robo47_qp.constants import TIMESTEP
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import MotionProfile
from robo47_qp.report.audit.finding import Exempt, Finding, bounded, judged, within
from robo47_qp.run.scenario import Run

RETAKEN = 0.02
"""Distance from a joint to where its reference is taken anew at most [rad, m]: what it moves in
5 ms, of delay, at the speeds that it is rated for, and noise."""
_STREAMED = "the reference follows a moving target, or a force"
_ANEW = "the reference is taken anew from the arm, which contact or torques have moved"


def joint_bounds(run: Run, arm: Arm) -> list[Finding]:
    """Check reference and state of the joints against their ranges and bounds."""
    rows, robot, joints = run.rows, run.scenario.robot, run.scenario.robot.joints
    profile = _profile(run)
    a_ref = rows["joints/a_ref"]
    v_ref, j_ref = rows["joints/v_ref"], _rate(a_ref)
    a, tau = rows["joints/a"], rows["joints/tau_command"]
    unit = robot.units
    efforts = ["N" if u == "m" else "N·m" for u in unit]
    per_s, per_s2, per_s3, rate = (
        [u + per for u in units]
        for units, per in ((unit, "/s"), (unit, "/s²"), (unit, "/s³"), (efforts, "/s"))
    )
    own, streamed = Exempt(_anew(run), _ANEW), Exempt(_streamed(run), _STREAMED)
    return [
        *within("reference q", unit, joints, rows["joints/q_ref"], arm.q_min, arm.q_max),
        *judged("reference v", per_s, joints, v_ref, profile.v_max, own),
        bounded("reference a", per_s2, joints, a_ref, profile.a_max),
        *judged("reference jerk", per_s3, joints, j_ref, profile.j_max, streamed),
        *within("measured q", unit, joints, rows["joints/q"], arm.q_min, arm.q_max),
        bounded("measured v", per_s, joints, rows["joints/v"], robot.rated.v_max),
        bounded("measured a", per_s2, joints, a, robot.rated.a_max),
        bounded("torque", efforts, joints, tau, robot.tau_max),
        bounded("torque rate", rate, joints, _rate(tau), robot.tau_rate_max),
    ]


def reference_continuity(run: Run) -> list[Finding]:
    """Check that q, v and a of the reference are those of one motion.

    In a period, v may leave the mean of v by half of what the largest acceleration changes it by,
    and dv/dt what lies between a before and after by what the largest jerk changes a by. Where the
    reference is taken anew, it must be where the joints are.
    """
    rows, joints, unit = run.rows, run.scenario.robot.joints, run.scenario.robot.units
    q, v, a = (rows[f"joints/{name}_ref"] for name in "qva")
    if len(q) < 2:
        return []
    profile, anew = _profile(run), _anew(run)
    drift = _rate(q) - 0.5 * (v[1:] + v[:-1])
    slope = _rate(v)
    beyond = slope - np.clip(slope, np.minimum(a[1:], a[:-1]), np.maximum(a[1:], a[:-1]))
    steps = Exempt(anew[1:], _ANEW)
    found = []
    for signal, per, values, bound in (
        ("reference q to v", "/s", drift, 0.5 * profile.a_max * TIMESTEP),
        ("reference v to a", "/s²", beyond, profile.j_max * TIMESTEP),
    ):
        found += judged(signal, [u + per for u in unit], joints, values, bound, steps)
    if anew.any():
        off = q - rows["joints/q"]
        bound = np.full(len(joints), RETAKEN)
        found += judged("retaken q", unit, joints, off, bound, Exempt(~anew, "", anew))
    return found


def _profile(run: Run) -> MotionProfile:
    planner = run.scenario.planner
    return planner.profile.slowed(planner.pace)


def _anew(run: Run) -> NDArray[np.bool_]:
    """Return in which rows the reference is the state of the arm (N,)."""
    anew = np.zeros(len(run.rows), bool)
    anew[[row for row in run.retaken if 0 < row < len(anew)]] = True
    return anew


def _streamed(run: Run) -> NDArray[np.bool_]:
    """Return in which periods the jerk of the reference is not bounded (N - 1,)."""
    jerk = np.zeros(len(run.rows) - 1, bool)
    for phase, rows in run.spans():
        if phase.streamed:
            # The period before it ends with its first acceleration.
            jerk[max(0, rows.start - 1) : rows.stop] = True
    return jerk


def _rate(values: Matrix) -> Matrix:
    return np.diff(values, axis=0) / TIMESTEP
