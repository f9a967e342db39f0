"""Tasks and limits of mink's for steps on one arm, in memory that is kept."""

from collections.abc import Sequence
from math import sqrt
from typing import TypeAlias

import mink
import numpy as np
from mink import SE3
from mink.limits import Constraint

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.ik.avoidance import DistanceRows
from robo47_qp.ik.mended import FrameTask
from robo47_qp.ik.refinement import Residual
from robo47_qp.ik.tool_error import ToolError
from robo47_qp.model.arm import Arm


class ToolTask(FrameTask):
    """`mended.FrameTask` of a tool, its residual taken from the search's own measurement.

    Costs and gain are 1. The residual has the axes of the world and the signs of both error and
    Jacobian turned around: norms, and so the QP, are those of mink.
    """

    def __init__(self, arm: Arm, tool: int, way: ToolError, lm_damping: float) -> None:
        """Make the task of a tool of an arm, measured by `way`."""
        super().__init__(arm.robot.tools[tool].tcp, "site", 1.0, 1.0, lm_damping=lm_damping)
        self._measured, self._J = way, np.empty((6, arm.n))
        self.residual: Residual = (self._J, way.e, 0.0)
        """The last one."""
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
        self.residual = slope.dot(way.J, self._J), e, self.lm_damping * self.squared_error
        return self.residual


class DemandTask(mink.Task):
    """What a demand asks of a tool: displacement and rotation vector, in the axes of the world."""

    def __init__(self, way: ToolError, lm_damping: float) -> None:
        """Make the task of a tool, measured by `way`."""
        super().__init__(np.ones(6), lm_damping=lm_damping)
        self._measured = way
        self.residual: Residual = (way.J, way.e, 0.0)
        """The last one."""
        self.squared_error = 0.0
        """That of the last residual."""

    def set_target(self, T_world_target: SE3) -> None:
        """Take a target, which `way` measures to."""

    def compute_error(self, configuration: mink.Configuration) -> Vector:
        """Return the error, which falls to zero (6,)."""
        return -self._measured.e

    def compute_jacobian(self, configuration: mink.Configuration) -> Matrix:
        """Return the change of the error per joint (6, n)."""
        self._measured.update_jacobian()
        return self._measured.J

    def compute_qp_residual(
        self, configuration: mink.Configuration
    ) -> tuple[Matrix, Vector, float]:
        """See `mink.Task.compute_qp_residual`."""
        way = self._measured
        way.update_jacobian()
        self.squared_error = float(way.e.dot(way.e))
        self.residual = way.J, way.e, self.lm_damping * self.squared_error
        return self.residual


ToolTasks: TypeAlias = Sequence[ToolTask | DemandTask]


class FadingPosture(mink.PostureTask):
    """`mink.PostureTask` whose cost is a share of the tools' error: a lasting one holds it up."""

    def __init__(self, arm: Arm, tools: ToolTasks, share: float, joint_cost: Vector | None) -> None:
        """Make it for an arm."""
        super().__init__(arm.model, cost=share)
        self._tools, self._share, self._joint_cost = tools, share, joint_cost
        self._identity, self._J = np.eye(arm.n), np.empty((arm.n, arm.n))
        self.residual: Residual = (self._J, np.zeros(arm.n), 0.0)
        """The last one."""

    def compute_qp_residual(
        self, configuration: mink.Configuration
    ) -> tuple[Matrix, Vector, float]:
        """See `mink.Task.compute_qp_residual`."""
        if self.target_q is None:
            raise mink.TargetNotSet(type(self).__name__)
        cost = self._share * sqrt(sum(tool.squared_error for tool in self._tools))
        costs = cost if self._joint_cost is None else cost * self._joint_cost
        J = np.multiply(self._identity, costs, out=self._J)
        self.residual = J, costs * (self.target_q - configuration.data.qpos), 0.0
        return self.residual


class FadingDamping(mink.DampingTask):
    """`mink.DampingTask` in place of the tools' damping, where joints differ in cost."""

    def __init__(self, arm: Arm, tools: ToolTasks, lm_damping: float, joint_cost: Vector) -> None:
        """Make it for an arm."""
        super().__init__(arm.model, joint_cost)
        self._tools, self._lm_damping = tools, lm_damping

    def compute_qp_residual(
        self, configuration: mink.Configuration
    ) -> tuple[Matrix, Vector, float]:
        """See `mink.Task.compute_qp_residual`."""
        squared = self._lm_damping * sum(tool.squared_error for tool in self._tools)
        return np.diag(sqrt(squared) * self.cost), np.zeros(self.k), 0.0


class JointLimits(mink.ConfigurationLimit):
    """`mink.ConfigurationLimit` of joints with one degree of freedom each, in memory kept."""

    def __init__(self, arm: Arm) -> None:
        """Make it for an arm."""
        super().__init__(arm.model, gain=1.0)
        limited = np.flatnonzero(~arm.free)
        rows, count = np.eye(arm.n)[limited], len(limited)
        self._G = np.vstack([rows, -rows])
        self._h = np.empty(2 * count)
        self._high, self._low = self._h[:count], self._h[count:]
        self._limited = limited if count < arm.n else None

    def compute_qp_inequalities(self, configuration: mink.Configuration, dt: float) -> Constraint:
        """See `mink.Limit.compute_qp_inequalities`."""
        q = configuration.data.qpos
        if self._limited is None:
            np.subtract(self.upper, q, self._high)
            np.subtract(q, self.lower, self._low)
        else:
            np.subtract(self.upper[self._limited], q[self._limited], self._high)
            np.subtract(q[self._limited], self.lower[self._limited], self._low)
        return Constraint(self._G, self._h)


class Rows(mink.Limit):
    """Rows of the step that is being made."""

    def __init__(self) -> None:
        """Make it for an arm."""
        self.rows: DistanceRows | None = None

    def compute_qp_inequalities(self, configuration: mink.Configuration, dt: float) -> Constraint:
        """See `mink.Limit.compute_qp_inequalities`."""
        if self.rows is None or len(self.rows.upper) == 0:
            return Constraint()
        return Constraint(self.rows.A, self.rows.upper)
