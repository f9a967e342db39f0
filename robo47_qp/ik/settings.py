"""When a search from one start is given up early."""

from dataclasses import dataclass
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


@dataclass(frozen=True, kw_only=True)
class Stall:
    """A search is stuck once its squared error has hardly fallen over the last steps."""

    steps: int = 3
    """Over how many steps the fall is measured."""
    fall: float = 0.19
    """Share of the squared error that must go in these steps."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: There is no step, or the share is not between 0 and 1.
        """
        if self.steps < 1:
            raise InvalidValueError("stall steps", self.steps, "1 or more")
        if not 0.0 < self.fall < 1.0:
            raise InvalidValueError("stall fall", self.fall, "between 0 and 1")

    def stuck(self, squared_errors: list[float]) -> bool:
        """True where the last of these errors has not fallen as it should."""
        if len(squared_errors) <= self.steps:
            return False
        return squared_errors[-1] > (1.0 - self.fall) * squared_errors[-1 - self.steps]


PATIENT = Stall(steps=10)
"""Gives up late."""
PATIENT_STEPS = 100
"""Steps of a patient search, at least."""
