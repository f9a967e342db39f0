"""Audit: the limits of a scenario against what the simulated robot did."""

from math import isfinite

import numpy as np
from numpy.typing import NDArray

from robo47_qp.arrays import Matrix
from robo47_qp.collision.closest_approach import ClosestApproach
from robo47_qp.constants import TIMESTEP
from robo47_qp.model.arm import Arm
from robo47_qp.report.audit.finding import Exempt, Finding, at_most, bounded, judged, within
from robo47_qp.report.audit.tool import held_together, tool_paths, tool_rates
from robo47_qp.run.scenario import Run

_OWN = "the reference is the state of the arm itself, which torques move"
_STREAMED = "the reference follows a moving target"


def audit(run: Run) -> list[Finding]:
    """Check a run against the limits of its scenario, using its recorded signals alone.

    Every row of every signal is in a finding with its true values. Rows in which something is not
    promised are in a finding of their own, which says why and for how long.
    """
    arm = Arm(run.scenario.robot)
    return [
        *_joints(run, arm),
        *tool_paths(run),
        *tool_rates(run, arm),
        *held_together(run),
        *_clearances(run),
        *_contacts(run),
    ]


def _joints(run: Run, arm: Arm) -> list[Finding]:
    scenario, rows = run.scenario, run.rows
    robot, joints = scenario.robot, scenario.robot.joints
    profile = scenario.planner.profile.slowed(scenario.planner.pace)
    a_ref = rows["joints/a_ref"]
    v_ref, j_ref = rows["joints/v_ref"], _rate(a_ref)
    v_free, j_free = _exempt(run)
    a, tau = rows["joints/a"], rows["joints/tau_command"]
    unit = robot.units
    efforts = ["N" if u == "m" else "N·m" for u in unit]
    per_s, per_s2, per_s3, rate = (
        [u + per for u in units]
        for units, per in ((unit, "/s"), (unit, "/s²"), (unit, "/s³"), (efforts, "/s"))
    )
    return [
        *within("reference q", unit, joints, rows["joints/q_ref"], arm.q_min, arm.q_max),
        *judged("reference v", per_s, joints, v_ref, profile.v_max, Exempt(v_free, _OWN)),
        bounded("reference a", per_s2, joints, a_ref, profile.a_max),
        *judged("reference jerk", per_s3, joints, j_ref, profile.j_max, Exempt(j_free, _STREAMED)),
        *within("measured q", unit, joints, rows["joints/q"], arm.q_min, arm.q_max),
        bounded("measured v", per_s, joints, rows["joints/v"], robot.rated.v_max),
        bounded("measured a", per_s2, joints, a, robot.rated.a_max),
        bounded("torque", efforts, joints, tau, robot.tau_max),
        bounded("torque rate", rate, joints, _rate(tau), robot.tau_rate_max),
    ]


def _exempt(run: Run) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return in which rows velocity (N,) and jerk (N - 1,) of the reference are not bounded."""
    velocity, jerk = np.zeros(len(run.rows), bool), np.zeros(len(run.rows) - 1, bool)
    for phase, rows in run.spans():
        if phase.streamed:
            # The period before it ends with its first acceleration.
            jerk[max(0, rows.start - 1) : rows.stop] = True
            velocity[rows] = phase.compliant
    return velocity, jerk


def _rate(values: Matrix) -> Matrix:
    return np.diff(values, axis=0) / TIMESTEP


def _contacts(run: Run) -> list[Finding]:
    """Check contact forces: on the tool those that the task allows, on the links none."""
    limit = run.scenario.task.force_max
    links = at_most("link contact", "N", run.rows["contact/links"][:, 0], 0.0)
    if not isfinite(limit):
        return [links]
    found = []
    for label, tool in run.scenario.robot.tool_labels():
        force = np.linalg.norm(run.rows[f"contact/{label}tool"], axis=1)
        name = f"{tool.name} contact" if label else "tool contact"
        found.append(at_most(name, "N", force, limit))
    return [*found, links]


def _clearances(run: Run) -> list[Finding]:
    """Check the distances of the robot from the task's obstacles, if there are any.

    The reference must keep the clearance of the planner; the robot itself must not touch. What
    the gripper holds is not checked.
    """
    scenario, rows = run.scenario, run.rows
    robot, obstacles = scenario.robot, tuple(scenario.task.obstacles)
    if not obstacles:
        return []
    closest = ClosestApproach(robot, obstacles)
    labels = [label for label, tool in robot.tool_labels() if tool.gripper is not None]
    fingers = [rows[f"gripper/{label}fingers"] for label in labels]
    found = []
    collisions = scenario.planner.collisions
    if collisions is not None:
        reference = np.hstack([rows["joints/q_ref"], *fingers])
        found.append(_apart("reference clearance", closest, reference, collisions.clearance))
    measured = np.hstack([rows["joints/q"], *fingers])
    found.append(_apart("measured clearance", closest, measured, 0.0))
    return found


def _apart(signal: str, closest: ClosestApproach, q: Matrix, limit: float) -> Finding:
    nearest = closest.along(q)
    return Finding(
        signal=f"{signal} ({nearest.body} to {nearest.obstacle})",
        unit="m",
        limit=limit,
        extreme=nearest.distance,
        time=nearest.row * TIMESTEP,
        ok=nearest.distance >= limit,
    )
