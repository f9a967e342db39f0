"""Steps by mink: its objects made once for an arm, and what a user adds to them."""

from collections.abc import Sequence
from typing import NamedTuple

import mink
import numpy as np
from mink import SE3
from mink.tasks import BaseTask

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.ik.avoidance import DistanceRows
from robo47_qp.ik.box_qp import dense_call, settings_of
from robo47_qp.ik.gauss_newton import FLOOR
from robo47_qp.ik.levels import in_freedom, null_space, weighted_jacobian
from robo47_qp.ik.mink_tasks import (
    DemandTask,
    FadingDamping,
    FadingPosture,
    JointLimits,
    Rows,
    ToolTask,
)
from robo47_qp.ik.objectives import HELD, Composed, Composition, Softened, composed
from robo47_qp.ik.refinement import ILL_CONDITIONED, refined_by_residuals
from robo47_qp.ik.tool_demand import FULL, ToolDemand
from robo47_qp.ik.tool_error import ToolsError, error_to
from robo47_qp.model.arm import Arm
from robo47_qp.model.tool_poses import Target

_DT = 1.0
"""A step is a displacement: mink's velocity over one second [s]."""
_NEAR = 0.1
"""Error of the tools below which further levels move, too [m + rad]."""
LONGEST = 0.3
"""Longest motion of a joint for a further level in one step [rad or m]."""


class MinkSettings(NamedTuple):
    """Settings of the steps; see `MinkIk`."""

    backend: str
    lm_damping: float
    posture_cost: float
    demand: ToolDemand
    composition: Composition


class MinkStepper:
    """mink's objects for one arm, made once; see `gauss_newton.Stepper`."""

    def __init__(self, arm: Arm, tools: tuple[int, ...], settings: MinkSettings) -> None:
        """Make the objects for some tools of an arm.

        Raises:
            InvalidValueError, UnknownNameError: See `objectives.composed`.
        """
        self._settings, self._backend = settings, settings.backend
        self.composed: Composed | None = None
        """What a user adds; None where nothing is."""
        if not settings.composition.empty:
            self.composed = composed(arm, settings.composition)
        self._configuration = mink.Configuration(arm.model)
        self._error = error_to(arm, tools, self._configuration.data, settings.demand)
        ways = self._error.parts if isinstance(self._error, ToolsError) else [self._error]
        dear = None if self.composed is None else self.composed.joint_cost
        damping = settings.lm_damping if dear is None else 0.0
        full = settings.demand == FULL
        self._tools: list[ToolTask | DemandTask] = [
            ToolTask(arm, tool, way, damping) if full else DemandTask(way, damping)
            for tool, way in zip(tools, ways, strict=True)
        ]
        self._posture = FadingPosture(arm, self._tools, settings.posture_cost, dear)
        self._rows, self._q_min, self._q_max = Rows(), arm.q_min, arm.q_max
        self._limits: list[mink.Limit] = [JointLimits(arm), self._rows]
        self._tasks: list[BaseTask] = [*self._tools, self._posture]
        self._constraints: list[mink.Task] = []
        self._frozen: list[mink.Task] = []
        self.frozen: tuple[int, ...] = ()
        """Degrees of freedom that stay at the seed."""
        self.relaxed: dict[str, int] = {}
        """In how many steps each demand gave way."""
        if self.composed is not None:
            self._compose(arm, self.composed, settings.lm_damping)

    def _compose(self, arm: Arm, added: Composed, lm_damping: float) -> None:
        self._tasks += [part.task for part in added.levels[0]]
        if added.joint_cost is not None:
            self._tasks.append(FadingDamping(arm, self._tools, lm_damping, added.joint_cost))
        self._limits += added.limits
        self._constraints = [
            part.task for part in added.constraints if isinstance(part.task, mink.Task)
        ]
        self.frozen = added.frozen
        if added.frozen:
            self._frozen = [mink.DofFreezingTask(arm.model, [*added.frozen])]
        self._further = [[part.task for part in level] for level in added.levels[1:]]
        self._hard = [part for part in added.parts if part.tolerance is not None]
        self._driven = any(
            part.tolerance is not None for level in added.levels[1:] for part in level
        )

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
        if self.composed is None:
            return distance2, angle2, 0.0
        return distance2, angle2, self._rest2(self.composed)

    def _rest2(self, added: Composed) -> float:
        """Return the squared errors of what has to be reached beside the pose, and is not."""
        rest2 = 0.0
        for part in (*self._hard, *added.constraints):
            error = part.error(self._configuration)
            # A NaN is no error that is small enough.
            rest2 += 0.0 if error <= (part.tolerance or 0.0) else error**2
        return rest2

    def step(self, q: Vector, squared_error: float, rows: DistanceRows | None) -> Vector | None:
        """See `Stepper.step`; what cannot be met at once gives way in a fixed order.

        Pairs that should part only stay apart; then limits of a user that ask for a motion are
        content with none; then constraints are objectives that are dear, and counted.
        """
        self._rows.rows = rows
        constraints = [*self._frozen, *self._constraints]
        dq = self._solved(constraints)
        if dq is None and rows is not None and len(rows.upper) and rows.upper.min() < 0.0:
            self._rows.rows = rows._replace(upper=np.maximum(rows.upper, 0.0))
            dq = self._solved(constraints)
        if self.composed is None:
            free = rows is None or len(rows.upper) == 0
            return self._refined(q, dq) if free and dq is not None else dq
        if dq is None:
            dq = self._relaxed(self.composed)
        if dq is None or not np.isfinite(dq).all():
            return None
        if self._driven and squared_error < _NEAR**2:
            dq = dq + shortened(self.further(dq) - dq, LONGEST)
        if self.frozen:
            # But for rounding it is so already.
            dq[[*self.frozen]] = 0.0
        return dq

    def _refined(self, q: Vector, dq: Vector) -> Vector:
        """Return mink's step with the digits that its JᵀJ has lost."""
        if sum(tool.lm_damping * tool.squared_error for tool in self._tools) > ILL_CONDITIONED:
            return dq
        bounds = self._q_min - q, self._q_max - q
        residuals = [task.residual for task in (*self._tools, self._posture)]
        return refined_by_residuals(residuals, FLOOR, bounds, dq)

    def _relaxed(self, added: Composed) -> Vector | None:
        """Return a step with limits and then constraints relaxed; None where even that is none."""
        pressing = [one for one in added.limits if one.violation(self._configuration, _DT) > 0.0]
        for limit in pressing:
            limit.yields = True
        try:
            dq = self._solved([*self._frozen, *self._constraints])
            soft = dq is None and bool(self._constraints)
            if soft:
                dq = self._solved(self._frozen, [Softened(one) for one in self._constraints])
        finally:
            for limit in pressing:
                limit.yields = False
        gave = [limit.name for limit in pressing]
        gave += [part.name for part in added.constraints] if soft else []
        for name in gave:
            self.relaxed[name] = self.relaxed.get(name, 0) + 1
        return dq

    def _solved(
        self, constraints: Sequence[mink.Task], more: Sequence[BaseTask] = ()
    ) -> Vector | None:
        """Return mink's step; None where its QP has no solution."""
        try:
            with dense_call(self._backend):
                step: Vector = mink.solve_ik(
                    self._configuration,
                    [*self._tasks, *more] if more else self._tasks,
                    _DT,
                    damping=FLOOR,
                    limits=self._limits,
                    constraints=constraints,
                    **settings_of(self._backend),
                )
        except mink.NoSolutionFound:
            return None
        return step

    def further(self, dq: Vector) -> Vector:
        """Return a step with what the further levels add in the freedom that is left (n,)."""
        if self.composed is None:
            return dq
        at = self._configuration
        first = [*self._tools, *(part.task for part in self.composed.levels[0])]
        exact = [*self._constraints, *self._frozen]
        held = [weighted_jacobian(at, task) for task in first]
        held += [one.compute_jacobian(at) for one in exact]
        return in_freedom(
            at, dq, null_space(np.vstack(held)), self._further, self._limits, self._backend
        )

    def exact(self, q: Vector) -> tuple[Vector, Matrix]:
        """Return errors of constraints and frozen joints at q (k,), and their fall (k, n)."""
        at = self._configuration
        at.update(q)
        exact = [*self._constraints, *self._frozen]
        errors = [one.compute_error(at) for one in exact]
        return np.concatenate(errors), -np.vstack([one.compute_jacobian(at) for one in exact])

    def values(self) -> list[float]:
        """Return ½ ‖cost · error‖² of each further level, where the last `move` led."""
        levels = () if self.composed is None else self.composed.levels[1:]
        return [sum(part.value(self._configuration) for part in level) for level in levels]

    def left(self, q: Vector) -> list[str]:
        """Return what of a user's demands is not reached at q, in words."""
        if self.composed is None:
            return []
        self._configuration.update(q)
        left = []
        for part in (*self._hard, *self.composed.constraints):
            error = part.error(self._configuration)
            if not error <= (part.tolerance or 0.0):
                left.append(f"{part.name} (error {error:.3g}, asked {part.tolerance:.3g})")
        for limit in self.composed.limits:
            violation = limit.violation(self._configuration, _DT)
            if not violation <= HELD:
                left.append(f"limit {limit.name} (violated by {violation:.3g})")
        return left

    def rivals(self, q: Vector) -> list[str]:
        """Return the tasks in one QP with the tool that have an error at q, in words."""
        if self.composed is None:
            return []
        self._configuration.update(q)
        errors = [(one.name, one.error(self._configuration)) for one in self.composed.levels[0]]
        return [f"{name} (error {error:.3g})" for name, error in errors if error > HELD]


def shortened(dq: Vector, longest: float) -> Vector:
    """Return a motion in which no joint moves by more than `longest`."""
    size = float(np.abs(dq).max())
    return dq if size <= longest else dq * (longest / size)
