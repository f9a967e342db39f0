"""The protocol of IK solvers, their result, and how it is judged by forward kinematics."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from math import degrees
from time import process_time
from typing import Any, NamedTuple, Protocol, TypeAlias, TypeGuard, TypeVar, runtime_checkable

import numpy as np
from mink import SE3
from numpy.typing import ArrayLike

from robo47_qp.arrays import Checked, Longest, Vector
from robo47_qp.collision.clearance import ClosestPair, closest_pair, too_close_text
from robo47_qp.errors import InvalidValueError
from robo47_qp.ik.tool_demand import FULL, ToolDemand, check_demand
from robo47_qp.ik.tool_error import tools_of
from robo47_qp.model.arm import Arm
from robo47_qp.model.tool_poses import Target, ToolPoses

_FAR = 1e9
"""Targets further away than this are refused: squares lose their precision [m]."""


@dataclass(frozen=True, kw_only=True)
class Tolerance(Checked):
    """How close counts as reached."""

    position: Longest = 1e-6
    """[m]"""
    orientation: Longest = 1e-6
    """[rad]; infinite where the orientation does not matter."""
    demand: ToolDemand = FULL
    """What of the tool's pose counts."""

    def __post_init__(self) -> None:
        """Check the settings.

        Raises:
            InvalidValueError: A number is not above 0, or the demand is none.
        """
        super().__post_init__()
        check_demand(self.demand)


def only_full(tolerance: Tolerance, solver: str) -> None:
    """Check that a tolerance asks for the whole pose, for solvers that know nothing else.

    Raises:
        InvalidValueError: It asks for a part of it.
    """
    if tolerance.demand != FULL:
        expected = f"FULL with {solver}; MinkIk, LmIk and DlsIk take others"
        raise InvalidValueError("demand", tolerance.demand, expected)


class Reason(Enum):
    """Why a target was not reached."""

    INVALID_TARGET = "invalid target"
    OUT_OF_REACH = "out of reach"
    JOINT_LIMITS = "outside joint limits"
    NOT_CONVERGED = "not converged"
    COLLISION = "collision"


_TOOL = 1.0
"""Largest distance of a point of the tool from the tool frame [m]."""


class ReachEvidence(Enum):
    """How it is known that a target is out of reach."""

    STRETCHED = "the length of the stretched arm"
    """No configuration reaches that far, whatever the joint limits."""
    SEARCH = "the closest position found"
    """The tool came no closer in any search, without regard to its orientation."""


@dataclass(frozen=True, kw_only=True, eq=False)
class IkResult:
    """The configuration a solver ended at, judged by forward kinematics."""

    q: Vector
    """Configuration (n,) [rad]; the best one found where the target was not reached."""
    reason: Reason | None
    """Why the target was not reached; None where it was."""
    explanation: str
    """The reason in words with its numbers; empty where the target was reached."""
    position_error: float
    """Distance of the tool from the target [m]."""
    orientation_error: float
    """Angle between the tool and the target [rad]."""
    limit_margin: float
    """Distance of the joint closest to its limit; negative outside [rad or m]."""
    iterations: int
    """Steps taken, over all starts."""
    restarts: int = 0
    """Starts after the first."""
    seconds: float = 0.0
    """Processor time spent."""
    beyond_reach: float = 0.0
    """How far the target is out of reach [m]; 0 for any other reason."""
    bound: ReachEvidence | None = None
    """How that is known; None for any other reason."""
    relaxed: tuple[tuple[str, int], ...] = ()
    """What gave way on the way here, and in how many steps: limits and constraints of a user."""
    joints: tuple[str, ...] = ()
    """Joints that are outside their limits, or would have to be; empty for any other reason."""
    clearance: float | None = None
    """Smallest distance of the arm from itself and its obstacles, negative where they overlap
    [m]; None where it was not requested, or the target was not reached."""
    pair: tuple[str, str] | None = None
    """The two that are that close, bodies of the robot or obstacles; None with `clearance`."""
    inevitable: bool = False
    """True where no other configuration can help: at the target pose the tool itself is too
    close to something that stands still."""

    @property
    def converged(self) -> bool:
        """True where the target was reached inside the joint limits."""
        return self.reason is None

    @property
    def error(self) -> float:
        """Distance and angle together [m + rad]."""
        return self.position_error + self.orientation_error

    def with_effort(self, *, iterations: int, restarts: int, seconds: float) -> "IkResult":
        """Return the same result with the effort of a whole search."""
        result = object.__new__(IkResult)
        # As `dataclasses.replace`, but for setting each field anew: a tenth of the time.
        result.__dict__.update(
            self.__dict__, iterations=iterations, restarts=restarts, seconds=seconds
        )
        return result


class IkSolver(Protocol):
    """Finds a configuration that puts the tool at a pose. The solver is its settings."""

    @property
    def tolerance(self) -> Tolerance:
        """How close counts as reached."""
        ...

    def solve(self, arm: Arm, T_world_target: Target, q_seed: Vector) -> IkResult:
        """Search from q_seed; a target that is not reached is a result, never an exception.

        Args:
            arm: The arm.
            T_world_target: Wanted T_world_tcp of the main tool, or poses of several tools.
            q_seed: Where to start (n,) [rad]; among answers, a close one is preferred.

        Raises:
            InvalidValueError: `q_seed` is not a finite vector of shape (n,).
            UnknownNameError: The target names a tool that the robot does not have.
        """
        ...


@runtime_checkable
class EarlyStopping(Protocol):
    """A solver that stops early, with a variant that searches longer."""

    def thorough(self) -> IkSolver:
        """Return the variant that searches longer."""
        ...


@runtime_checkable
class Extensible(Protocol):
    """A solver that takes objectives and demands of a user, or hands them on to one that does."""

    def composed(
        self, objectives: Sequence[Any] = (), demand: ToolDemand | None = None
    ) -> IkSolver:
        """Return the solver with further objectives, and with another demand where one is given.

        Raises:
            InvalidValueError: The solver that they are handed on to takes none.
        """
        ...


@runtime_checkable
class Composing(Extensible, Protocol):
    """A solver that takes objectives and demands of a user itself."""

    def start(self, arm: Arm, q_start: Vector, q_seed: Vector) -> Vector:
        """Return where to start in place of q_start: joints that are held stay at the seed (n,)."""
        ...

    def explained(self, arm: Arm, T_world_target: Target, result: IkResult) -> IkResult:
        """Return a result with what of the user's demands gave way, or is not reached."""
        ...


def composed_ik(
    ik: IkSolver, objectives: Sequence[Any] = (), demand: ToolDemand | None = None
) -> IkSolver:
    """Return a solver with further objectives, and with another demand where one is given.

    Raises:
        InvalidValueError: The solver takes none.
    """
    if not objectives and demand is None:
        return ik
    if isinstance(ik, Extensible):
        return ik.composed(objectives, demand)
    raise InvalidValueError(
        "objectives and demand of a waypoint",
        f"given to {type(ik).__name__}",
        "left out with this solver; MinkIk takes them",
    )


def judged(
    arm: Arm,
    T_world_target: Target,
    q: ArrayLike,
    tolerance: Tolerance,
    iterations: int,
    started: float | None = None,
    asked: float | None = None,
) -> IkResult:
    """Return the result of a solver that stopped at q, whatever the solver itself reports.

    Args:
        arm: The arm.
        T_world_target: Wanted T_world_tcp; of several tools the largest errors count.
        q: Where the solver stopped (n,) [rad].
        tolerance: How close counts as reached.
        iterations: Steps taken.
        started: When the solver began, by `time.process_time` [s]; None leaves time out.
        asked: Clearance that an answer must have [m]; None leaves collisions out.
    """
    q = np.array(q, dtype=np.float64)
    position_error, orientation_error = tolerance.demand.distance(arm, T_world_target, q)
    margin = arm.limit_margin(q)
    reason: Reason | None = None
    explanation, beyond = "", 0.0
    bound: ReachEvidence | None = None
    joints: tuple[str, ...] = ()
    near: ClosestPair | None = None
    if position_error <= tolerance.position and orientation_error <= tolerance.orientation:
        if margin < 0.0:
            reason, explanation = Reason.JOINT_LIMITS, outside_limits(arm, q)
            joints = joints_outside(arm, q)
        if asked is not None:
            leeway = tolerance.position + _TOOL * tolerance.orientation
            placed = tools_of(arm, T_world_target) if tolerance.demand == FULL else ()
            near = closest_pair(arm, q, asked, leeway, placed)
            if reason is None and near.distance < asked:
                reason, explanation = Reason.COLLISION, too_close_text(near, asked)
    else:
        beyond = arm.target_beyond_reach(T_world_target) if tolerance.demand.position else 0.0
        if beyond > 0.0:
            reason, bound = Reason.OUT_OF_REACH, ReachEvidence.STRETCHED
            explanation = f"the target is {beyond:.3f} m beyond the reach of the arm"
        else:
            reason = Reason.NOT_CONVERGED
            explanation = residual(position_error, orientation_error, iterations)
    return IkResult(
        q=q,
        reason=reason,
        explanation=explanation,
        position_error=position_error,
        orientation_error=orientation_error,
        limit_margin=margin,
        iterations=iterations,
        seconds=0.0 if started is None else process_time() - started,
        beyond_reach=beyond,
        bound=bound,
        joints=joints,
        clearance=None if near is None else near.distance,
        pair=None if near is None else near.pair,
        inevitable=near is not None and near.inevitable,
    )


def rejected(arm: Arm, q_seed: Vector) -> IkResult:
    """Return the result for a target that is not a pose: NaN, infinite, no unit quaternion."""
    return IkResult(
        q=q_seed.copy(),
        reason=Reason.INVALID_TARGET,
        explanation="the target, a mink.SE3, is not a finite pose with a unit quaternion",
        position_error=float("nan"),
        orientation_error=float("nan"),
        limit_margin=arm.limit_margin(q_seed),
        iterations=0,
    )


def is_target(T_world_target: object) -> bool:
    """Return whether it is a pose, see `is_pose`, or such poses of several tools."""
    if isinstance(T_world_target, ToolPoses):
        return all(map(is_pose, T_world_target.values()))
    return is_pose(T_world_target)


def is_pose(T_world_target: object) -> TypeGuard[SE3]:
    """True for an SE3 within 1e9 m whose quaternion has unit length within 1e-6."""
    if not isinstance(T_world_target, SE3):
        return False
    pose = T_world_target.wxyz_xyz
    if pose.shape != (7,) or not abs(pose[:4].dot(pose[:4]) - 1.0) < 2e-6:
        return False
    x, y, z = pose[4:].tolist()
    return bool(abs(x) <= _FAR and abs(y) <= _FAR and abs(z) <= _FAR)


def residual(position_error: float, orientation_error: float, iterations: int) -> str:
    """Return the remaining pose error in words."""
    return (
        f"{1e3 * position_error:.3g} mm and {degrees(orientation_error):.3g}° remain "
        f"after {iterations} iterations"
    )


def joints_outside(arm: Arm, q: Vector) -> tuple[str, ...]:
    """Return the names of the joints outside their limits at q."""
    outside = (q < arm.q_min) | (q > arm.q_max)
    return tuple(arm.robot.joints[i] for i in np.flatnonzero(outside))


def outside_limits(arm: Arm, q: Vector) -> str:
    """Return each joint outside its limits at q, in words."""
    beyond = np.maximum(arm.q_min - q, q - arm.q_max)
    return ", ".join(
        f"{arm.robot.joints[i]} is {beyond[i]:.3f} {arm.robot.units[i]} outside "
        f"[{arm.q_min[i]:.3f}, {arm.q_max[i]:.3f}]"
        for i in np.flatnonzero(beyond > 0.0)
    )


Ended = TypeVar("Ended", "IkResult", "IkResult | Unconverged")


def unwound(arm: Arm, result: Ended, q_seed: Vector) -> Ended:
    """Return a result with its configuration as `Arm.unwound` has it, close to the seed."""
    q = arm.unwound(result.q, q_seed)
    if q is result.q or np.array_equal(q, result.q):
        return result
    if isinstance(result, Unconverged):
        return result._replace(q=q)
    return replace(result, q=q, limit_margin=arm.limit_margin(q))


class Unconverged(NamedTuple):
    """The end of a search that did not converge to a target within reach; not judged."""

    q: Vector
    """Configuration (n,) [rad]."""
    iterations: int
    """Steps taken."""
    error: float
    """Distance and angle to the target together [m + rad]."""


Attempt: TypeAlias = Callable[[Vector], IkResult | Unconverged]
"""A search for one pose from a start (n,)."""
MakeAttempts: TypeAlias = Callable[[Arm, Target], Attempt]
"""A solver's method `attempts`, where it has one: for an arm and a target that is a pose, what
its `solve` does from each start, but a failure need not be judged."""


def attempts_of(solver: IkSolver, arm: Arm, T_world_target: Target) -> Attempt:
    """Return what a solver does from each start: its `attempts`, or else its `solve`."""
    attempts: MakeAttempts | None = getattr(solver, "attempts", None)
    if attempts is None:
        return partial(solver.solve, arm, T_world_target)
    return attempts(arm, T_world_target)
