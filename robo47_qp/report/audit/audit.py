"""Audit: the limits of a scenario against what the simulated robot did."""

from collections.abc import Sequence
from dataclasses import replace
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from robo47_qp.arrays import Matrix
from robo47_qp.collision.closest_approach import RESOLUTION, ClosestApproach, closest_approach
from robo47_qp.constants import TIMESTEP
from robo47_qp.model.arm import bare_arm
from robo47_qp.model.obstacle import Obstacle
from robo47_qp.report.audit.finding import Exempt, Finding, at_most
from robo47_qp.report.audit.joints import joint_bounds, reference_continuity
from robo47_qp.report.audit.objects import object_jumps
from robo47_qp.report.audit.tool import held_together, tool_paths, tool_rates
from robo47_qp.run.scenario import Run

_PLACE = 1e-9
"""Largest difference of lengths [m] and of rotation matrices [-] of the same obstacle."""
_COMPLIANT = "the arm is compliant, or stops where it has touched something"
_PRESSED = (
    "the arm is compliant, stops where it has touched something, or presses on what is fixed with "
    "the force that is judged"
)
_TOUCHES = "the hand touches what is fixed, with the force that is judged"


def audit(run: Run) -> list[Finding]:
    """Check a run against the limits of its scenario, using its recorded signals alone.

    Every row of every signal is in a finding with its true values. Rows in which something is not
    promised are in a finding of their own, which says why and for how long. A run that ended in its
    first period has no rows, so that nothing but what a policy did beyond its own is found.
    """
    if not len(run.rows):
        return _beyond(run)
    arm = bare_arm(run.scenario.robot)
    return [
        *joint_bounds(run, arm),
        *reference_continuity(run),
        *tool_paths(run),
        *tool_rates(run, arm),
        *held_together(run),
        *_clearances(run),
        *_contacts(run),
        *object_jumps(run),
        *_beyond(run),
    ]


def _beyond(run: Run) -> list[Finding]:
    """Return what a policy's process has done beyond its own: it gains nothing by that."""
    return [
        Finding(signal=f"policy {what}", unit="", limit=0.0, extreme=1.0, time=time, ok=False)
        for time, what in run.beyond
    ]


def _contacts(run: Run) -> list[Finding]:
    """Check contact forces: on the tool those that the task allows, on the links none."""
    limit, fixed_limit = run.scenario.task.force_max, run.scenario.task.fixed_force_max
    links = at_most("link contact", "N", run.rows["contact/links"][:, 0], 0.0)
    found = []
    for label, tool in run.scenario.robot.tool_labels():
        force = np.linalg.norm(run.rows[f"contact/{label}tool"], axis=1)
        which = tool.name if label else "tool"
        if isfinite(limit):
            found.append(at_most(f"{which} contact", "N", force, limit))
        touched = run.rows[f"contact/{label}fixed"][:, 0]
        found.append(at_most(f"{which} contact with what is fixed", "N", touched, fixed_limit))
    return [*found, links]


def _clearances(run: Run) -> list[Finding]:
    """Check the distances of the robot from all that stands fixed, and of its links.

    The reference must keep the clearance of the planner from the obstacles that the task declares,
    and must touch nothing; nor may the robot itself: neither table, bins and other fixed bodies
    nor its own mount, links and other arms. What the gripper holds is not checked.
    """
    scenario, rows = run.scenario, run.rows
    robot, declared = scenario.robot, tuple(scenario.task.obstacles)
    labels = [label for label, tool in robot.tool_labels() if tool.gripper is not None]
    fingers = [rows[f"gripper/{label}fingers"] for label in labels]
    reference = np.hstack([rows["joints/q_ref"], *fingers])
    measured = np.hstack([rows["joints/q"], *fingers])
    found = []
    collisions = scenario.planner.collisions
    if declared and collisions is not None:
        asked, every = collisions.clearance, np.ones(len(rows), bool)
        closest = closest_approach(robot, declared)
        found += _apart("reference clearance", closest, reference, asked, Exempt(~every, ""))
    yields, touches = np.zeros((2, len(rows)), bool)
    for phase, span in run.spans():
        yields[span] = phase.compliant
    for label, _ in robot.tool_labels():
        touches |= rows[f"contact/{label}fixed"][:, 0] > 0.0
    # What a task declares, and its own links, the robot never touches; what else stands fixed, with
    # a bounded force.
    own = closest_approach(robot, declared, own=True)
    if own.pairs:
        found += _apart("reference distance", own, reference, 0.0, Exempt(yields, _COMPLIANT))
        found += _apart("measured clearance", own, measured, 0.0, Exempt(np.zeros_like(yields), ""))
    undeclared = _undeclared(run.fixed, declared)
    if undeclared:
        scene = closest_approach(robot, undeclared, mounted=True)
        touches |= _receding(scene, measured, touches)
        pressed = Exempt(yields | touches, _PRESSED if touches.any() else _COMPLIANT)
        found += _apart("reference distance, scene", scene, reference, 0.0, pressed)
        found += _apart(
            "measured clearance, scene", scene, measured, 0.0, Exempt(touches, _TOUCHES)
        )
    return found


def _receding(scene: ClosestApproach, q: Matrix, touches: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the rows after a touch in which its depth, without force, only gets smaller (N,).

    A soft contact has none left to give while it is left faster than it expands.
    """
    found = np.zeros_like(touches)
    for last in np.flatnonzero(touches[:-1] & ~touches[1:]).tolist():
        depth, row = scene.along(q[last : last + 1]).distance, last + 1
        while row < len(q) and not touches[row]:
            before, depth = depth, scene.along(q[row : row + 1]).distance
            if not before <= depth < 0.0:
                break
            found[row] = True
            row += 1
    return found


def _undeclared(fixed: Sequence[Obstacle], declared: Sequence[Obstacle]) -> tuple[Obstacle, ...]:
    """Return what stands fixed and is not declared as it is, under names that are not taken."""
    taken, found = {obstacle.name for obstacle in declared}, []
    for one in fixed:
        if any(_same(one, other) for other in declared):
            continue
        name = one.name
        while name in taken:
            name = f"{name} of the scene"
        taken.add(name)
        found.append(replace(one, name=name))
    return tuple(found)


def _same(one: Obstacle, other: Obstacle) -> bool:
    """Return whether two obstacles are the same body at the same place."""
    return (
        (one.name, one.shape) == (other.name, other.shape)
        and np.allclose(one.size, other.size, rtol=0.0, atol=_PLACE)
        and np.allclose(
            one.T_world_obstacle.as_matrix(),
            other.T_world_obstacle.as_matrix(),
            rtol=0.0,
            atol=_PLACE,
        )
    )


def _apart(
    signal: str, closest: ClosestApproach, q: Matrix, limit: float, exempt: Exempt
) -> list[Finding]:
    """Return the closest approach in the rows that are judged, and in those that are not.

    It is exact where it decides whether the limit was kept, else to within `RESOLUTION`.
    """
    found = []
    for rows, why in ((~exempt.rows, ""), (exempt.rows, exempt.why)):
        if not rows.any():
            continue
        nearest = closest.along(q[rows])
        if not why and limit <= nearest.distance < limit + RESOLUTION:
            nearest = closest.along(q[rows], resolution=0.0)
        name = f"{signal} ({nearest.body} to {nearest.obstacle})"
        found.append(
            Finding(
                signal=f"{name}, exempt" if why else name,
                unit="m",
                limit=limit,
                extreme=nearest.distance,
                time=int(np.flatnonzero(rows)[nearest.row]) * TIMESTEP,
                ok=bool(why) or nearest.distance >= limit,
                exempt=why,
                share=float(np.mean(rows)),
                least=True,
            )
        )
    return found
