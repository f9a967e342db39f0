"""Levenberg-Marquardt inside the joint limits: the fast path."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from robo47_qp.arrays import Longest, NotNegative
from robo47_qp.ik.box_qp import box_qp
from robo47_qp.ik.damping import Damping, clamped
from robo47_qp.ik.descent import CompiledSearch, CompiledStepper, is_compiled
from robo47_qp.ik.fused_step import FusedStepper, Linearised
from robo47_qp.ik.gauss_newton import GaussNewtonIk, Search
from robo47_qp.ik.solver import Tolerance
from robo47_qp.ik.tool_demand import FULL, ToolDemand
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
    damping: NotNegative | Damping = 0.03
    """λ per squared error, or a law of λ, there called λ²."""
    longest: Longest = np.inf
    """Displacement that a step goes for at most [m]."""
    widest: Longest = np.inf
    """Rotation that a step goes for at most [rad]."""

    def _search(self, arm: Arm, tools: tuple[int, ...] = (0,)) -> Search[Any]:
        make = _compiled if self._is_compiled(tools) else _lm
        return arm.derived(make, tools, self._settings, self.within_limits, self.tolerance.demand)

    def descent(self, arm: Arm) -> CompiledStepper | None:
        """See `Descending.descent`."""
        # A subclass may search in another way.
        plain = self.clearance is None and self.within_limits and type(self) is LmIk
        if not (plain and self._is_compiled((0,))):
            return None
        stepper = _stepper(arm, (0,), self._settings, True, self.tolerance.demand)
        stepper.ask(self._demanded, self.max_iterations, self.stall)
        return stepper

    def _is_compiled(self, tools: tuple[int, ...]) -> bool:
        """Return whether the core has this: damping per squared error, no bound on a step."""
        return self._settings.plain and is_compiled(self.tolerance.demand, tools)

    @cached_property
    def _settings(self) -> "_Settings":
        law = self.damping if isinstance(self.damping, Damping) else Damping(per_error=self.damping)
        return _Settings(law, self.longest, self.widest, 3 if self.position_only else 6)

    @property
    def _demanded(self) -> Tolerance:
        if self.position_only:
            return Tolerance(position=self.tolerance.position, orientation=np.inf)
        return self.tolerance


class _Settings(NamedTuple):
    law: Damping
    longest: float
    widest: float
    rows: int

    @property
    def plain(self) -> bool:
        """True for a damping per squared error and steps of any length."""
        bounded = np.isfinite([self.longest, self.widest]).any()
        return self.law == Damping(per_error=self.law.per_error) and not bounded


class _DampedError:
    def __init__(self, settings: _Settings, tools: int) -> None:
        law, rows = settings.law, settings.rows
        self._law, self._per_error, self._plain = law, law.per_error, settings.plain
        self._longest, self._widest = settings.longest, settings.widest
        self._bounded = np.isfinite([settings.longest, settings.widest]).any()
        # Of several tools the first rows of each.
        several = [6 * tool + row for tool in range(tools) for row in range(rows)]
        self._rows = slice(rows) if tools == 1 else several

    def linearised(self, error: ToolError, squared_error: float) -> Linearised:
        rows, e = self._rows, error.e
        if self._plain:
            return Linearised(e[rows], error.J[rows], self._per_error * squared_error)
        if self._bounded:
            parts = [clamped(part, self._longest, self._widest) for part in e.reshape(-1, 6)]
            e = np.concatenate(parts)
        e, J = e[rows], error.J[rows]
        return Linearised(e, J, self._law.squared(J, float(e.dot(e))))


def _lm(
    arm: Arm,
    tools: tuple[int, ...],
    settings: _Settings,
    limited: bool,
    demand: ToolDemand,
) -> Search[FusedStepper]:
    qp, objective = box_qp("daqp", arm.n), _DampedError(settings, len(tools))
    stepper = FusedStepper(arm, objective, qp, tools=tools, limited=limited, demand=demand)
    return Search(arm, stepper, limited=limited, turns=settings.rows == 6)


def _compiled(
    arm: Arm,
    tools: tuple[int, ...],
    settings: _Settings,
    limited: bool,
    demand: ToolDemand,
) -> Search[CompiledStepper]:
    stepper = _stepper(arm, tools, settings, limited, demand)
    return CompiledSearch(arm, stepper, limited=limited, turns=settings.rows == 6)


def _stepper(
    arm: Arm,
    tools: tuple[int, ...],
    settings: _Settings,
    limited: bool,
    demand: ToolDemand,
) -> CompiledStepper:
    return CompiledStepper(
        arm,
        _DampedError(settings, len(tools)),
        tools=tools,
        damping=settings.law.per_error,
        limited=limited,
        turns=settings.rows == 6 and demand == FULL,
        demand=demand,
    )
