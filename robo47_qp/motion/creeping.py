"""Creeping: along a tool path in steps as small as the joints need to keep their branch."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from mink import SE3

from robo47_qp.arm import Arm
from robo47_qp.arrays import Vector
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.solver import Hasty, IkResult, IkSolver

STRIDE = 0.1
"""Change of a joint in one step that counts as continuous [rad or m]."""
_FIRST = 1.0 / 8.0
_SMALLEST = 2.0**-10
"""Steps, as parts of the way: of a centimetre about 10 µm, in which a joint that has to move
by more than `STRIDE` would be a thousand times too fast."""


class Creep(NamedTuple):
    """How far a path was followed."""

    q: Vector
    """The last configuration on it."""
    at: float
    """Where that is, 1 at the end."""
    stuck: SE3 | None
    """The pose next to it that is not reached from there; None where the end was reached."""
    results: list[IkResult]
    """Of IK on the way."""


def one_start(ik: IkSolver) -> IkSolver:
    """A solver that does not look elsewhere, where it finds another branch, nor gives up early."""
    alone = ik.solver if isinstance(ik, MultiStart) else ik
    return alone.patient() if isinstance(alone, Hasty) else alone


def creep(arm: Arm, ik: IkSolver, q: Vector, at: Callable[[float], SE3]) -> Creep:
    """Follow a short path; a step in which a joint jumps or IK fails is halved.

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
        if result.converged and np.abs(result.q - q).max() <= STRIDE:
            q, x, step = result.q, x + step, 2.0 * step
        elif step <= _SMALLEST:
            return Creep(q, x, target, results)
        else:
            step *= 0.5
    return Creep(q, 1.0, None, results)
