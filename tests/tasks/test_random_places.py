"""Scattered places keep their distance."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo47_qp.errors import InvalidValueError
from robo47_qp.tasks.random_places import random_places

AREA = ((0.35, 0.60), (-0.20, 0.20))


@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
def test_places_keep_their_distance(seed: int, count: int) -> None:
    rng, clear = np.random.default_rng(seed), np.array([0.35, 0.0])
    places = random_places(rng, AREA, count, 0.1, (clear, 0.12))
    assert places.shape == (count, 2)
    for axis, (low, high) in enumerate(AREA):
        assert (places[:, axis] >= low).all()
        assert (places[:, axis] <= high).all()
    apart = np.linalg.norm(places[:, None] - places, axis=2) + np.eye(count)
    assert apart.min() >= 0.1
    assert np.linalg.norm(places - clear, axis=1).min() >= 0.12
    again = random_places(np.random.default_rng(seed), AREA, count, 0.1, (clear, 0.12))
    np.testing.assert_array_equal(places, again)


def test_places_fill_the_area() -> None:
    rng = np.random.default_rng(0)
    places = np.concatenate([random_places(rng, AREA, 2, 0.1) for _ in range(200)])
    for axis, (low, high) in enumerate(AREA):
        assert places[:, axis].min() < low + 0.02
        assert places[:, axis].max() > high - 0.02


def test_too_many_places_are_refused() -> None:
    with pytest.raises(InvalidValueError, match=r"at least 0.2 m apart must be fewer; found 9"):
        random_places(np.random.default_rng(0), AREA, 9, 0.2)
