"""Audit of contacts: forces on the tool and the links, distances from obstacles."""

from math import isfinite

import numpy as np

from robo47_qp.arrays import Matrix
from robo47_qp.collision.closest_approach import ClosestApproach
from robo47_qp.constants import TIMESTEP
from robo47_qp.report.audit.finding import Finding, at_most
from robo47_qp.run.scenario import Run


def contacts(run: Run) -> list[Finding]:
    """Contact forces: on the tool no more than the task allows, on the links none."""
    limit = run.scenario.task.force_max
    links = at_most("link contact", "N", run.rows["contact/links"][:, 0], 0.0)
    if not isfinite(limit):
        return [links]
    force = np.linalg.norm(run.rows["contact/tool"], axis=1)
    return [at_most("tool contact", "N", force, limit), links]


def clearances(run: Run) -> list[Finding]:
    """Distances of the robot from the task's obstacles; none where there are none.

    The reference is held to the clearance that the planner was to keep, if it was to keep one;
    the robot itself must not touch. What the gripper holds is not looked at.
    """
    scenario, rows = run.scenario, run.rows
    robot, obstacles = scenario.robot, tuple(scenario.task.obstacles)
    if not obstacles:
        return []
    closest = ClosestApproach(robot, obstacles)
    fingers = [] if robot.gripper is None else [rows["gripper/fingers"]]
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
