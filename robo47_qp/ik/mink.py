"""Inverse kinematics by mink itself: its configuration, tasks and limits, and its `solve_ik`."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from robo47_qp.arrays import Matrix, NotNegative, Vector, frozen_list
from robo47_qp.ik.box_qp import check_backend
from robo47_qp.ik.gauss_newton import GaussNewtonIk, Search
from robo47_qp.ik.mink_step import MinkSettings, MinkStepper
from robo47_qp.ik.objectives import (
    Composition,
    ConstraintSource,
    LimitSource,
    Objective,
    TaskSource,
)
from robo47_qp.ik.settling import SettlingSearch
from robo47_qp.ik.solver import IkResult, Reason, Unconverged
from robo47_qp.ik.tool_demand import ToolDemand
from robo47_qp.ik.tool_error import tools_of
from robo47_qp.model.arm import Arm
from robo47_qp.model.tool_poses import Target

_LATELY = 16
"""Searches of a user's compositions that are kept for each arm."""


@dataclass(frozen=True, kw_only=True)
class MinkIk(GaussNewtonIk):
    """Gauss-Newton steps by mink (Zakka, https://github.com/kevinzakka/mink).

    `mink.FrameTask`, `mink.PostureTask` and `mink.ConfigurationLimit`, solved by
    `mink.solve_ik`. The problem is that of `QpIk`, which solves it faster: a posture that fades
    out on the way draws the answer towards the seed. To it come any tasks, limits and
    constraints of a user, and `tolerance.demand` says what of the tool's pose is asked for.
    """

    backend: str = "daqp"
    """QP solver, one of `box_qp.backends()`."""
    lm_damping: NotNegative = 0.03
    """Levenberg-Marquardt damping of the tool's task, per squared error."""
    posture_cost: NotNegative = 1e-2
    """Cost of the posture, per error."""
    objectives: Sequence[Objective | TaskSource] = ()
    """Tasks of a user; one without an `Objective` around it has priority 1."""
    limits: Sequence[LimitSource] = ()
    """Limits of a user, beside those of the joints."""
    constraints: Sequence[ConstraintSource] = ()
    """Tasks that have to be met exactly."""
    frozen: Sequence[str] = ()
    """Names of joints that stay at the seed."""
    joint_cost: Sequence[float] | None = None
    """How dear motion of each joint is (n,); all the same by default."""

    def __post_init__(self) -> None:
        """Check the settings; what depends on the arm is checked at its first search.

        Raises:
            InvalidValueError: A number is out of its range.
            UnknownNameError: The QP solver is not one of `backends()`.
        """
        super().__post_init__()
        check_backend(self.backend)
        # Lists of the caller may change; the solver does not.
        for name in ("objectives", "limits", "constraints", "frozen", "joint_cost"):
            given = getattr(self, name)
            object.__setattr__(self, name, None if given is None else frozen_list(name, given))

    def composed(
        self, objectives: Sequence[Objective | TaskSource] = (), demand: ToolDemand | None = None
    ) -> "MinkIk":
        """Return the solver with further objectives, and with another demand where one is given."""
        tolerance = self.tolerance if demand is None else replace(self.tolerance, demand=demand)
        return replace(self, objectives=(*self.objectives, *objectives), tolerance=tolerance)

    def start(self, arm: Arm, q_start: Vector, q_seed: Vector) -> Vector:
        """Return where to start in place of q_start: frozen joints stay at the seed (n,)."""
        if not self.frozen:
            return q_start
        joints = list(self._search(arm).stepper.frozen)
        q = q_start.copy()
        q[joints] = q_seed[joints]
        return q

    def exact(self, arm: Arm, q: Vector) -> tuple[Vector, Matrix]:
        """Return errors of the constraints and frozen joints at q (k,), and their fall (k, n)."""
        return self._search(arm).stepper.exact(q)

    def explained(self, arm: Arm, T_world_target: Target, result: IkResult) -> IkResult:
        """Return a result with what of the composition gave way, or is not reached."""
        stepper = self._search(arm, tools_of(arm, T_world_target)).stepper
        if stepper.composed is None:
            return result
        relaxed = tuple(sorted(stepper.relaxed.items()))
        result = replace(result, relaxed=relaxed)
        left = stepper.left(result.q)
        if result.converged and left:
            told = f"the pose is reached, but not {'; '.join(left)}"
            return replace(result, reason=Reason.NOT_CONVERGED, explanation=told)
        rivals = stepper.rivals(result.q)
        if result.reason in (Reason.NOT_CONVERGED, Reason.JOINT_LIMITS) and (rivals or left):
            more = [*left, *(f"{rival}, which pulls at the same priority" for rival in rivals)]
            told = f"{result.explanation}; beside the pose: {'; '.join(dict.fromkeys(more))}"
            return replace(result, explanation=told)
        return result

    def _attempt(self, arm: Arm, T_world_target: Target, q_seed: Vector) -> IkResult | Unconverged:
        stepper = self._search(arm, tools_of(arm, T_world_target)).stepper
        stepper.relaxed.clear()
        end = super()._attempt(arm, T_world_target, q_seed)
        return end if isinstance(end, Unconverged) else self.explained(arm, T_world_target, end)

    def _search(self, arm: Arm, tools: tuple[int, ...] = (0,)) -> Search[MinkStepper]:
        if self.objectives or self.limits or self.constraints:
            return arm.derived(_Lately).search(arm, tools, self._settings)
        return arm.derived(_mink, tools, self._settings)

    @property
    def asked(self) -> tuple[Objective, ...]:
        """The objectives, each with its priority."""
        return tuple(_objective(one) for one in self.objectives)

    @cached_property
    def _settings(self) -> MinkSettings:
        cost = self.joint_cost
        composition = Composition(
            self.asked,
            tuple(self.limits),
            tuple(self.constraints),
            tuple(self.frozen),
            None if cost is None else tuple(float(one) for one in cost),
        )
        return MinkSettings(
            self.backend, self.lm_damping, self.posture_cost, self.tolerance.demand, composition
        )


def _objective(one: Objective | TaskSource) -> Objective:
    return one if isinstance(one, Objective) else Objective(one)


def _mink(arm: Arm, tools: tuple[int, ...], settings: MinkSettings) -> Search[MinkStepper]:
    stepper = MinkStepper(arm, tools, settings)
    return Search(arm, stepper) if stepper.composed is None else SettlingSearch(arm, stepper)


class _Lately:
    """The last few searches with objectives, limits or constraints of a user, by these.

    Each holds a state of MuJoCo's, and a program may make new ones for every waypoint.
    """

    def __init__(self, arm: Arm) -> None:
        self._kept: dict[tuple[tuple[int, ...], MinkSettings], Search[MinkStepper]] = {}

    def search(
        self, arm: Arm, tools: tuple[int, ...], settings: MinkSettings
    ) -> Search[MinkStepper]:
        key = tools, settings
        found = self._kept.pop(key, None) or _mink(arm, tools, settings)
        self._kept[key] = found
        if len(self._kept) > _LATELY:
            del self._kept[next(iter(self._kept))]
        return found
