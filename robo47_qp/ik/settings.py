"""Checks of the settings that solvers share."""

from math import isfinite
from operator import index

from robo47_qp.errors import InvalidValueError


def check_steps(name: str, value: object) -> None:
    """Check a number of steps.

    Raises:
        InvalidValueError: It is no whole number, or negative.
    """
    try:
        good = index(value) >= 0  # type: ignore[arg-type]
    except TypeError:
        good = False
    if not good:
        raise InvalidValueError(name, value, "a whole number, 0 or more")


def check_weight(name: str, value: float) -> None:
    """Check a damping or a cost.

    Raises:
        InvalidValueError: It is negative or not finite.
    """
    if not (isfinite(value) and value >= 0.0):
        raise InvalidValueError(name, value, "finite, 0 or more")
