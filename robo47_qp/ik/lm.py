"""Levenberg-Marquardt inside the joint limits: the fast path."""

from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from mink import SE3

from robo47_qp.arrays import Checked, CountOrZero, Matrix, NotNegative, Vector
from robo47_qp.ik.box_qp import box_qp
from robo47_qp.ik.descent import Descent
from robo47_qp.ik.search import SearchLimits, attempted, searched
from robo47_qp.ik.settings import LATE_STALL, THOROUGH_STEPS, Stall
from robo47_qp.ik.solver import (
    Attempt,
    IkResult,
    Tolerance,
    is_pose,
    rejected,
)
from robo47_qp.ik.tool_error import ToolError
from robo47_qp.model.arm import Arm

_FLOOR = 1e-9
"""Least damping, for the directions in which a redundant arm moves without its tool."""


@dataclass(frozen=True, kw_only=True)
class LmIk(Checked):
    """Levenberg-Marquardt steps on the tool pose, each a QP inside the joint limits.

    min over dq of ½ ‖J dq - e‖² + ½ λ ‖dq‖² subject to q_min <= q + dq <= q_max,
    with e the displacement and the rotation vector to the target, J the Jacobian of the
    tool and λ = `damping` ‖e‖² (the damping that falls with the squared error: Sugihara,
    "Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method", 2011;
    Yamashita and Fukushima, 2001, for the rate). It is QpIk without its posture, and with
    the rotation vector in place of the logarithm of the pose: the same minima, fewer
    operations.
    """

    position_only: bool = False
    """Ask for the tool's position alone."""
    within_limits: bool = True
    """Keep to the joint limits; without them, each step is the textbook's."""
    max_iterations: CountOrZero = 100
    """QPs before giving up."""
    damping: NotNegative = 0.03
    """λ per squared error."""
    stall: Stall | None = None
    """When a start is given up early; never by default."""
    clearance: NotNegative | None = None
    """Distance to be kept by the arm from itself and from its obstacles [m]; None lets it go
    through them."""
    tolerance: Tolerance = Tolerance()

    def solve(self, arm: Arm, T_world_target: SE3, q_seed: Vector) -> IkResult:
        """See `IkSolver.solve`."""
        q = arm.checked_q("q_seed", q_seed)
        if not is_pose(T_world_target):
            return rejected(arm, q)
        return searched(arm, self._descent(arm), T_world_target, self._limits(), q)

    def attempts(self, arm: Arm, T_world_target: SE3) -> Attempt:
        """See `attempt.MakeAttempts`."""
        return partial(attempted, arm, self._descent(arm), T_world_target, self._limits())

    def _descent(self, arm: Arm) -> Descent:
        rows = 3 if self.position_only else 6
        return _descent(arm, self.damping, rows, self.within_limits)

    def _limits(self) -> SearchLimits:
        tolerance = self.tolerance
        if self.position_only:
            tolerance = Tolerance(position=tolerance.position, orientation=np.inf)
        return SearchLimits(tolerance, self.max_iterations, self.stall, self.clearance)

    def thorough(self) -> "LmIk":
        """See `EarlyStopping.thorough`."""
        steps = max(self.max_iterations, THOROUGH_STEPS)
        return replace(self, stall=LATE_STALL, max_iterations=steps)


class _Damped:
    """½ ‖J dq - e‖² + ½ λ ‖dq‖²."""

    def __init__(self, n: int, damping: float, rows: int) -> None:
        self._damping, self._rows = damping, rows
        self._H, self._f = np.empty((n, n)), np.empty(n)
        self._diagonal = self._H.reshape(-1)[:: n + 1]

    def expand(
        self, error: ToolError, squared_error: float, q: Vector, q_seed: Vector
    ) -> tuple[Matrix, Vector]:
        J, e, H, f = error.J, error.e, self._H, self._f
        if self._rows < 6:
            J, e = J[: self._rows], e[: self._rows]
        J.T.dot(J, H)
        self._diagonal += self._damping * squared_error + _FLOOR
        e.dot(J, f)
        np.negative(f, f)
        return H, f


@lru_cache(maxsize=16)
def _descent(arm: Arm, damping: float, rows: int, limited: bool) -> Descent:
    objective = _Damped(arm.n, damping, rows)
    return Descent(arm, objective, box_qp("daqp", arm.n), limited=limited, rows=rows)
