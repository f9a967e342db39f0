"""Random positions on a table with a least distance between them."""

import numpy as np

from robo47_qp.errors import InvalidValueError

_STARTS, _TRIES = 20, 100
"""Number of restarts, and of draws per position."""

Area = tuple[tuple[float, float], tuple[float, float]]
"""Ranges of x and y [m]."""


def random_places(
    rng: np.random.Generator,
    area: Area,
    count: int,
    apart: float,
    clear: tuple[np.ndarray, float] | None = None,
) -> np.ndarray:
    """Draw positions in an area uniformly; those too close to another are drawn again.

    Args:
        rng: Source of randomness.
        area: Ranges of x and y [m].
        count: Number of positions.
        apart: Least distance between two of them [m].
        clear: A point (2,) to keep away from, and the distance to it [m].

    Returns:
        Positions (count, 2) [m].

    Raises:
        InvalidValueError: There is no room for so many.
    """
    kept = [] if clear is None else [clear]
    for _ in range(_STARTS):
        places: list[np.ndarray] = []
        for _ in range(_TRIES * count):
            place = np.array([rng.uniform(*limits) for limits in area])
            taken = [*kept, *((other, apart) for other in places)]
            if all(np.linalg.norm(place - other) >= least for other, least in taken):
                places.append(place)
            if len(places) == count:
                return np.array(places)
    raise InvalidValueError(f"places in {area} at least {apart} m apart", count, "fewer")
