"""What blocks the tool's way: found by taking limits away, and by looking elsewhere."""

import numpy as np
from mink import SE3

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import RefusalReason
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.settings import Stall
from robo47_qp.ik.solver import joints_outside
from robo47_qp.model.arm import Arm
from robo47_qp.motion.following.creeping import nearby

SINGULAR = 0.03
"""Smallest singular value of the Jacobian below which the arm counts as singular [m and rad]."""

AT_LIMIT = 1e-3
"""A joint this close to its limit is at it [rad or m]."""


def blocked(arm: Arm, q: Vector, T_world_next: SE3) -> tuple[RefusalReason, str]:
    """Why the tool does not get from q to a pose next to it, and the joint concerned.

    Without the joint limits the pose is reached by a small motion that leads a joint out of
    them: that limit. No configuration at all reaches it: it is out of reach. The Jacobian at q
    has next to no gain in some direction: a singularity, and the joint that moves most for it.
    Else the pose belongs to another branch, and the joint that differs most there is named.

    Args:
        arm: The arm.
        q: The last configuration on the way (n,) [rad].
        T_world_next: Where the tool should go next, no further than `creep` can tell.
    """
    free = nearby(arm, T_world_next, q, LmIk().tolerance, limits=False)
    joints = arm.robot.joints
    if free is not None and joints_outside(arm, free):
        beyond = np.maximum(arm.q_min - free, free - arm.q_max)
        return RefusalReason.JOINT_LIMIT, joints[int(beyond.argmax())]
    other = MultiStart(solver=LmIk(max_iterations=20, stall=Stall())).solve(arm, T_world_next, q)
    moved = joints[int(np.abs(other.q - q).argmax())]
    if not other.converged:
        return RefusalReason.REACH, moved
    _, gains, directions = np.linalg.svd(arm.jacobian(q))
    if gains[-1] < SINGULAR:
        return RefusalReason.SINGULARITY, joints[int(np.abs(directions[len(gains) - 1]).argmax())]
    return RefusalReason.BRANCH, moved


def rough(arm: Arm, knots: Matrix, q: Vector) -> tuple[RefusalReason, str, Vector]:
    """Why a joint path bends so sharply that no spline keeps to it: obstacle, joint and where.

    A joint slides along its limit, or the arm is close to a singularity; else there is no
    better reason than the number of knots.

    Args:
        arm: The arm.
        knots: The joint path (N, n) [rad].
        q: Where the spline is worst (n,) [rad].
    """
    margins = np.minimum(knots - arm.q_min, arm.q_max - knots)
    row, joint = np.unravel_index(int(margins.argmin()), margins.shape)
    if margins[row, joint] < AT_LIMIT:
        return RefusalReason.JOINT_LIMIT, arm.robot.joints[joint], knots[row]
    _, gains, directions = np.linalg.svd(arm.jacobian(q))
    busiest = arm.robot.joints[int(np.abs(directions[len(gains) - 1]).argmax())]
    close = gains[-1] < SINGULAR
    return RefusalReason.SINGULARITY if close else RefusalReason.PRECISION, busiest, q
