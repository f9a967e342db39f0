"""How sure a figure is: intervals of rates, and exact tests between paired solvers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from robo47_qp.errors import InvalidValueError

CONFIDENCE = 0.95
"""Of the intervals."""


def wilson(successes: int, n: int) -> tuple[float, float]:
    """Wilson's score interval of a rate, 95 %.

    Raises:
        InvalidValueError: There are no trials, or more successes than trials.
    """
    if n < 1 or not 0 <= successes <= n:
        raise InvalidValueError("successes of n", f"{successes} of {n}", "0..n of n >= 1")
    interval = binomtest(successes, n).proportion_ci(CONFIDENCE, method="wilson")
    return float(interval.low), float(interval.high)


@dataclass(frozen=True, kw_only=True)
class PairedTest:
    """Two solvers on the same targets: McNemar's exact test on those that only one solved."""

    targets: str
    a: str
    b: str
    only_a: int
    """Targets that a alone solved."""
    only_b: int
    """Targets that b alone solved."""
    p: float
    """Chance of a split at least as uneven, were both equally good; two-sided."""
    p_holm: float
    """The same, corrected for the number of tests (Holm, 1979): the planned ones among
    themselves, the others among all others."""
    planned: bool
    """True for a comparison that was chosen before there were figures."""


def mcnemar(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> tuple[int, int, float]:
    """Targets that only a, and only b, solved, and the exact two-sided p-value."""
    only_a, only_b = int((a & ~b).sum()), int((b & ~a).sum())
    split = only_a + only_b
    p = 1.0 if split == 0 else float(binomtest(only_a, split, 0.5).pvalue)
    return only_a, only_b, p


def holm(p_values: Sequence[float]) -> list[float]:
    """Holm's step-down correction, in the order of the input (Scand. J. Statist. 6, 1979)."""
    p = np.asarray(p_values, dtype=np.float64)
    order = np.argsort(p, kind="stable")
    stepped = p[order] * np.arange(len(p), 0, -1)
    corrected = np.empty_like(p)
    corrected[order] = np.minimum(1.0, np.maximum.accumulate(stepped))
    return [float(value) for value in corrected]
