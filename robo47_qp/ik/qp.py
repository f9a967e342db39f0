"""Inverse kinematics as a constrained quadratic program: mink's problem, without its overhead."""

from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from mink import SE3
from mujoco import mju_addToScl

from robo47_qp.arrays import Checked, CountOrZero, Matrix, NotNegative, Vector
from robo47_qp.ik.box_qp import box_qp
from robo47_qp.ik.descent import Descent
from robo47_qp.ik.pose_log import PoseLog
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
class QpIk(Checked):
    """Gauss-Newton steps on the logarithm of the tool pose, each a QP inside the joint limits.

    min over dq of ½ ‖J_e dq - e‖² + ½ (ε ‖e‖)² ‖dq - (q_seed - q)‖² + ½ μ ‖dq‖²
    subject to q_min <= q + dq <= q_max,
    with e the twist that leads to the target in unit time, J_e how it falls per joint, ε the
    posture cost and μ = `lm_damping` ‖e‖²: mink's FrameTask, PostureTask and
    ConfigurationLimit (Zakka, mink, https://github.com/kevinzakka/mink), with a posture that
    fades out on the way: a lasting one holds up the last steps. The posture decides among
    the answers of a redundant arm: the one close to the seed.
    """

    backend: str = "daqp"
    """QP solver, one of `box_qp.backends()`."""
    max_iterations: CountOrZero = 100
    """QPs before giving up."""
    lm_damping: NotNegative = 0.03
    """Damping per squared error; none at all loses a quarter of the targets."""
    posture_cost: NotNegative = 1e-2
    """ε, per error."""
    stall: Stall | None = None
    """When a start is given up early; never by default."""
    clearance: NotNegative | None = None
    """Distance to be kept by the arm from itself and from its obstacles [m]; None lets it go
    through them."""
    tolerance: Tolerance = Tolerance()

    def __post_init__(self) -> None:
        """Check the settings.

        Raises:
            InvalidValueError: A number is out of its range.
            UnknownNameError: The QP solver is not one of `backends()`.
        """
        super().__post_init__()
        box_qp(self.backend, 1)

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
        return _descent(arm, self.backend, self.lm_damping, self.posture_cost)

    def _limits(self) -> SearchLimits:
        return SearchLimits(self.tolerance, self.max_iterations, self.stall, self.clearance)

    def thorough(self) -> "QpIk":
        """See `EarlyStopping.thorough`."""
        steps = max(self.max_iterations, THOROUGH_STEPS)
        return replace(self, stall=LATE_STALL, max_iterations=steps)


class _TwistAndPosture:
    """½ ‖J_e dq - e‖² + ½ (ε ‖e‖)² ‖dq - (q_seed - q)‖² + ½ μ ‖dq‖²."""

    def __init__(self, n: int, lm_damping: float, posture_cost: float) -> None:
        self._lm_damping, self._posture = lm_damping, posture_cost**2
        self._twist = PoseLog()
        self._J = np.empty((6, n))
        self._H, self._f, self._lean = np.empty((n, n)), np.empty(n), np.empty(n)
        self._diagonal = self._H.reshape(-1)[:: n + 1]

    def expand(
        self, error: ToolError, squared_error: float, q: Vector, q_seed: Vector
    ) -> tuple[Matrix, Vector]:
        e, slope = self._twist.expand(error.e)
        J, H, f, lean = self._J, self._H, self._f, self._lean
        slope.dot(error.J, J)
        J.T.dot(J, H)
        squared = float(e.dot(e))
        posture = self._posture * squared
        self._diagonal += self._lm_damping * squared + posture + _FLOOR
        e.dot(J, f)
        np.subtract(q_seed, q, out=lean)
        mju_addToScl(f, lean, posture)
        np.negative(f, f)
        return H, f


@lru_cache(maxsize=16)
def _descent(arm: Arm, backend: str, lm_damping: float, posture_cost: float) -> Descent:
    objective = _TwistAndPosture(arm.n, lm_damping, posture_cost)
    return Descent(arm, objective, box_qp(backend, arm.n))
