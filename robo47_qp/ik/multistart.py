"""Restarts around any IK solver."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from time import process_time

import numpy as np
from mink import SE3

from robo47_qp.arm import Arm
from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.ik.diagnosis import diagnosed
from robo47_qp.ik.library import feature_of, library_of
from robo47_qp.ik.preference import Preference
from robo47_qp.ik.solver import Hasty, IkResult, IkSolver, Reason, Tolerance, is_pose

_HOPELESS = (Reason.INVALID_TARGET, Reason.OUT_OF_REACH)
_DIAGNOSES = 8
"""Starts of a diagnosis."""
_SECOND_LOOKS = (10, 20, 40)
"""After so many starts, the closest ends are taken up again by a more patient search: near a
singularity the error falls too slowly for one that gives up early."""
_ENDS = 4
"""Ends that are taken up again."""
_CLOSE = 0.05
"""Error at which an end is worth it [m + rad]."""
_SAME = 0.05
"""Ends closer to one another than this are one [rad or m]."""


@dataclass(frozen=True, kw_only=True)
class MultiStart:
    """Try the seed, then the nearest of a library of configurations, then others of it.

    The library spreads configurations evenly over the joint limits; those whose tool poses
    are nearest to the target go first, then the rest in their order. The budget is counted
    in starts of the solver inside, not in time: the same question has the same answer.
    """

    solver: IkSolver
    """What runs from each start; best with few iterations and a stall test of its own."""
    max_restarts: int = 100
    """Starts after the first before giving up."""
    seed_first: bool = True
    """Start from the seed; without it, the nearest of the library goes first, which is faster
    for targets far from the seed and forgets where the arm is."""
    library: int = 3000
    """Configurations to choose from."""
    near: int = 40
    """Starts chosen for their nearness, before those chosen for their spread."""
    answers: int = 1
    """Answers to collect, where there are so many, before the preferred one is taken."""
    apart: float = 0.3
    """Two answers differ where a joint differs by this [rad or m]."""
    preference: Preference = Preference()

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: A count is too small.
        """
        for name, least in (("max_restarts", 0), ("library", 1), ("near", 1), ("answers", 1)):
            if getattr(self, name) < least:
                raise InvalidValueError(name, getattr(self, name), f"{least} or more")

    @property
    def tolerance(self) -> Tolerance:
        """How close counts as reached."""
        return self.solver.tolerance

    def solve(self, arm: Arm, T_world_target: SE3, q_seed: Vector) -> IkResult:
        """See `IkSolver.solve`; where no start gets there, the best one with the reason."""
        return self.solve_all(arm, T_world_target, q_seed)[0]

    def solve_all(self, arm: Arm, T_world_target: SE3, q_seed: Vector) -> tuple[IkResult, ...]:
        """Up to `answers` answers that differ, the preferred one first.

        Effort and time are those of the whole search.

        Returns:
            At least one result; a single one that tells the reason where there is no answer.

        Raises:
            InvalidValueError: `q_seed` is not a finite vector of shape (n,).
        """
        started = process_time()
        tally = _Tally(self.answers, self.apart)
        for q_start in islice(self._starts(arm, T_world_target, q_seed), self.max_restarts + 1):
            tally.starts += 1
            if tally.take(self.solver.solve(arm, T_world_target, q_start)):
                break
            if tally.starts in _SECOND_LOOKS and isinstance(self.solver, Hasty):
                patient = self.solver.patient()
                if any(tally.take(patient.solve(arm, T_world_target, q)) for q in tally.ends()):
                    break
        iterations, restarts = tally.iterations, tally.starts - 1
        found = tally.found
        if not found and tally.best is not None:
            best = replace(tally.best, iterations=iterations, restarts=restarts)
            starts = list(islice(self._starts(arm, T_world_target, q_seed), _DIAGNOSES))
            found = [diagnosed(arm, T_world_target, best, starts, self.tolerance)]
        ranked = self.preference.ranked(arm, found, q_seed)
        seconds = process_time() - started
        return tuple(
            replace(result, iterations=iterations, restarts=restarts, seconds=seconds)
            for result in ranked
        )

    def _starts(self, arm: Arm, T_world_target: SE3, q_seed: Vector) -> Iterator[Vector]:
        """The seed in its place, the nearest of the library, then all others in their order."""
        known = is_pose(T_world_target)
        if self.seed_first or not known:
            yield q_seed
        if not known:
            return
        library, target = library_of(arm, self.library), feature_of(T_world_target)
        distances = library.distances(target)
        first = int(distances.argmin())
        if not self.seed_first:
            seed = feature_of(arm.pose(arm.checked_q("q_seed", q_seed)))
            if seed.dot(0.5 * seed - target) <= distances[first]:
                yield q_seed
        yield library.q[first]
        near = library.nearest(distances, min(self.near, len(distances)))
        for k in near[1:]:
            yield library.q[k]
        for k in np.setdiff1d(np.arange(len(distances)), near):
            yield library.q[k]


class _Tally:
    """What the starts have come to so far."""

    def __init__(self, answers: int, apart: float) -> None:
        self._answers, self._apart = answers, apart
        self.starts, self.iterations = 0, 0
        self.found: list[IkResult] = []
        self.best: IkResult | None = None
        self._close: list[IkResult] = []

    def take(self, result: IkResult) -> bool:
        """Count a result; True where no further one is needed, or would help."""
        self.iterations += result.iterations
        if result.converged:
            if all(np.abs(result.q - other.q).max() > self._apart for other in self.found):
                self.found.append(result)
            return len(self.found) == self._answers
        if self.best is None or _rank(result) < _rank(self.best):
            self.best = result
        if result.position_error + result.orientation_error < _CLOSE:
            self._close.append(result)
        return result.reason in _HOPELESS or result.inevitable

    def ends(self) -> list[Vector]:
        """Where the closest of the searches ended since the last call."""
        close = sorted(self._close, key=_rank)
        self._close = []
        ends: list[Vector] = []
        for result in close:
            if all(np.abs(result.q - q).max() > _SAME for q in ends):
                ends.append(result.q)
        return ends[:_ENDS]


def _rank(result: IkResult) -> tuple[bool, float]:
    """How far a result is from an answer: one that is reached but too close comes first."""
    if result.reason is Reason.COLLISION and result.clearance is not None:
        return False, -result.clearance
    return True, result.position_error + result.orientation_error
