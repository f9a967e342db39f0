"""A phase continues the last one where the arm follows in the same way, and only there."""

from dataclasses import replace

import numpy as np
import pytest

from robo47_qp.run.phase import Phase

DOWN, UP = np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0])
PLAIN = Phase(name="wait", start=0, leg=None)
PRESSING = replace(PLAIN, axis=DOWN)


@pytest.mark.parametrize(
    ("last", "now", "same"),
    [
        (PLAIN, replace(PLAIN, start=7), True),
        (PLAIN, replace(PLAIN, name="look"), False),
        (PLAIN, replace(PLAIN, compliant=True), False),
        (PLAIN, replace(PLAIN, streamed=True), False),
        (PLAIN, PRESSING, False),
        (PRESSING, PLAIN, False),
        (PRESSING, replace(PLAIN, axis=DOWN.copy()), True),
        (PRESSING, replace(PLAIN, axis=UP), False),
    ],
)
def test_it_continues_what_is_the_same(last: Phase, now: Phase, same: bool) -> None:
    assert now.continues(last) is same
