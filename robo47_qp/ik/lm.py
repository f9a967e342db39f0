"""Levenberg-Marquardt inside the joint limits: the fast path."""

from dataclasses import dataclass

import numpy as np

from robo47_qp.arrays import NotNegative
from robo47_qp.ik.box_qp import box_qp
from robo47_qp.ik.fused_step import FusedStepper, Linearised
from robo47_qp.ik.gauss_newton import GaussNewtonIk, Search
from robo47_qp.ik.solver import Tolerance
from robo47_qp.ik.tool_demand import ToolDemand
from robo47_qp.ik.tool_error import ToolError
from robo47_qp.model.arm import Arm


@dataclass(frozen=True, kw_only=True)
class LmIk(GaussNewtonIk):
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
    damping: NotNegative = 0.03
    """λ per squared error."""

    def _search(self, arm: Arm, tools: tuple[int, ...] = (0,)) -> Search[FusedStepper]:
        rows = 3 if self.position_only else 6
        return arm.derived(
            _lm, tools, self.damping, rows, self.within_limits, self.tolerance.demand
        )

    @property
    def _demanded(self) -> Tolerance:
        if self.position_only:
            return Tolerance(position=self.tolerance.position, orientation=np.inf)
        return self.tolerance


class _DampedError:
    def __init__(self, damping: float, rows: int, tools: int) -> None:
        self._damping = damping
        # Of several tools the first rows of each.
        several = [6 * tool + row for tool in range(tools) for row in range(rows)]
        self._rows = slice(rows) if tools == 1 else several

    def linearised(self, error: ToolError, squared_error: float) -> Linearised:
        rows, damping = self._rows, self._damping * squared_error
        return Linearised(error.e[rows], error.J[rows], damping)


def _lm(
    arm: Arm,
    tools: tuple[int, ...],
    damping: float,
    rows: int,
    limited: bool,
    demand: ToolDemand,
) -> Search[FusedStepper]:
    qp, objective = box_qp("daqp", arm.n), _DampedError(damping, rows, len(tools))
    stepper = FusedStepper(arm, objective, qp, tools=tools, limited=limited, demand=demand)
    return Search(arm, stepper, limited=limited, turns=rows == 6)
