"""Searches that go on, once the pose is reached, until what is left free is at its best."""

from collections.abc import Sequence

import numpy as np

from robo47_qp.arrays import Vector
from robo47_qp.ik.avoidance import Avoidance
from robo47_qp.ik.gauss_newton import Search, Stall
from robo47_qp.ik.mink_step import LONGEST, MinkStepper, shortened
from robo47_qp.ik.solver import Tolerance
from robo47_qp.model.tool_poses import Target

_STILL = 1e-7
"""A motion that is shorter is none [rad or m]."""
_SETTLING = 60
"""Largest number of motions until the further levels are settled."""
_EXACT = 1e-3
"""Share of the tolerance to which the pose is kept on the way: else it would hide small gains."""
_SAME = 1e-13
"""Values that differ by this share are the same."""


class SettlingSearch(Search[MinkStepper]):
    """A search that goes on, once all is reached, until the further levels are at their best.

    Motions in the freedom that is left, each followed by steps back to the pose, with a trust
    region: what does not make the most important level that changes better is tried shorter.
    """

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
        asked = (tolerance, max_iterations, stall, avoidance)
        steps = super().run(T_world_target, q_seed, *asked)
        added = self.stepper.composed
        if not self.reached or added is None or len(added.levels) == 1:
            return steps
        exact = Tolerance(
            position=_EXACT * tolerance.position,
            orientation=_EXACT * tolerance.orientation,
            demand=tolerance.demand,
        )
        best, end = self.q.copy(), (self.error, self.missed)
        asked = (exact, 10, Stall(), avoidance)
        steps += super().run(T_world_target, best, *asked)
        if self.reached:
            best, end = self.q.copy(), (self.error, self.missed)
        self.stepper.move(best)
        values, longest = self.stepper.values(), LONGEST
        for _ in range(_SETTLING):
            self.stepper.move(best)
            way = shortened(self.stepper.further(np.zeros_like(best)), longest)
            way[[*self.stepper.frozen]] = 0.0
            size = float(np.abs(way).max())
            if size < _STILL:
                break
            steps += 1 + super().run(T_world_target, best + way, *asked)
            self.stepper.move(self.q)
            found = self.stepper.values()
            if self.reached and better(found, values):
                best, values, end = self.q.copy(), found, (self.error, self.missed)
                longest = min(2.0 * longest, LONGEST)
            else:
                longest = 0.25 * size
        self.q[:], self.reached = best, True
        self.error, self.missed = end
        return steps


def better(values: Sequence[float], than: Sequence[float]) -> bool:
    """Return whether the first value that differs is smaller."""
    for value, other in zip(values, than, strict=True):
        if abs(value - other) > _SAME * (1e-6 + abs(other)):
            return value < other
    return False
