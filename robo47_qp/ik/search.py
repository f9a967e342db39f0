"""One search from one start, and a second one where the first ends too close to something."""

from dataclasses import replace
from functools import lru_cache
from time import process_time
from typing import NamedTuple

from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.collision.clearance import clearance_of
from robo47_qp.ik.avoidance import Avoidance
from robo47_qp.ik.descent import Descent
from robo47_qp.ik.settings import Stall
from robo47_qp.ik.solver import (
    IkResult,
    Reason,
    Tolerance,
    Unconverged,
    judged,
)
from robo47_qp.model.arm import Arm

_SPARE = 1e-5
"""What the rows keep beyond the clearance that is asked for, for what they do not see: the
curvature of the last steps [m]."""
_DETECTION = 0.05
"""How much further away a pair gets a row [m]."""


class SearchLimits(NamedTuple):
    """When a search ends, and how far from everything."""

    tolerance: Tolerance
    max_iterations: int
    stall: Stall | None
    clearance: float | None


def searched(
    arm: Arm, descent: Descent, T_world_target: SE3, limits: SearchLimits, q_seed: Vector
) -> IkResult:
    """The judged end of a search from q_seed."""
    started = process_time()
    end = attempted(arm, descent, T_world_target, limits, q_seed)
    if isinstance(end, Unconverged):
        end = judged(arm, T_world_target, end.q, limits.tolerance, end.iterations)
    seconds = process_time() - started
    return end.with_effort(iterations=end.iterations, restarts=0, seconds=seconds)


def attempted(
    arm: Arm, descent: Descent, T_world_target: SE3, limits: SearchLimits, q_seed: Vector
) -> IkResult | Unconverged:
    """The end of a search from q_seed, judged unless it missed.

    The way to an answer is not driven, so nothing has to stay clear on it: the first search
    looks at the tool alone. Where its answer is closer than `clearance` to anything, a second
    one from the same start has every step keep the distance, or regain it.
    """
    tolerance, count, stall, clearance = limits
    iterations = descent.run(T_world_target, q_seed, tolerance, count, stall)
    if descent.missed and arm.beyond_reach(T_world_target.wxyz_xyz[4:]) <= 0.0:
        return Unconverged(descent.q.copy(), iterations, descent.error)
    free = judged(arm, T_world_target, descent.q, tolerance, iterations, None, clearance)
    if clearance is None or free.reason is not Reason.COLLISION or free.inevitable:
        return free
    avoidance = _avoidance(arm, clearance)
    iterations += descent.run(T_world_target, q_seed, tolerance, count, stall, avoidance)
    kept = judged(arm, T_world_target, descent.q, tolerance, iterations, None, clearance)
    # A pose that is reached too close to something tells more than one that is not reached.
    if kept.reason is Reason.NOT_CONVERGED:
        return replace(free, iterations=iterations)
    return kept


@lru_cache(maxsize=16)
def _avoidance(arm: Arm, clearance: float) -> Avoidance:
    d_min = clearance + _SPARE
    return Avoidance(clearance_of(arm, clearance), d_min=d_min, detection=d_min + _DETECTION)
