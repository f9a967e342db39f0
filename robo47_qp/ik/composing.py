"""What a solver asks for at a configuration, for those that follow paths with it."""

from dataclasses import replace

import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.ik.mink import MinkIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.solver import Composing, IkSolver
from robo47_qp.model.arm import Arm
from robo47_qp.model.tool_poses import Target


def start_of(ik: IkSolver, arm: Arm, q_start: Vector, q_seed: Vector) -> Vector:
    """Return q_start with the joints that a solver holds where they are at q_seed (n,) [rad]."""
    inner = ik.solver if isinstance(ik, MultiStart) else ik
    return inner.start(arm, q_start, q_seed) if isinstance(inner, Composing) else q_start


def composes(ik: IkSolver) -> bool:
    """Return whether a solver asks for more than the pose of the tool."""
    inner = ik.solver if isinstance(ik, MultiStart) else ik
    if not isinstance(inner, MinkIk):
        return False
    return bool(inner.objectives or inner.limits or inner.constraints or inner.frozen)


def without_lasting(ik: IkSolver) -> IkSolver | None:
    """Return a solver without the objectives that only have to be at their best; None if none."""
    if not isinstance(ik, MinkIk):
        return None
    kept = [one for one in ik.asked if one.tolerance is not None or one.priority == 0]
    return None if len(kept) == len(ik.objectives) else replace(ik, objectives=kept)


def exact_rows(ik: IkSolver, arm: Arm, target: Target, q: Vector) -> tuple[Vector, Matrix]:
    """Return errors (k,) and their fall per joint (k, n): of the demand, and of what is exact.

    Constraints and frozen joints stand below the demand; rows of what is free are zero.
    """
    demand = ik.tolerance.demand
    e, J = demand.error(arm, target, q), demand.jacobian(arm, target, q)
    inner = ik.solver if isinstance(ik, MultiStart) else ik
    if isinstance(inner, MinkIk) and (inner.constraints or inner.frozen):
        more, slope = inner.exact(arm, q)
        return np.concatenate([e, more]), np.vstack([J, slope])
    return e, J


def deviation(ik: IkSolver, arm: Arm, target: Target, q: Vector) -> float:
    """Return the largest error of what is exact: of the demand, and of constraints [m or rad]."""
    off = max(ik.tolerance.demand.distance(arm, target, q))
    inner = ik.solver if isinstance(ik, MultiStart) else ik
    if isinstance(inner, MinkIk) and inner.constraints:
        off = max(off, float(np.abs(inner.exact(arm, q)[0]).max(initial=0.0)))
    return off
