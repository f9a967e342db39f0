"""Restarts in the compiled core: a whole search from one start after another in one call."""

from typing import Any, NamedTuple

import numpy as np
from mink import SE3
from numpy.typing import NDArray

from robo47_qp._core.library import Structure, functions, pointer
from robo47_qp.arrays import Matrix, Vector
from robo47_qp.ik.descent import CompiledStepper
from robo47_qp.ik.seeds import TURN, SeedLibrary
from robo47_qp.ik.solver import IkResult, judged
from robo47_qp.model.arm import Arm

_NUMBERS = 3
"""`R47_ANSWER`: found, iterations, descents."""


class Looks(NamedTuple):
    """When the closest ends are continued by a more patient descent, and which."""

    after: tuple[int, ...]
    """Numbers of starts."""
    ends: int
    """Most ends at a time."""
    close: float
    """Largest error of an end that is continued [m + rad]."""
    same: float
    """Ends closer than this to one another count as one [rad or m]."""


class Restarts:
    """Searches of one kind on one arm."""

    def __init__(
        self,
        arm: Arm,
        descents: tuple[CompiledStepper, CompiledStepper],
        library: SeedLibrary,
        looks: Looks,
        *,
        starts: int,
        near: int,
        seed_first: bool,
    ) -> None:
        """Take what a search consists of.

        Args:
            arm: The arm.
            descents: From each start, and to continue the closest ends.
            library: Starts after the seed.
            looks: When ends are continued.
            starts: Most starts.
            near: How many of them are chosen for nearness to the target.
            seed_first: False starts from the nearer of the seed and the library's nearest.
        """
        self._arm, self._count, self._tolerance = arm, len(library.q), descents[0].tolerance
        # What the structures of the descents point to stays alive with them.
        self._descents = descents
        self.library = Structure(
            "r47_library",
            count=self._count,
            features=library.feature.shape[1],
            turn=TURN,
            q=library.q,
            feature=np.ascontiguousarray(library.feature.T),
            half_square=library.half_square,
        )
        """The C structure `r47_library`."""
        still = np.flatnonzero(~arm.tool_joints(0)).astype(np.int32)
        self._structure = Structure(
            "r47_restarts",
            descent=descents[0].structure,
            thorough=descents[1].structure,
            library=self.library,
            starts=min(starts, self._count + 1),
            near=min(near, self._count),
            seed_first=int(seed_first),
            looks=len(looks.after),
            look=np.array(looks.after, dtype=np.int32),
            close=looks.close,
            same=looks.same,
            ends=looks.ends,
            stills=len(still),
            still=still,
        )
        self._one = Batch(np.empty((1, 7)), np.empty((1, arm.n)))
        self._call = self._bound(self._one)

    def answer(self, T_world_target: SE3, q_seed: Vector) -> IkResult | None:
        """Return the answer for a pose from a seed (n,); None where no start reaches it."""
        one = self._one
        one.targets[0], one.q_seeds[0] = T_world_target.wxyz_xyz, q_seed
        functions().r47_solve_many(*self._call)
        return self.judged(one, 0, T_world_target)

    def judged(self, batch: "Batch", i: int, T_world_target: SE3) -> IkResult | None:
        """Return answer i of a batch, judged like any other; None where there is none."""
        found, iterations, descents = batch.answers[i].tolist()
        if not found:
            return None
        steps = int(iterations)
        result = judged(self._arm, T_world_target, batch.q[i], self._tolerance, steps)
        if not result.converged:
            return None
        return result.with_effort(iterations=steps, restarts=int(descents) - 1, seconds=0.0)

    def solve_batch(self, batch: "Batch") -> None:
        """Fill the answers of a batch; several threads may do so at once."""
        functions().r47_solve_many(*self._bound(batch))

    def _bound(self, batch: "Batch") -> tuple[object, ...]:
        scratch: NDArray[np.float32] = np.empty(self._count, dtype=np.float32)
        arrays: list[NDArray[Any]] = [batch.targets, batch.q_seeds, scratch, batch.q, batch.answers]
        return self._structure.pointer, len(batch.targets), *map(pointer, arrays)


class Batch:
    """Targets with their seeds, and the answers to them."""

    def __init__(self, targets: Matrix, q_seeds: Matrix) -> None:
        """Take poses (count, 7), quaternion wxyz first, and seeds (count, n)."""
        self.targets, self.q_seeds = targets, q_seeds
        self.q: Matrix = np.empty(q_seeds.shape)
        """Answers (count, n)."""
        self.answers: Matrix = np.zeros((len(targets), _NUMBERS))
        """Whether found, iterations and descents (count, 3)."""
