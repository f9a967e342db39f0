"""Inverse and forward kinematics of many poses at once, on all cores."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar, overload

import numpy as np
from mink import SE3
from numpy.typing import ArrayLike, NDArray

from robo47_qp._core.library import backend, functions, pointer
from robo47_qp.arrays import Matrix, OneOf, Range
from robo47_qp.errors import InvalidValueError
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.restarts import Batch
from robo47_qp.ik.solver import IkResult, IkSolver, is_pose
from robo47_qp.model.arm import Arm
from robo47_qp.model.chain import Chain

_T = TypeVar("_T")
_PART = 64
"""Poses that a thread takes at a time."""
_NO_POSE = np.full(7, np.nan)
_UNIT, _NEAR = 1e-6, 1e8
"""What `is_pose` grants beyond doubt: error of the squared length of quaternions, distance [m]."""


class IkResults(Sequence[IkResult]):
    """Results in the order of their targets; each is made when it is looked at."""

    def __init__(
        self,
        batches: Sequence[Batch],
        others: dict[int, IkResult],
        judge: Callable[[Batch, int, int], IkResult],
        n: int,
    ) -> None:
        """Take the batches, and the results that were found one by one, by their places.

        Args:
            batches: Of equal size but for the last one.
            others: Results by the places of their targets.
            judge: Makes the result of a row of a batch, for the target of a place.
            n: Joints.
        """
        self._batches, self._others, self._judge = batches, others, judge
        numbers = [np.zeros((0, 1)), *(batch.answers[:, :1] for batch in batches)]
        self.converged: NDArray[np.bool_] = np.concatenate(numbers)[:, 0] > 0.0
        """Where a target was reached inside the joint limits, as the search found (count,)."""
        self.q: Matrix = np.concatenate([np.zeros((0, n)), *(batch.q for batch in batches)])
        """Configurations (count, n) [rad]; the best one found where a target was not reached."""
        for place, result in others.items():
            self.converged[place], self.q[place] = result.converged, result.q

    def __len__(self) -> int:
        return len(self.converged)

    @overload
    def __getitem__(self, place: int) -> IkResult: ...

    @overload
    def __getitem__(self, place: slice) -> list[IkResult]: ...

    def __getitem__(self, place: int | slice) -> IkResult | list[IkResult]:
        if isinstance(place, slice):
            return [self[i] for i in range(len(self))[place]]
        place = range(len(self))[place]
        batch, row = divmod(place, _PART)
        return self._others.get(place) or self._judge(self._batches[batch], row, place)


def solve_many(
    solver: IkSolver,
    arm: Arm,
    targets: Sequence[SE3],
    q_seeds: ArrayLike | None = None,
    *,
    threads: int | None = None,
) -> IkResults:
    """Solve for many poses of the main tool; answers are those of `solver.solve`, to the bit.

    Searches of a `MultiStart` that are all in the compiled core (see docs/backend.md) run on
    several threads. All other solvers, and targets that no start reaches, take their turn.

    Args:
        solver: What solves for each pose.
        arm: The arm.
        targets: Wanted T_world_tcp.
        q_seeds: Where each search starts (count, n), or one configuration for all (n,) [rad];
            by default the home configuration.
        threads: By default one for each processor at hand.

    Returns:
        The results in the order of the targets. `seconds` is 0 where threads shared the work.

    Raises:
        InvalidValueError: The seeds are no finite numbers of that shape, or `threads` is below 1.
    """
    workers = _workers(threads)
    seeds = _seeds(arm, q_seeds, len(targets))
    poses = _poses(targets)
    batches = [Batch(poses[part], seeds[part]) for part in _parts(len(targets), _PART)]
    # Answers of joints with a turn or more are wound to their seeds, one by one.
    whole = None
    if isinstance(solver, MultiStart) and not arm.winds:
        whole = solver.whole(arm)
    if whole is not None:
        _each(whole.solve_batch, batches, workers)
    left = [
        _PART * i + int(row)
        for i, batch in enumerate(batches)
        for row in np.flatnonzero(batch.answers[:, 0] == 0.0)
    ]
    others = {place: solver.solve(arm, targets[place], seeds[place]) for place in left}

    def judge(batch: Batch, row: int, place: int) -> IkResult:
        found = None if whole is None else whole.judged(batch, row, targets[place])
        return found or solver.solve(arm, targets[place], seeds[place])

    return IkResults(batches, others, judge, arm.n)


def fk_many(
    arm: Arm, q: ArrayLike, tool: int = 0, *, threads: int | None = None
) -> NDArray[np.float64]:
    """Return T_world_tcp of a tool at many configurations, as matrices (count, 4, 4).

    Args:
        arm: The arm.
        q: Configurations (count, n) [rad].
        tool: Place of the tool among the robot's.
        threads: By default one for each processor at hand.

    Raises:
        InvalidValueError: q is no array of finite numbers of that shape, `threads` is below 1, or
            the robot has no such tool.
    """
    workers = _workers(threads)
    q = _rows(arm, "q", q)
    OneOf(tuple(range(len(arm.robot.tools)))).check("tool", tool)
    T = np.empty((len(q), 4, 4))
    if backend() == "numpy":
        for row, configuration in zip(T, q, strict=True):
            row[:] = arm.pose(configuration, tool).as_matrix()
        return T
    chain = arm.derived(Chain)

    def place(part: slice) -> None:
        many = functions().r47_frame_many
        own = q[part]
        many(chain.structure.pointer, tool, len(own), pointer(own), pointer(T[part]))

    _each(place, _parts(len(q), _PART * 16), workers)
    return T


def _each(work: Callable[[_T], None], parts: Sequence[_T], workers: int) -> None:
    """Work on every part, on as many threads; functions of the core release Python's lock."""
    rest = iter(parts)

    def take() -> None:
        for part in rest:
            work(part)

    if workers == 1 or len(parts) < 2:
        take()
        return
    with ThreadPoolExecutor(min(workers, len(parts))) as pool:
        for taken in [pool.submit(take) for _ in range(workers)]:
            taken.result()


def _parts(count: int, size: int) -> list[slice]:
    return [slice(first, min(first + size, count)) for first in range(0, count, size)]


def _workers(threads: int | None) -> int:
    if threads is None:
        affinity = getattr(os, "sched_getaffinity", None)
        return len(affinity(0)) if affinity else os.cpu_count() or 1
    Range(at_least=1, whole=True).check("threads", threads)
    return threads


def _poses(targets: Sequence[SE3]) -> Matrix:
    """Return quaternions and positions (count, 7), of NaN where `is_pose` says no."""
    given = [t.wxyz_xyz if isinstance(t, SE3) else _NO_POSE for t in targets]
    poses = np.array([p if len(p) == 7 else _NO_POSE for p in given], np.float64).reshape(-1, 7)
    sizes = np.einsum("ij,ij->i", poses[:, :4], poses[:, :4])
    fine = (np.abs(sizes - 1.0) < _UNIT) & (np.abs(poses[:, 4:]) < _NEAR).all(axis=1)
    for place in np.flatnonzero(~fine).tolist():
        if not is_pose(targets[place]):
            poses[place] = np.nan
    return poses


def _seeds(arm: Arm, q_seeds: ArrayLike | None, count: int) -> Matrix:
    expected = f"finite numbers of shape (count, {arm.n}) or ({arm.n},)"
    given = _numbers("q_seeds", arm.home if q_seeds is None else q_seeds, expected)
    seeds = _rows(arm, "q_seeds", np.tile(given, (count, 1)) if given.ndim == 1 else given)
    if len(seeds) != count:
        expected = f"one configuration, or one for each of {count} targets"
        raise InvalidValueError("q_seeds", f"{len(seeds)} configurations", expected)
    return seeds


def _rows(arm: Arm, name: str, q: ArrayLike) -> Matrix:
    expected = f"finite numbers of shape (count, {arm.n})"
    rows = _numbers(name, q, expected)
    if rows.ndim != 2 or rows.shape[1] != arm.n:
        raise InvalidValueError(name, f"shape {rows.shape}", expected)
    if not np.isfinite(rows).all():
        raise InvalidValueError(name, "NaN or infinite", expected)
    return rows


def _numbers(name: str, values: ArrayLike, expected: str) -> Matrix:
    try:
        return np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidValueError(name, repr(values), expected) from error
