"""Least squares in a box: scipy's dogbox (Voglis and Lagaris, 2004) for small dense problems."""

from collections.abc import Callable
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robo47_qp.arrays import Matrix, Vector

_POOR, _GOOD = 0.25, 0.75
"""Gains over what was predicted at which the trust region shrinks, and may grow."""
_SMALLEST = 1e-290
"""Part of a way that does not move: a quotient by it might overflow."""


class Ending(NamedTuple):
    """When a search ends."""

    step: float
    """Size of a step, relative to x."""
    gain: float
    """Relative gain of a step, where the gain is as predicted."""
    slope: float
    """Largest slope."""
    evaluations: int
    """Number of evaluations of the error."""


def least_squares(
    error: Callable[[Vector], Vector],
    jacobian: Callable[[Vector], Matrix],
    start: Vector,
    box: tuple[Vector, Vector],
    ending: Ending,
) -> Vector:
    """Return x in a box where the squares of an error have a least sum, as far as slopes lead (n,).

    The same to the bit as `scipy.optimize.least_squares` with the method dogbox, in a fraction of
    its time: nearly all of that goes into what such small problems do not need.

    Args:
        error: e(x) (m,).
        jacobian: de/dx (m, n).
        start: Where to start, in the box (n,).
        box: Smallest and largest x (n,), the largest above the smallest.
        ending: When to end.
    """
    low, high = box
    x, e, J = start, error(start), jacobian(start)
    cost, g = 0.5 * e.dot(e), J.T.dot(e)
    radius = float(np.abs(x).max()) or 1.0
    # Sides of the box on which x is: -1, 0 or 1.
    sides = (x == high).astype(int) - (x == low)
    left = ending.evaluations - 1
    while True:
        free = sides * g >= 0.0
        slope = g[free]
        if left == 0 or np.abs(slope).max(initial=0.0) < ending.slope:
            return x
        local = _Local(x[free], low[free], high[free], J[:, free], e, slope)
        gain, done = -1.0, False
        while gain <= 0.0 and left > 0 and not done:
            step_free, sides_free, cut = local.step(radius)
            step = np.zeros_like(x)
            step[free] = step_free
            x_new = np.minimum(np.maximum(x + step, low), high)
            e_new, left = error(x_new), left - 1
            gain = cost - 0.5 * e_new.dot(e_new)
            ratio = _ratio(gain, local.predicted(step_free))
            if ratio < _POOR:
                radius = _POOR * float(np.abs(step).max())
            elif ratio > _GOOD and cut:
                radius *= 2.0
            done = (gain < ending.gain * cost and ratio > _POOR) or (
                sqrt(step.dot(step)) < ending.step * (ending.step + sqrt(x.dot(x)))
            )
            if gain > 0.0:
                sides[free] = sides_free
                x = np.where(sides == -1, low, np.where(sides == 1, high, x_new))
                e, cost = e_new, 0.5 * e_new.dot(e_new)
                if not done:
                    J = jacobian(x)
                    g = J.T.dot(e)
        if done:
            return x


class _Local:
    """The problem around x, of the joints that are free to move."""

    def __init__(
        self, x: Vector, low: Vector, high: Vector, J: Matrix, e: Vector, g: Vector
    ) -> None:
        self._low, self._high, self._J, self._g = low - x, high - x, J, g
        self._newton = np.linalg.lstsq(J, -e, rcond=-1)[0].astype(float, copy=False)
        v = J.dot(-g)
        self._curve, self._fall = 0.5 * v.dot(v), g.dot(-g)

    def step(self, radius: float) -> tuple[Vector, NDArray[np.int_], bool]:
        """Return a step, the sides that it hits (n,), and whether the radius cuts it off."""
        low, high = np.maximum(self._low, -radius), np.minimum(self._high, radius)
        newton, still = self._newton, np.zeros(len(low), dtype=int)
        if ((newton >= low) & (newton <= high)).all():
            return newton, still, False
        # Down the slope as far as it is worth, and on towards the step of Newton.
        far, _ = _way_to_side(-self._g, low, high)
        down = -self._least(far) * self._g
        onward = newton - down
        share, hits = _way_to_side(onward, low - down, high - down)
        still[(hits < 0) & (low == self._low)] = -1
        still[(hits > 0) & (high == self._high)] = 1
        cut = ((hits < 0) & (low == -radius) | (hits > 0) & (high == radius)).any()
        return down + share * onward, still, bool(cut)

    def _least(self, far: float) -> float:
        """Return where a quadratic along the slope is least, from 0 to `far`."""
        a, b = self._curve, self._fall
        ends = [0.0, far]
        if a != 0.0:
            lowest = -0.5 * b / a
            if 0.0 < lowest < far:
                ends.append(lowest)
        return min(ends, key=lambda t: t * (a * t + b))

    def predicted(self, step: Vector) -> float:
        """Return by how much a step should lower the cost."""
        along = self._J.dot(step)
        return -float(0.5 * along.dot(along) + step.dot(self._g))


def _way_to_side(way: Vector, low: Vector, high: Vector) -> tuple[float, NDArray[np.int_]]:
    """Return how often a way fits into a box around 0, and on which sides it ends (n,)."""
    moves = np.abs(way) > _SMALLEST
    if moves.all():
        often = np.maximum(low / way, high / way)
    else:
        often = np.full(len(way), np.inf)
        often[moves] = np.maximum(low[moves] / way[moves], high[moves] / way[moves])
    least = float(often.min())
    return least, (often == least) * np.sign(way).astype(int)


def _ratio(gain: float, predicted: float) -> float:
    """Return a gain over what was predicted."""
    if predicted > 0.0:
        return gain / predicted
    return 1.0 if predicted == gain == 0.0 else 0.0
