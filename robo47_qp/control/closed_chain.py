"""ClosedChain: what tools that hold one body may do about disturbances."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.model.arm import Arm

_INNER = 0.95
"""Share that is compensated of a disturbance by which tools press and pull at each other: all of it
would let their force grow as long as their places do not fit to the micrometre."""


@dataclass(frozen=True, eq=False)
class ClosedChain:
    """Splits accelerations of the joints into motion of a body that tools hold, and the rest.

    Tools that hold one rigid body move with A v = 0, and press and pull at each other with torques
    Aᵀ λ. Of a disturbance d, a motion of the body sees only the part

        P d,   P = 1 - M⁻¹ Aᵀ (A M⁻¹ Aᵀ)⁻¹ A

    and P M⁻¹ Aᵀ = 0: the force between the tools is no part of it (dynamically consistent
    projection: Khatib, IEEE J. Robotics and Automation 3(1), 1987). So that part can be
    compensated as if the tools were free; the rest only with springs left that give way.
    """

    along: Matrix
    """P (n, n)."""
    shares: Matrix
    """P and the share of the rest that is compensated (n, n)."""

    @classmethod
    def of(cls, arm: Arm, tools: Sequence[int], q: Vector) -> Self:
        """Return that of tools, by their places in `Robot.tools`, at q (n,) [rad]."""
        first, *others = (arm.pose(q, i).adjoint() @ arm.jacobian(q, i) for i in tools)
        A = np.vstack([first - J for J in others])
        gain = np.linalg.solve(arm.mass_matrix(q), A.T)
        rest = gain @ np.linalg.solve(A @ gain, A)
        one = np.eye(arm.n)
        return cls(along=one - rest, shares=one - (1.0 - _INNER) * rest)
