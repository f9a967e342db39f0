"""Intervals and tests, against published values and elementary sums."""

from itertools import permutations
from math import comb

import numpy as np
import pytest

from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.statistics import holm, mcnemar, paired_difference, wilson


@pytest.mark.parametrize(
    ("successes", "n", "low", "high"),
    [
        # Newcombe, "Two-sided confidence intervals for the single proportion", Statistics in
        # Medicine 17, 1998, table I, method 3.
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_wilson_gives_the_published_intervals(
    successes: int, n: int, low: float, high: float
) -> None:
    assert wilson(successes, n) == pytest.approx((low, high), abs=6e-5)


def test_wilson_is_the_formula() -> None:
    z = 1.959963984540054
    for successes, n in ((3, 7), (1000, 1000), (9979, 10000)):
        p = successes / n
        centre = (p + z**2 / (2 * n)) / (1 + z**2 / n)
        half = z / (1 + z**2 / n) * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
        assert wilson(successes, n) == pytest.approx((centre - half, centre + half), abs=1e-12)


@pytest.mark.parametrize(("successes", "n"), [(0, 0), (3, 2), (-1, 4)])
def test_rates_of_nothing_are_refused(successes: int, n: int) -> None:
    with pytest.raises(InvalidValueError, match=f"{successes} of {n}"):
        wilson(successes, n)


@pytest.mark.parametrize(("only_a", "only_b"), [(0, 0), (1, 0), (3, 9), (9, 3), (5, 5), (0, 24)])
def test_mcnemar_is_a_fair_coin(only_a: int, only_b: int) -> None:
    a = np.array([True] * (only_a + 4) + [False] * (only_b + 3))
    b = np.array([False] * only_a + [True] * (4 + only_b) + [False] * 3)
    n, least = only_a + only_b, min(only_a, only_b)
    tail = sum(comb(n, k) for k in range(least + 1)) / 2**n
    found = mcnemar(a, b)
    assert found[:2] == (only_a, only_b)
    assert found[2] == pytest.approx(min(1.0, 2 * tail))


def test_holm_gives_a_worked_example_in_any_order() -> None:
    # By hand: 4 × 0.005, 3 × 0.011, 2 × 0.02, then no less than the one before.
    worked = {0.005: 0.02, 0.011: 0.033, 0.02: 0.04, 0.04: 0.04}
    for p in permutations(worked):
        assert holm(p) == pytest.approx([worked[one] for one in p])
    assert holm([0.9, 0.8]) == [1.0, 1.0]
    assert holm([]) == []


def test_the_paired_difference_is_the_published_one() -> None:
    # Fagerland, Lydersen, Laake, "Recommended tests and confidence intervals for paired binomial
    # proportions", Statistics in Medicine 33, 2014: airway hyper-responsiveness before and after
    # transplantation, 1 and 7 of 21 that changed; Bonett-Price.
    assert paired_difference(1, 7, 21) == pytest.approx((-0.508, -0.013), abs=6e-4)
    low, high = paired_difference(7, 1, 21)
    assert (-high, -low) == pytest.approx(paired_difference(1, 7, 21))


def test_the_paired_difference_stays_in_range_and_shrinks() -> None:
    assert paired_difference(0, 0, 1)[0] >= -1.0
    assert paired_difference(5, 0, 5)[1] <= 1.0
    widths = [np.ptp(paired_difference(n // 10, n // 5, n)) for n in (10, 100, 1000)]
    assert widths == sorted(widths, reverse=True)
    low, high = paired_difference(0, 0, 1000)
    assert low == pytest.approx(-high)
    assert 0.0 < high < 5e-3


@pytest.mark.parametrize(("p_a", "p_b", "n"), [(0.1, 0.1, 20), (0.3, 0.05, 30), (0.02, 0.15, 25)])
def test_the_paired_difference_covers_what_it_promises(p_a: float, p_b: float, n: int) -> None:
    """Over all tables of n trials, each with its chance."""
    covered = 0.0
    for a in range(n + 1):
        for b in range(n + 1 - a):
            chance = comb(n, a) * comb(n - a, b) * p_a**a * p_b**b * (1 - p_a - p_b) ** (n - a - b)
            low, high = paired_difference(a, b, n)
            covered += chance * (low <= p_a - p_b <= high)
    assert 0.94 < covered < 0.99


@pytest.mark.parametrize("table", [(0, 0, 0), (3, 3, 5), (-1, 2, 5)])
def test_a_difference_of_nothing_is_refused(table: tuple[int, int, int]) -> None:
    with pytest.raises(InvalidValueError, match="trials that differ must be 0 or more"):
        paired_difference(*table)
