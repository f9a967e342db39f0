"""The audit: what was promised against what the simulated robot did."""

import numpy as np

from robo47_qp.arm import Arm
from robo47_qp.arrays import Matrix
from robo47_qp.audit_contact import clearances, contacts
from robo47_qp.audit_tool import tool_paths, tool_rates
from robo47_qp.finding import Finding, bounded, within
from robo47_qp.run import Run
from robo47_qp.scene import TIMESTEP


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
    profile = scenario.planner.profile.slowed(scenario.planner.speed)
    tau, a_ref = rows["joints/tau_command"], rows["joints/a_ref"]
    unit = robot.units
    efforts = ["N" if u == "m" else "N·m" for u in unit]
    v, a, jerk, rate = (
        [u + per for u in units]
        for units, per in ((unit, "/s"), (unit, "/s²"), (unit, "/s³"), (efforts, "/s"))
    )
    return [
        *within("reference q", unit, joints, rows["joints/q_ref"], arm.q_min, arm.q_max),
        bounded("reference v", v, joints, rows["joints/v_ref"], profile.v_max),
        bounded("reference a", a, joints, a_ref, profile.a_max),
        bounded("reference jerk", jerk, joints, _rate(a_ref), profile.j_max),
        *within("measured q", unit, joints, rows["joints/q"], arm.q_min, arm.q_max),
        bounded("measured v", v, joints, rows["joints/v"], robot.rated.v_max),
        bounded("measured a", a, joints, rows["joints/a"], robot.rated.a_max),
        bounded("torque", efforts, joints, tau, robot.tau_max),
        bounded("torque rate", rate, joints, _rate(tau), robot.tau_rate_max),
    ]


def _rate(values: Matrix) -> Matrix:
    return np.diff(values, axis=0) / TIMESTEP
