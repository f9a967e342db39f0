"""Small steps along a tool path where IK fails or a joint jumps, and reasons for a failure."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import RefusalReason
from robo47_qp.ik.composing import composes
from robo47_qp.ik.gauss_newton import Stall
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.solver import EarlyStopping, IkResult, IkSolver, Tolerance, joints_outside
from robo47_qp.ik.tool_demand import FULL, ToolDemand
from robo47_qp.model.arm import Arm
from robo47_qp.model.tool_poses import Target
from robo47_qp.motion.refusals import AT_LIMIT

STRIDE = 0.1
"""Largest change of a joint in one step that counts as continuous [rad or m]."""
_FIRST = 1.0 / 8.0
_SMALLEST = 2.0**-10
"""First and smallest step, as shares of the path: about 10 µm of a centimetre, in which a joint
that moves by more than `STRIDE` would be a thousand times too fast."""
_STARTS, _SEED = 4, 3
"""Number of further starts of the slow search, and their random seed."""
_EXACT = 1e-12
"""Tolerance of steps and gradients at which the slow search ends."""
_STAGNANT = 1e-4
"""Relative gain of a step at which it ends: near a pose that is reached, every step gains more."""
_EVALUATIONS = 60

_ASKED = Tolerance()


class SmallSteps(NamedTuple):
    """How far a path was followed."""

    q: Vector
    """The last configuration on it."""
    at: float
    """Where that is, 1 at the end."""
    stuck: Target | None
    """The pose next to it that is not reached from there; None where the end was reached."""
    results: list[IkResult]
    """IK results on the path."""


def single_start(ik: IkSolver) -> IkSolver:
    """Return a solver that searches from one start only, and does not give up early."""
    alone = ik.solver if isinstance(ik, MultiStart) else ik
    return alone.thorough() if isinstance(alone, EarlyStopping) else alone


def follow_in_small_steps(
    arm: Arm, ik: IkSolver, q: Vector, at: Callable[[float], Target]
) -> SmallSteps:
    """Follow a short path; where IK fails or a joint jumps, by a slower search or smaller steps.

    Args:
        arm: The arm.
        ik: Solves for the poses, from one start each.
        q: Where the path starts (n,) [rad].
        at: T_world_tcp over [0, 1]; at 0 that of q.
    """
    x, step, results = 0.0, _FIRST, list[IkResult]()
    while x < 1.0:
        step = min(step, 1.0 - x)
        target = at(x + step)
        result = ik.solve(arm, target, q)
        results.append(result)
        found: Vector | None = result.q
        if not (result.converged and np.abs(result.q - q).max() <= STRIDE):
            # No path is refused because one solver failed, where the pose is all that is asked.
            starts = _STARTS if step <= _SMALLEST else 0
            found = None
            if not composes(ik):
                found = solve_nearby(arm, target, q, ik.tolerance, starts=starts)
        if found is not None:
            q, x, step = found, x + step, 2.0 * step
        elif step <= _SMALLEST:
            return SmallSteps(q, x, target, results)
        else:
            step *= 0.5
    return SmallSteps(q, 1.0, None, results)


def solve_nearby(
    arm: Arm,
    T_world_target: Target,
    q: Vector,
    tolerance: Tolerance,
    *,
    limits: bool = True,
    starts: int = _STARTS,
) -> Vector | None:
    """Return a configuration within `STRIDE` of q that reaches a pose (n,) [rad].

    scipy's bounded least squares (dogbox: Voglis and Lagaris, 2004), from q and from a few
    places around it, always the same ones; None where all of them end elsewhere.

    Args:
        arm: The arm.
        T_world_target: The pose.
        q: Where to search (n,) [rad].
        tolerance: How close counts as reached.
        limits: Whether to stay inside the joint limits.
        starts: Places around q to search from, too.
    """
    low, high = q - STRIDE, q + STRIDE
    if limits:
        low, high = np.maximum(arm.q_min, low), np.minimum(arm.q_max, high)
    if (low >= high).any():
        # A joint is further outside its limits than the search goes.
        return None
    around = np.random.default_rng(_SEED).uniform(low, high, (starts, arm.n))
    for start in (np.clip(q, low, high), *around):
        found = least_squares(
            lambda x: tolerance.demand.error(arm, T_world_target, x),
            start,
            jac=lambda x: -tolerance.demand.jacobian(arm, T_world_target, x),
            bounds=(low, high),
            method="dogbox",
            xtol=_EXACT,
            ftol=_STAGNANT,
            gtol=_EXACT,
            max_nfev=_EVALUATIONS,
        )
        position, angle = tolerance.demand.distance(arm, T_world_target, found.x)
        if position <= tolerance.position and angle <= tolerance.orientation:
            reached: Vector = found.x
            return reached
    return None


SINGULAR = 0.03
"""Smallest singular value of the Jacobian below which the arm counts as singular [m and rad]."""


def block_reason(
    arm: Arm, q: Vector, T_world_next: Target, asked: Tolerance = _ASKED
) -> tuple[RefusalReason, str]:
    """Return why the tool cannot move from q to a pose next to it, and the joint concerned.

    Without the joint limits the pose is reached by a small motion that leads a joint out of
    them: that limit. No configuration at all reaches it: it is out of reach. The Jacobian at q
    has next to no gain in some direction: a singularity, and the joint that moves most for it.
    Else the pose belongs to another branch, and the joint that differs most there is named.

    Args:
        arm: The arm.
        q: The last configuration on the way (n,) [rad].
        T_world_next: Where the tool should go next, one smallest step away.
        asked: How close counts, and what of the pose.
    """
    free = solve_nearby(arm, T_world_next, q, asked, limits=False)
    joints = arm.robot.joints
    if free is not None and joints_outside(arm, free):
        beyond = np.maximum(arm.q_min - free, free - arm.q_max)
        return RefusalReason.JOINT_LIMIT, joints[int(beyond.argmax())]
    patient = LmIk(max_iterations=20, stall=Stall(), tolerance=asked)
    other = MultiStart(solver=patient).solve(arm, T_world_next, q)
    moved = joints[int(np.abs(other.q - q).argmax())]
    if not other.converged:
        return RefusalReason.REACH, moved
    gain, direction = _least_gain(arm, T_world_next, q, asked.demand)
    if gain < SINGULAR:
        return RefusalReason.SINGULARITY, joints[int(np.abs(direction).argmax())]
    return RefusalReason.BRANCH, moved


def _least_gain(arm: Arm, target: Target, q: Vector, demand: ToolDemand) -> tuple[float, Vector]:
    """Return the smallest gain of the Jacobian of what is asked for, and the joints' direction."""
    J = demand.jacobian(arm, target, q)
    _, gains, directions = np.linalg.svd(J)
    last = min(len(gains), len(J) - demand.free * (len(J) // 6)) - 1
    return float(gains[last]), directions[last]


def deviation_reason(
    arm: Arm, knots: Matrix, q: Vector, target: Target, demand: ToolDemand = FULL
) -> tuple[RefusalReason, str, Vector]:
    """Return why no spline keeps to a joint path: reason, joint and configuration.

    A joint slides along its limit, or the arm is close to a singularity; else there is no
    better reason than the number of knots.

    Args:
        arm: The arm.
        knots: The joint path (N, n) [rad].
        q: Where the spline is worst (n,) [rad].
        target: The pose asked for there.
        demand: What of it.
    """
    margins = np.minimum(knots - arm.q_min, arm.q_max - knots)
    row, joint = np.unravel_index(int(margins.argmin()), margins.shape)
    if margins[row, joint] < AT_LIMIT:
        return RefusalReason.JOINT_LIMIT, arm.robot.joints[joint], knots[row]
    gain, direction = _least_gain(arm, target, q, demand)
    busiest = arm.robot.joints[int(np.abs(direction).argmax())]
    close = gain < SINGULAR
    return RefusalReason.SINGULARITY if close else RefusalReason.PRECISION, busiest, q
