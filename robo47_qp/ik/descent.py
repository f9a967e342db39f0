"""Searches of the fused solvers in the compiled core: a whole descent in one call."""

from typing import Any, Protocol, runtime_checkable

import numpy as np
from mink import SE3

from robo47_qp._core.library import Structure, backend, functions, pointer
from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.ik.avoidance import Avoidance, DistanceRows
from robo47_qp.ik.box_qp import box_qp
from robo47_qp.ik.fused_step import FusedObjective, FusedStepper
from robo47_qp.ik.gauss_newton import FLOOR, Search, Stall
from robo47_qp.ik.solver import Tolerance
from robo47_qp.ik.tool_demand import FULL, POSITION, ToolDemand
from robo47_qp.model.arm import Arm
from robo47_qp.model.chain import Chain
from robo47_qp.model.tool_poses import Target

MOST_STALL_STEPS = 64
"""Most steps over which the core measures the fall of an error, `R47_MAX_STALL`."""
_MOST = 2**31 - 1
"""Largest number that C's int holds."""
MOST_TOOLS = 8
"""Most tools of a target of the core, `R47_MAX_TOOLS`."""


def is_compiled(demand: ToolDemand, tools: tuple[int, ...], qp_solver: str = "daqp") -> bool:
    """Return whether searches of this kind run in the compiled core.

    It has whole poses and positions. Directions, free axes, more than 8 tools at once and QP
    solvers other than the default are computed by numpy with either backend.
    """
    known = demand in (FULL, POSITION) and len(tools) <= MOST_TOOLS
    return backend() == "compiled" and known and qp_solver == "daqp"


@runtime_checkable
class Descending(Protocol):
    """A solver whose search for a pose of the main tool may be one descent of the core."""

    def descent(self, arm: Arm) -> "CompiledStepper | None":
        """Return a new stepper that is asked for what the solver is; None where there is none."""
        ...

    def thorough(self) -> "Descending":
        """Return the variant that searches longer."""
        ...


class CompiledStepper(FusedStepper):
    """Steps of the compiled core; those with rows that keep a distance are those of numpy."""

    def __init__(  # noqa: PLR0913
        self,
        arm: Arm,
        objective: FusedObjective,
        *,
        tools: tuple[int, ...],
        damping: float,
        posture: float | None = None,
        limited: bool = True,
        turns: bool = True,
        demand: ToolDemand = FULL,
    ) -> None:
        """Make the memory for an arm; see `FusedStepper`.

        Args:
            arm: The arm.
            objective: What a step minimises, in numpy.
            tools: The tools that targets are for.
            damping: λ per squared error.
            posture: w per squared error of the logarithm of the pose; None for displacement and
                rotation vector without a posture.
            limited: False lets joints leave their limits.
            turns: False where the position alone has to be reached.
            demand: What of the poses counts, all of it or the position.
        """
        qp = box_qp("daqp", arm.n)
        super().__init__(arm, objective, qp, tools=tools, limited=limited, demand=demand)
        self._targets, self._seed = np.zeros((len(tools), 7)), np.zeros(arm.n)
        self.structure = Structure(
            "r47_descent",
            chain=arm.derived(Chain).structure,
            tools=len(tools),
            tool=np.array(tools, dtype=np.int32),
            turns=int(turns),
            oriented=int(demand == FULL),
            logarithm=int(posture is not None),
            damping=damping,
            posture=posture or 0.0,
            floor=FLOOR,
            q_min=self._q_min,
            q_max=self._q_max,
        )
        """The C structure `r47_descent`."""
        self.tolerance = Tolerance()
        """How close counts as reached."""
        self.target = pointer(self._targets), pointer(self._seed)
        """Targets and posture as functions of the core take them."""

    def aim(self, T_world_target: Target, q_seed: Vector) -> None:
        """See `Stepper.aim`."""
        super().aim(T_world_target, q_seed)
        self.take(T_world_target, q_seed)

    def take(self, T_world_target: Target, q_seed: Vector) -> None:
        """Take a target and a posture for the core alone."""
        if isinstance(T_world_target, SE3):
            self._targets[0] = T_world_target.wxyz_xyz
        else:
            for row, pose in zip(self._targets, T_world_target.values(), strict=True):
                row[:] = pose.wxyz_xyz
        self._seed[:] = q_seed

    def ask(self, tolerance: Tolerance, max_iterations: int, stall: Stall | None) -> None:
        """Set where descents of the core end.

        Raises:
            InvalidValueError: The fall of the error is measured over too many steps.
        """
        c, self.tolerance = self.structure.pointer, tolerance
        c.position, c.orientation = tolerance.position, tolerance.orientation
        c.max_iterations, c.stall_steps = min(max_iterations, _MOST), 0
        if stall is not None:
            if stall.steps > MOST_STALL_STEPS:
                expected = f"at most {MOST_STALL_STEPS}, else ROBO47_BACKEND=numpy"
                raise InvalidValueError("stall steps", stall.steps, expected)
            c.stall_steps, c.stall_fall = stall.steps, stall.fall

    def step(self, q: Vector, squared_error: float, rows: DistanceRows | None) -> Vector | None:
        """See `Stepper.step`."""
        if rows is not None and len(rows.upper):
            return super().step(q, squared_error, rows)
        dq = np.empty(len(q))
        at = pointer(np.ascontiguousarray(q))
        found = functions().r47_step(self.structure.pointer, *self.target, at, pointer(dq))
        return dq if found else None


class CompiledSearch(Search[CompiledStepper]):
    """The loop of `Search` in the compiled core, as long as no distance has to be kept."""

    def __init__(self, arm: Arm, stepper: CompiledStepper, *, limited: bool, turns: bool) -> None:
        """Make the memory for an arm; see `Search`."""
        super().__init__(arm, stepper, limited=limited, turns=turns)
        self._end: Any = Structure("r47_end").pointer
        self._arguments = (*stepper.target, pointer(self.q), self._end)

    def run(
        self,
        T_world_target: Target,
        q_seed: Vector,
        tolerance: Tolerance,
        max_iterations: int,
        stall: Stall | None,
        avoidance: Avoidance | None = None,
    ) -> int:
        """See `Search.run`."""
        limits = tolerance, max_iterations, stall
        if avoidance is not None:
            return super().run(T_world_target, q_seed, *limits, avoidance)
        self.stepper.take(T_world_target, q_seed)
        self.stepper.ask(*limits)
        self.q[:] = q_seed
        functions().r47_descend(self.stepper.structure.pointer, *self._arguments)
        self.reached = bool(self._end.reached)
        self.note(self._end.distance2, self._end.angle2, tolerance)
        return int(self._end.iterations)
