"""When a search from one start is given up early."""

from dataclasses import dataclass
from typing import Annotated

from robo47_qp.arrays import Checked, Count, Range


@dataclass(frozen=True, kw_only=True)
class Stall(Checked):
    """A search is stuck once its squared error has hardly fallen over the last steps."""

    steps: Count = 3
    """Over how many steps the fall is measured."""
    fall: Annotated[float, Range(above=0.0, below=1.0)] = 0.19
    """Share of the squared error that must go in these steps."""

    def _label(self, field: str) -> str:
        return f"stall {field}"

    def stuck(self, squared_errors: list[float]) -> bool:
        """True where the last of these errors has not fallen as it should."""
        if len(squared_errors) <= self.steps:
            return False
        return squared_errors[-1] > (1.0 - self.fall) * squared_errors[-1 - self.steps]


LATE_STALL = Stall(steps=10)
"""Gives up late."""
THOROUGH_STEPS = 100
"""Steps of a patient search, at least."""
