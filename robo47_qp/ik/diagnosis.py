"""Why no start reached a pose, found by dropping one constraint at a time."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from robo47_qp.arrays import Vector
from robo47_qp.ik.gauss_newton import Stall
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.solver import (
    IkResult,
    ReachEvidence,
    Reason,
    Tolerance,
    joints_outside,
    outside_limits,
    residual,
)
from robo47_qp.model.arm import Arm
from robo47_qp.model.tool_poses import Target

_STEPS = 50
"""Largest number of QPs per start of a diagnosis."""
_CALM = 3.0
"""λ per squared error where the target is not reached: the closest configuration is stretched or at
joint limits, where long steps overshoot."""


def diagnosed(
    arm: Arm, T_world_target: Target, best: IkResult, starts: Sequence[Vector], tolerance: Tolerance
) -> IkResult:
    """Return the best result of a failed search, with the reason found by dropping constraints.

    If the pose is reached without the joint limits, they are the reason, and the joints that would
    have to leave them are named. If the position is not reached even without the orientation, it is
    out of reach by the distance left. Otherwise the search did not converge, or no configuration
    reaches the position with this orientation: the remaining error is reported.

    Args:
        arm: The arm.
        T_world_target: The pose that was not reached.
        best: The closest result of the search.
        starts: Where to search from, each (n,) [rad].
        tolerance: How close counts as reached.
    """
    near = best.position_error <= tolerance.position
    posed = near and best.orientation_error <= tolerance.orientation
    if best.reason is not Reason.NOT_CONVERGED or posed:
        # Where the pose is reached, something else that was asked for is missing.
        return best
    remains = residual(best.position_error, best.orientation_error, best.iterations)
    remains = f"{remains} from {best.restarts + 1} starts"
    turned = _without_limits(arm, T_world_target, starts, tolerance)
    if turned is not None:
        outside = joints_outside(arm, turned)
        if not outside:
            return replace(best, explanation=f"the pose is within reach, but {remains}")
        return replace(
            best,
            reason=Reason.JOINT_LIMITS,
            joints=outside,
            explanation=(
                "no start reaches the pose inside the joint limits; beyond them it is reached "
                f"where {outside_limits(arm, turned)}"
            ),
        )
    if not tolerance.demand.position:
        return replace(best, explanation=f"no start points there: {remains}")
    left = _left_without_orientation(arm, T_world_target, starts, tolerance)
    if left > tolerance.position:
        return replace(
            best,
            reason=Reason.OUT_OF_REACH,
            beyond_reach=left,
            bound=ReachEvidence.SEARCH,
            explanation=(
                f"the tool comes no closer than {left:.4f} m to the position, "
                "without regard to its orientation"
            ),
        )
    return replace(
        best, explanation=f"the position is reached, but not with this orientation: {remains}"
    )


def _without_limits(
    arm: Arm, T_world_target: Target, starts: Sequence[Vector], tolerance: Tolerance
) -> Vector | None:
    """Return the configuration found that reaches the pose and violates the limits least."""
    free = LmIk(within_limits=False, max_iterations=_STEPS, stall=Stall(), tolerance=tolerance)
    best, least = None, np.inf
    for q_start in starts:
        result = free.solve(arm, T_world_target, q_start)
        if result.reason in (None, Reason.JOINT_LIMITS):
            q = _unwound(arm, result.q)
            outside = float(np.maximum(np.maximum(arm.q_min - q, q - arm.q_max), 0.0).sum())
            if outside < least:
                best, least = q, outside
    return best


def _unwound(arm: Arm, q: Vector) -> Vector:
    """Return the same pose with each hinge turned by whole turns to be closest to its range."""
    middle = 0.5 * (arm.q_low + arm.q_high)
    turns = np.round((q - middle) / (2.0 * np.pi)) * arm.hinges
    unwound: Vector = q - 2.0 * np.pi * turns
    return unwound


def _left_without_orientation(
    arm: Arm, T_world_target: Target, starts: Sequence[Vector], tolerance: Tolerance
) -> float:
    """Return the least position error found within the joint limits [m]."""
    # The error need not vanish: only where it hardly falls at all is the least one found.
    stall = Stall(fall=1e-3)
    loose = LmIk(
        position_only=True, max_iterations=_STEPS, damping=_CALM, stall=stall, tolerance=tolerance
    )
    left = np.inf
    for q_start in starts:
        left = min(left, loose.solve(arm, T_world_target, q_start).position_error)
        if left <= tolerance.position:
            break
    return left
