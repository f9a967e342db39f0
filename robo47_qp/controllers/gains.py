"""Gains: what every setting of a controller must be."""

import numpy as np

from robo47_qp.arrays import frozen_vector
from robo47_qp.errors import InvalidValueError

_NOT_NEGATIVE = "finite and not negative"


def check_not_negative(settings: object, *names: str) -> None:
    """Check gains that are numbers, or a few of them.

    Args:
        settings: Whose fields they are.
        names: The fields.

    Raises:
        InvalidValueError: One is negative or not finite.
    """
    for name in names:
        value = getattr(settings, name)
        numbers = np.asarray(value, dtype=np.float64)
        if not (np.isfinite(numbers) & (numbers >= 0.0)).all():
            raise InvalidValueError(name, value, _NOT_NEGATIVE)


def freeze_not_negative(settings: object, *names: str, size: int) -> None:
    """Check gains that are vectors, and put copies that cannot be written to in their place.

    Args:
        settings: A frozen dataclass in its making.
        names: The fields.
        size: How many numbers each has.

    Raises:
        InvalidValueError: One has another shape, or a number that is negative or not finite.
    """
    for name in names:
        values = frozen_vector(name, getattr(settings, name), size)
        if (values < 0.0).any():
            raise InvalidValueError(name, values.tolist(), f"{size} numbers, none negative")
        object.__setattr__(settings, name, values)
