"""What hypothesis draws: configurations, the corners of the joint ranges included."""

import numpy as np
from hypothesis import strategies as st
from mink import SE3, SO3

from robo47_qp.arrays import Vector

_JOINTS = 8


def vectors(low: float, high: float, size: int = _JOINTS) -> st.SearchStrategy[Vector]:
    """Vectors of numbers from low to high; some, many or all of them at 0 or at an end.

    One number is drawn and seeds the rest: to draw each by itself takes longer than most tests.
    """
    marked = np.unique(np.clip([low, 0.0, high], low, high))

    def vector(seed: int) -> Vector:
        rng = np.random.default_rng(seed)
        is_marked = rng.random(size) < rng.choice([0.1, 0.4, 1.0], p=[0.6, 0.3, 0.1])
        return np.where(is_marked, rng.choice(marked, size), rng.uniform(low, high, size))

    return st.integers(0, 2**32 - 1).map(vector)


fractions = vectors(0.0, 1.0)
"""Where each joint is in its range, 0 and 1 included; see `PlainArm.at`."""

inner_fractions = vectors(0.1, 0.9)
"""The same, away from the limits."""

rates = vectors(-2.0, 2.0)
"""Joint velocities [rad/s] or accelerations [rad/s²]."""

rotations = (
    vectors(-1.0, 1.0, 4)
    .filter(lambda wxyz: bool(np.linalg.norm(wxyz) > 0.1))
    .map(lambda wxyz: SO3(wxyz / np.linalg.norm(wxyz)))
)
"""Rotations, half turns and quaternions with w < 0 among them."""

poses = st.builds(SE3.from_rotation_and_translation, rotations, vectors(-1.0, 1.0, 3))
"""Poses within a metre, in reach or not."""


def turned(pose: SE3, axis: int, angle: float) -> SE3:
    """The pose turned about one of its own axes."""
    half = angle / 2
    wxyz = np.zeros(4)
    wxyz[0], wxyz[1 + axis] = np.cos(half), np.sin(half)
    return pose @ SE3.from_rotation(SO3(wxyz))


def shifted(pose: SE3, by: Vector) -> SE3:
    """The pose moved along the axes of the world."""
    return SE3.from_rotation_and_translation(pose.rotation(), pose.translation() + by)
