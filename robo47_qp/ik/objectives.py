"""Objectives, limits and constraints of a user's own, from mink or anywhere else."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import mink
import numpy as np
from mink.limits import Constraint
from mink.tasks import BaseTask

from robo47_qp.arrays import Checked, CountOrZero, Matrix, NotNegative, Vector
from robo47_qp.errors import InvalidValueError, UnknownNameError
from robo47_qp.model.arm import Arm

TaskSource: TypeAlias = BaseTask | Callable[[Arm], BaseTask]
LimitSource: TypeAlias = mink.Limit | Callable[[Arm], mink.Limit]
ConstraintSource: TypeAlias = mink.Task | Callable[[Arm], mink.Task]
"""An object of mink's, used as it is, or what makes one: called once for each arm."""
HELD = 1e-6
"""Largest error of a constraint, and violation of a limit, that counts as none [its units]."""


@dataclass(frozen=True)
class Objective(Checked):
    """A task with a priority, and what of it has to be reached."""

    task: TaskSource
    priority: CountOrZero = 1
    """0: in one QP with the pose of the tool, costs decide. 1 and above: only in the freedom that
    all lower numbers leave, so that the pose does not suffer."""
    tolerance: NotNegative | None = None
    """Norm of the task's error that counts as reached; None: the best there is will do."""


@dataclass(frozen=True)
class Composition:
    """What a user adds to the pose of the tool; hashable, so that it is built once per arm."""

    objectives: tuple[Objective, ...] = ()
    limits: tuple[LimitSource, ...] = ()
    constraints: tuple[ConstraintSource, ...] = ()
    frozen: tuple[str, ...] = ()
    """Names of the joints that stay at the seed."""
    joint_cost: tuple[float, ...] | None = None
    """How dear motion of each joint is."""

    @property
    def empty(self) -> bool:
        """Whether nothing is added."""
        return self == Composition()


class Part(NamedTuple):
    """A task of one arm."""

    name: str
    task: BaseTask
    tolerance: float | None = None

    def error(self, configuration: mink.Configuration) -> float:
        """Return the norm of the task's error; 0 for tasks that have none."""
        if not isinstance(self.task, mink.Task):
            return 0.0
        return float(np.linalg.norm(self.task.compute_error(configuration)))

    def value(self, configuration: mink.Configuration) -> float:
        """Return ½ ‖cost · error‖²; 0 for tasks that have no error."""
        if not isinstance(self.task, mink.Task):
            return 0.0
        weighted = self.task.cost * self.task.compute_error(configuration)
        return 0.5 * float(weighted.dot(weighted))


class Yielding(mink.Limit):
    """A user's limit that can be told to ask for nothing but to get no worse."""

    def __init__(self, name: str, limit: mink.Limit) -> None:
        """Wrap a limit."""
        self.name, self.limit = name, limit
        self.yields = False
        """True: rows that ask for a motion are content with none."""

    def compute_qp_inequalities(self, configuration: mink.Configuration, dt: float) -> Constraint:
        """See `mink.Limit`."""
        found = self.limit.compute_qp_inequalities(configuration, dt)
        if not self.yields or found.h is None:
            return found
        return Constraint(found.G, np.maximum(found.h, 0.0))

    def violation(self, configuration: mink.Configuration, dt: float) -> float:
        """Return by how much a row asks for a motion at a configuration; 0 where none does."""
        h = self.limit.compute_qp_inequalities(configuration, dt).h
        return 0.0 if h is None or len(h) == 0 else max(0.0, -float(np.min(h)))


class Softened(BaseTask):
    """A constraint as a task that is dear, where it cannot be met in one step."""

    _COST = 1e3

    def __init__(self, task: mink.Task) -> None:
        """Wrap a constraint."""
        self._task = task

    def compute_qp_residual(
        self, configuration: mink.Configuration
    ) -> tuple[Matrix, Vector, float]:
        """See `mink.Task.compute_qp_residual`."""
        J, e = self._task.compute_jacobian(configuration), self._task.compute_error(configuration)
        return self._COST * J, -self._COST * self._task.gain * e, 0.0

    def compute_qp_objective(self, configuration: mink.Configuration) -> Any:
        """See `mink.BaseTask`."""
        W, e, _ = self.compute_qp_residual(configuration)
        return mink.Objective(W.T @ W, -e @ W)


class Composed(NamedTuple):
    """A composition for one arm."""

    levels: tuple[tuple[Part, ...], ...]
    """Tasks by priority: those in one QP with the tool, then the others in order."""
    limits: tuple[Yielding, ...]
    constraints: tuple[Part, ...]
    frozen: tuple[int, ...]
    """Degrees of freedom of the frozen joints."""
    joint_cost: Vector | None

    @property
    def parts(self) -> tuple[Part, ...]:
        """All tasks, the constraints aside."""
        return tuple(part for level in self.levels for part in level)


def composed(arm: Arm, composition: Composition) -> Composed:
    """Build a composition for an arm, and check it at the arm's home.

    Raises:
        UnknownNameError: A frame or a joint is not in the arm's model.
        InvalidValueError: A cost has the wrong shape or is not finite, a limit has no rows or
            rows of the wrong length, a constraint is no task, a target is not set.
    """
    configuration = mink.Configuration(arm.model, q=arm.home)
    levels: dict[int, list[Part]] = {0: []}
    for objective in sorted(composition.objectives, key=lambda one: one.priority):
        task = _made(arm, objective.task, BaseTask, "an objective")
        name = _name(task)
        _check_task(configuration, name, task)
        part = Part(name, task, objective.tolerance)
        levels.setdefault(objective.priority, []).append(part)
    limits = [_made(arm, source, mink.Limit, "a limit") for source in composition.limits]
    for limit in limits:
        _check_limit(configuration, _name(limit), limit)
    constraints = [_made(arm, one, mink.Task, "a constraint") for one in composition.constraints]
    for constraint in constraints:
        _check_task(configuration, _name(constraint), constraint)
    unknown = [name for name in composition.frozen if name not in arm.robot.joints]
    if unknown:
        raise UnknownNameError("joint", unknown[0], arm.robot.joints)
    return Composed(
        tuple(tuple(parts) for parts in levels.values()),
        tuple(Yielding(_name(limit), limit) for limit in limits),
        tuple(Part(_name(one), one, HELD) for one in constraints),
        tuple(arm.robot.joints.index(name) for name in dict.fromkeys(composition.frozen)),
        _joint_cost(arm, composition.joint_cost),
    )


def _joint_cost(arm: Arm, cost: tuple[float, ...] | None) -> Vector | None:
    if cost is None:
        return None
    found = np.array(cost, dtype=np.float64)
    if found.shape != (arm.n,) or not np.isfinite(found).all() or (found <= 0.0).any():
        raise InvalidValueError("joint_cost", list(cost), f"{arm.n} finite numbers above 0")
    return found


def _made(arm: Arm, source: Any, kind: type[Any], what: str) -> Any:
    """Return the object of a source, checked to be of a kind."""
    made = source
    if not isinstance(source, kind) and callable(source):
        try:
            made = source(arm)
        except (mink.MinkError, KeyError) as error:
            text = str(error).strip("\"'")
            raise InvalidValueError(what, text, "one that can be made for this arm") from error
    if not isinstance(made, kind):
        raise InvalidValueError(what, repr(made), f"a mink.{kind.__name__}, or what makes one")
    return made


def _name(made: object) -> str:
    frame = getattr(made, "frame_name", None)
    return type(made).__name__ + ("" if frame is None else f" of {frame!r}")


def _check_task(configuration: mink.Configuration, name: str, task: BaseTask) -> None:
    nv = configuration.nv
    if isinstance(task, mink.Task):
        e, J = _tried(
            name, lambda: (task.compute_error(configuration), task.compute_jacobian(configuration))
        )
        cost = np.asarray(task.cost)
        if np.ndim(e) != 1 or np.shape(J) != (len(e), nv):
            found = f"{np.shape(e)} and {np.shape(J)}"
            raise InvalidValueError(f"error and Jacobian of {name}", found, f"(k,) and (k, {nv})")
        if cost.shape not in {(len(e),), (1,)}:
            raise InvalidValueError(f"cost of {name}", f"shape {cost.shape}", f"shape ({len(e)},)")
        if not np.isfinite(cost).all() or (cost < 0.0).any():
            raise InvalidValueError(f"cost of {name}", cost.tolist(), "finite and not negative")
        if not (np.isfinite(e).all() and np.isfinite(J).all()):
            raise InvalidValueError(f"error and Jacobian of {name}", "NaN", "finite")
        return
    H, c = _tried(name, lambda: tuple(task.compute_qp_objective(configuration)))
    if np.shape(H) != (nv, nv) or np.shape(c) != (nv,):
        found = f"{np.shape(H)} and {np.shape(c)}"
        raise InvalidValueError(f"H and c of {name}", found, f"({nv}, {nv}) and ({nv},)")
    if not (np.isfinite(H).all() and np.isfinite(c).all()):
        raise InvalidValueError(f"H and c of {name}", "NaN", "finite")


def _check_limit(configuration: mink.Configuration, name: str, limit: mink.Limit) -> None:
    nv = configuration.nv
    G, h = _tried(name, lambda: tuple(limit.compute_qp_inequalities(configuration, 1.0)))
    joints = getattr(limit, "indices", None)
    if G is None and h is None and (joints is None or len(joints)):
        # Rows may be needed elsewhere only.
        return
    if G is None or h is None or np.size(h) == 0:
        raise InvalidValueError(f"limit {name}", "no rows", "one with rows G dq <= h")
    if np.ndim(G) != 2 or np.shape(G)[1] != nv or np.shape(h) != (np.shape(G)[0],):
        found = f"{np.shape(G)} and {np.shape(h)}"
        raise InvalidValueError(f"G and h of limit {name}", found, f"(k, {nv}) and (k,)")
    if not np.isfinite(G).all() or np.isnan(h).any():
        raise InvalidValueError(f"G and h of limit {name}", "NaN", "finite")


def _tried(name: str, compute: Callable[[], Any]) -> Any:
    try:
        return compute()
    except mink.InvalidFrame as error:
        raise InvalidValueError(name, str(error), "one of a frame of the arm's model") from error
    except (mink.MinkError, ValueError, IndexError, AttributeError, TypeError) as error:
        raise InvalidValueError(name, str(error), "one that can be evaluated at home") from error
