"""Confidence intervals of rates and of their differences, and exact paired tests."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from robo47_qp.errors import InvalidValueError

CONFIDENCE = 0.95
"""Level of the intervals."""


def wilson(successes: int, n: int) -> tuple[float, float]:
    """Return Wilson's score interval of a rate, 95 %.

    Raises:
        InvalidValueError: There are no trials, or more successes than trials.
    """
    if n < 1 or not 0 <= successes <= n:
        raise InvalidValueError("successes of n", f"{successes} of {n}", "0..n of n >= 1")
    # Imported where it is needed: the processes of an evaluation start without it.
    from scipy.stats import binomtest

    interval = binomtest(successes, n).proportion_ci(CONFIDENCE, method="wilson")
    return float(interval.low), float(interval.high)


def mcnemar(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> tuple[int, int, float]:
    """Return McNemar's exact test of two methods on the same trials.

    Returns:
        Number of trials that only a and only b solved, and the two-sided p-value: the probability
        of a split at least as uneven if both were equally good.
    """
    only_a, only_b = int((a & ~b).sum()), int((b & ~a).sum())
    split = only_a + only_b
    from scipy.stats import binomtest

    p = 1.0 if split == 0 else float(binomtest(only_a, split, 0.5).pvalue)
    return only_a, only_b, p


def paired_difference(only_a: int, only_b: int, n: int) -> tuple[float, float]:
    """Return the interval of the rate of a less that of b on the same n trials, 95 %.

    Bonett and Price's adjusted Wald interval (J. Educ. Behav. Stat. 37, 2012, eq. 4),
    which adds one discordant trial of each kind.

    Raises:
        InvalidValueError: There are no trials, or more that only one solved than n.
    """
    if n < 1 or min(only_a, only_b) < 0 or only_a + only_b > n:
        found = f"{only_a} and {only_b} of {n}"
        raise InvalidValueError("trials that differ", found, "0 or more, together at most n")
    a, b = (only_a + 1) / (n + 2), (only_b + 1) / (n + 2)
    from scipy.stats import norm

    z = float(norm.ppf(0.5 + 0.5 * CONFIDENCE))
    half = z * float(np.sqrt((a + b - (a - b) ** 2) / (n + 2)))
    return max(-1.0, a - b - half), min(1.0, a - b + half)


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p-values after Holm's step-down correction (Scand. J. Statist. 6, 1979)."""
    p = np.asarray(p_values, dtype=np.float64)
    order = np.argsort(p, kind="stable")
    stepped = p[order] * np.arange(len(p), 0, -1)
    corrected = np.empty_like(p)
    corrected[order] = np.minimum(1.0, np.maximum.accumulate(stepped))
    return [float(value) for value in corrected]
