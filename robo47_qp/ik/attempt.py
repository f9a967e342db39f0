"""One search of many: judged where it may be an answer, and only counted where it is none."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple, TypeAlias

from mink import SE3

from robo47_qp.arm import Arm
from robo47_qp.arrays import Vector
from robo47_qp.ik.solver import IkResult, IkSolver


class Miss(NamedTuple):
    """Where a search ended that came nowhere near a target within reach; not judged."""

    q: Vector
    """Configuration (n,) [rad]."""
    iterations: int
    """Steps taken."""
    error: float
    """Distance and angle to the target together [m + rad]."""


Attempt: TypeAlias = Callable[[Vector], IkResult | Miss]
"""A search for one pose from a start (n,)."""
MakeAttempts: TypeAlias = Callable[[Arm, SE3], Attempt]
"""A solver's method `attempts`, where it has one: for an arm and a target that is a pose, what
its `solve` does from each start, but a failure need not be judged."""


def attempts_of(solver: IkSolver, arm: Arm, T_world_target: SE3) -> Attempt:
    """What a solver does from each start: its `attempts`, or `solve` where it has none."""
    attempts: MakeAttempts | None = getattr(solver, "attempts", None)
    if attempts is None:
        return partial(solver.solve, arm, T_world_target)
    return attempts(arm, T_world_target)
