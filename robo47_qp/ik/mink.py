"""Inverse kinematics by mink itself: its configuration, tasks and limits, and its `solve_ik`."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

import mink
import numpy as np
from mink import SE3

from robo47_qp.arrays import Matrix, NotNegative, Vector
from robo47_qp.ik.avoidance import DistanceRows
from robo47_qp.ik.box_qp import OSQP_SETTINGS, check_backend, dense_call
from robo47_qp.ik.gauss_newton import FLOOR, GaussNewtonIk, Search
from robo47_qp.ik.mended import FrameTask
from robo47_qp.ik.tool_error import ToolError, ToolsError, error_to
from robo47_qp.model.arm import Arm
from robo47_qp.model.tool_poses import Target

_DT = 1.0
"""A step is a displacement: mink's velocity over one second [s]."""


@dataclass(frozen=True, kw_only=True)
class MinkIk(GaussNewtonIk):
    """Gauss-Newton steps by mink (Zakka, https://github.com/kevinzakka/mink).

    `mink.FrameTask`, `mink.PostureTask` and `mink.ConfigurationLimit`, solved by
    `mink.solve_ik`. The problem is that of `QpIk`, which solves it faster: a posture that fades
    out on the way draws the answer towards the seed.
    """

    backend: str = "daqp"
    """QP solver, one of `box_qp.backends()`."""
    lm_damping: NotNegative = 0.03
    """Levenberg-Marquardt damping of the tool's task, per squared error."""
    posture_cost: NotNegative = 1e-2
    """Cost of the posture, per error."""

    def __post_init__(self) -> None:
        """Check the settings.

        Raises:
            InvalidValueError: A number is out of its range.
            UnknownNameError: The QP solver is not one of `backends()`.
        """
        super().__post_init__()
        check_backend(self.backend)

    def _search(self, arm: Arm, tools: tuple[int, ...] = (0,)) -> Search:
        return arm.derived(_mink, tools, self.backend, self.lm_damping, self.posture_cost)


class ToolTask(FrameTask):
    """`mended.FrameTask` of a tool, its residual taken from the search's own measurement.

    Costs and gain are 1. The residual has the axes of the world and the signs of both error and
    Jacobian turned around: norms, and so the QP, are those of mink.
    """

    def __init__(self, arm: Arm, tool: int, way: ToolError, lm_damping: float) -> None:
        """Make the task of a tool of an arm, measured by `way`."""
        super().__init__(arm.robot.tools[tool].tcp, "site", 1.0, 1.0, lm_damping=lm_damping)
        self._measured, self._J = way, np.empty((6, arm.n))
        self.squared_error = 0.0
        """That of the last residual."""

    def compute_qp_residual(
        self, configuration: mink.Configuration
    ) -> tuple[Matrix, Vector, float]:
        """See `mink.Task.compute_qp_residual`."""
        way = self._measured
        way.update_jacobian()
        e, slope = self._log.expand(way.e)
        self.squared_error = float(e.dot(e))
        return slope.dot(way.J, self._J), e, self.lm_damping * self.squared_error


class _FadingPosture(mink.PostureTask):
    """`mink.PostureTask` whose cost is a share of the tools' error: a lasting one holds it up."""

    def __init__(self, arm: Arm, tools: Sequence[ToolTask], share: float) -> None:
        super().__init__(arm.model, cost=share)
        self._tools, self._share = tools, share
        self._identity, self._J = np.eye(arm.n), np.empty((arm.n, arm.n))

    def compute_qp_residual(
        self, configuration: mink.Configuration
    ) -> tuple[Matrix, Vector, float]:
        if self.target_q is None:
            raise mink.TargetNotSet(type(self).__name__)
        cost = self._share * sqrt(sum(tool.squared_error for tool in self._tools))
        J = np.multiply(self._identity, cost, out=self._J)
        return J, cost * (self.target_q - configuration.data.qpos), 0.0


class _JointLimits(mink.ConfigurationLimit):
    """`mink.ConfigurationLimit` of joints with one degree of freedom each, in memory kept."""

    def __init__(self, arm: Arm) -> None:
        super().__init__(arm.model, gain=1.0)
        self._G = np.vstack([np.eye(arm.n), -np.eye(arm.n)])
        self._h = np.empty(2 * arm.n)
        self._high, self._low = self._h[: arm.n], self._h[arm.n :]

    def compute_qp_inequalities(
        self, configuration: mink.Configuration, dt: float
    ) -> mink.Constraint:
        q = configuration.data.qpos
        np.subtract(self.upper, q, self._high)
        np.subtract(q, self.lower, self._low)
        return mink.Constraint(self._G, self._h)


class _Rows(mink.Limit):
    """Rows of the step that is being made."""

    def __init__(self) -> None:
        self.rows: DistanceRows | None = None

    def compute_qp_inequalities(
        self, configuration: mink.Configuration, dt: float
    ) -> mink.Constraint:
        if self.rows is None or len(self.rows.upper) == 0:
            return mink.Constraint()
        return mink.Constraint(self.rows.A, self.rows.upper)


class MinkStepper:
    """mink's objects for one arm, made once; see `gauss_newton.Stepper`."""

    def __init__(
        self,
        arm: Arm,
        tools: tuple[int, ...],
        backend: str,
        lm_damping: float,
        posture_cost: float,
    ) -> None:
        """Make the objects for some tools of an arm; the settings are those of `MinkIk`."""
        self._solver: dict[str, Any] = {"solver": backend}
        if backend == "osqp":
            self._solver |= OSQP_SETTINGS
        self._backend = backend
        self._configuration = mink.Configuration(arm.model)
        self._error = error_to(arm, tools, self._configuration.data)
        ways = self._error.parts if isinstance(self._error, ToolsError) else [self._error]
        self._tools = [
            ToolTask(arm, tool, way, lm_damping) for tool, way in zip(tools, ways, strict=True)
        ]
        self._posture = _FadingPosture(arm, self._tools, posture_cost)
        self._rows = _Rows()
        self._limits = [_JointLimits(arm), self._rows]
        self._tasks = [*self._tools, self._posture]

    def aim(self, T_world_target: Target, q_seed: Vector) -> None:
        """See `Stepper.aim`."""
        self._error.set_target(T_world_target)
        if isinstance(T_world_target, SE3):
            self._tools[0].set_target(T_world_target)
        else:
            for tool, pose in zip(self._tools, T_world_target.values(), strict=True):
                tool.set_target(pose)
        self._posture.set_target(q_seed)

    def move(self, q: Vector) -> tuple[float, float, float]:
        """See `Stepper.move`."""
        self._configuration.update(q)
        distance2, angle2 = self._error.measure()
        return distance2, angle2, 0.0

    def step(self, q: Vector, squared_error: float, rows: DistanceRows | None) -> Vector | None:
        """See `Stepper.step`; where rows leave no step, the parting gives way."""
        self._rows.rows = rows
        dq = self._solved()
        if dq is None and rows is not None and len(rows.upper) and rows.upper.min() < 0.0:
            self._rows.rows = rows._replace(upper=np.maximum(rows.upper, 0.0))
            dq = self._solved()
        return dq

    def _solved(self) -> Vector | None:
        """Return mink's step; None where its QP has no solution."""
        try:
            with dense_call(self._backend):
                step: Vector = mink.solve_ik(
                    self._configuration,
                    self._tasks,
                    _DT,
                    damping=FLOOR,
                    limits=self._limits,
                    **self._solver,
                )
        except mink.NoSolutionFound:
            return None
        return step


def _mink(
    arm: Arm, tools: tuple[int, ...], backend: str, lm_damping: float, posture_cost: float
) -> Search:
    return Search(arm, MinkStepper(arm, tools, backend, lm_damping, posture_cost))
