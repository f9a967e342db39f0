"""The audit: what was promised against what the simulated robot did."""

import numpy as np

from robo47_qp.arrays import Matrix
from robo47_qp.constants import TIMESTEP
from robo47_qp.model.arm import Arm
from robo47_qp.report.audit.contact import clearances, contacts
from robo47_qp.report.audit.finding import Finding, bounded, within
from robo47_qp.report.audit.tool import tool_paths, tool_rates
from robo47_qp.run.scenario import Run


def audit(run: Run) -> list[Finding]:
    """Check a run against the limits of its scenario, from its recorded signals alone."""
    arm = Arm(run.scenario.robot)
    return [
        *_joints(run, arm),
        *tool_paths(run),
        *tool_rates(run, arm),
        *clearances(run),
        *contacts(run),
    ]


def _joints(run: Run, arm: Arm) -> list[Finding]:
    scenario, rows = run.scenario, run.rows
    robot, joints = scenario.robot, scenario.robot.joints
    profile = scenario.planner.profile.slowed(scenario.planner.pace)
    a_ref = rows["joints/a_ref"]
    v_ref, j_ref = _promised(run, rows["joints/v_ref"], _rate(a_ref))
    a, tau = _while_in_touch(run)
    unit = robot.units
    efforts = ["N" if u == "m" else "N·m" for u in unit]
    per_s, per_s2, per_s3, rate = (
        [u + per for u in units]
        for units, per in ((unit, "/s"), (unit, "/s²"), (unit, "/s³"), (efforts, "/s"))
    )
    return [
        *within("reference q", unit, joints, rows["joints/q_ref"], arm.q_min, arm.q_max),
        bounded("reference v", per_s, joints, v_ref, profile.v_max),
        bounded("reference a", per_s2, joints, a_ref, profile.a_max),
        bounded("reference jerk", per_s3, joints, j_ref, profile.j_max),
        *within("measured q", unit, joints, rows["joints/q"], arm.q_min, arm.q_max),
        bounded("measured v", per_s, joints, rows["joints/v"], robot.rated.v_max),
        bounded("measured a", per_s2, joints, a, robot.rated.a_max),
        bounded("torque", efforts, joints, tau, robot.tau_max),
        bounded("torque rate", rate, joints, _rate(tau), robot.tau_rate_max),
    ]


def _promised(run: Run, v_ref: Matrix, j_ref: Matrix) -> tuple[Matrix, Matrix]:
    """Velocity and jerk of the reference without what nothing was promised of, which is 0.

    The jerk of a streamed reference is not bounded; one that yields to forces, too, is the state
    of the arm itself.
    """
    v_ref, j_ref = v_ref.copy(), j_ref.copy()
    ends = [phase.start for phase in run.phases[1:]] + [len(v_ref)]
    for phase, end in zip(run.phases, ends, strict=True):
        if phase.streamed:
            # The period before it ends with its first acceleration.
            j_ref[max(0, phase.start - 1) : end] = 0.0
            if phase.compliant:
                v_ref[phase.start : end] = 0.0
    return v_ref, j_ref


def _while_in_touch(run: Run) -> tuple[Matrix, Matrix]:
    """Measured acceleration and torque, of which less is promised while the tool yields.

    What an edge does to the arm as it is met is up to the edge: no acceleration is promised then,
    and of the torque only what the motors deliver, not what is asked of them.
    """
    rows = run.rows
    a, tau = rows["joints/a"].copy(), rows["joints/tau_command"].copy()
    ends = [phase.start for phase in run.phases[1:]] + [len(a)]
    for phase, end in zip(run.phases, ends, strict=True):
        if phase.compliant:
            a[phase.start : end] = 0.0
            tau[phase.start : end] = rows["joints/tau"][phase.start : end]
    return a, tau


def _rate(values: Matrix) -> Matrix:
    return np.diff(values, axis=0) / TIMESTEP
