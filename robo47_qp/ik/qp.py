"""Inverse kinematics as a constrained quadratic program: mink's problem, without its overhead."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from robo47_qp.arrays import NotNegative
from robo47_qp.ik.box_qp import box_qp, check_backend
from robo47_qp.ik.descent import CompiledSearch, CompiledStepper, is_compiled
from robo47_qp.ik.fused_step import FusedStepper, Linearised
from robo47_qp.ik.gauss_newton import GaussNewtonIk, Search
from robo47_qp.ik.pose_log import PoseLog
from robo47_qp.ik.solver import only_full
from robo47_qp.ik.tool_demand import FULL
from robo47_qp.ik.tool_error import ToolError
from robo47_qp.model.arm import Arm


@dataclass(frozen=True, kw_only=True)
class QpIk(GaussNewtonIk):
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
    lm_damping: NotNegative = 0.03
    """Damping per squared error; none at all loses a quarter of the targets."""
    posture_cost: NotNegative = 1e-2
    """ε, per error."""

    def __post_init__(self) -> None:
        """Check the settings.

        Raises:
            InvalidValueError: A number is out of its range, or the demand is not the whole pose.
            UnknownNameError: The QP solver is not one of `backends()`.
        """
        super().__post_init__()
        check_backend(self.backend)
        only_full(self.tolerance, "QpIk")

    def _search(self, arm: Arm, tools: tuple[int, ...] = (0,)) -> Search[Any]:
        if is_compiled(FULL, tools, self.backend):
            return arm.derived(_compiled, tools, self.lm_damping, self.posture_cost)
        return arm.derived(_qp, tools, self.backend, self.lm_damping, self.posture_cost)

    def descent(self, arm: Arm) -> CompiledStepper | None:
        """See `Descending.descent`."""
        # A subclass may search in another way.
        plain = self.clearance is None and type(self) is QpIk
        if not (plain and is_compiled(FULL, (0,), self.backend)):
            return None
        stepper = _stepper(arm, (0,), self.lm_damping, self.posture_cost)
        stepper.ask(self.tolerance, self.max_iterations, self.stall)
        return stepper


class _TwistAndPosture:
    def __init__(self, n: int, lm_damping: float, posture_cost: float) -> None:
        self._lm_damping, self._posture = lm_damping, posture_cost**2
        self._log, self._J = PoseLog(), np.empty((6, n))

    def linearised(self, error: ToolError, squared_error: float) -> Linearised:
        e, slope = self._log.expand(error.e)
        slope.dot(error.J, self._J)
        squared = float(e.dot(e))
        posture = self._posture * squared
        return Linearised(e, self._J, self._lm_damping * squared + posture, posture)


class _TwistsAndPosture(_TwistAndPosture):
    """The same for several tools, whose twists stand one after the other."""

    def __init__(self, n: int, lm_damping: float, posture_cost: float, tools: int) -> None:
        super().__init__(n, lm_damping, posture_cost)
        self._e, self._J = np.empty(6 * tools), np.empty((6 * tools, n))

    def linearised(self, error: ToolError, squared_error: float) -> Linearised:
        e, J = self._e, self._J
        for first in range(0, len(e), 6):
            rows = slice(first, first + 6)
            e[rows], slope = self._log.expand(error.e[rows])
            np.matmul(slope, error.J[rows], out=J[rows])
        squared = float(e.dot(e))
        posture = self._posture * squared
        return Linearised(e, J, self._lm_damping * squared + posture, posture)


def _qp(
    arm: Arm, tools: tuple[int, ...], backend: str, lm_damping: float, posture_cost: float
) -> Search[FusedStepper]:
    objective = _objective(arm, tools, lm_damping, posture_cost)
    return Search(arm, FusedStepper(arm, objective, box_qp(backend, arm.n), tools=tools))


def _compiled(
    arm: Arm, tools: tuple[int, ...], lm_damping: float, posture_cost: float
) -> Search[CompiledStepper]:
    stepper = _stepper(arm, tools, lm_damping, posture_cost)
    return CompiledSearch(arm, stepper, limited=True, turns=True)


def _stepper(
    arm: Arm, tools: tuple[int, ...], lm_damping: float, posture_cost: float
) -> CompiledStepper:
    objective = _objective(arm, tools, lm_damping, posture_cost)
    return CompiledStepper(arm, objective, tools=tools, damping=lm_damping, posture=posture_cost**2)


def _objective(
    arm: Arm, tools: tuple[int, ...], lm_damping: float, posture_cost: float
) -> _TwistAndPosture:
    if len(tools) == 1:
        return _TwistAndPosture(arm.n, lm_damping, posture_cost)
    return _TwistsAndPosture(arm.n, lm_damping, posture_cost, len(tools))
