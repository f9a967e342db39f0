"""Array types, and the check that every array from outside passes."""

from math import isfinite
from typing import TypeAlias

import numpy as np
from mink import SE3
from numpy.typing import ArrayLike, NDArray

from robo47_qp.errors import InvalidValueError

Vector: TypeAlias = NDArray[np.float64]
Matrix: TypeAlias = NDArray[np.float64]


def checked_vector(name: str, value: ArrayLike, size: int) -> Vector:
    """Copy `value` into a new float vector of shape (size,).

    Raises:
        InvalidValueError: Wrong shape, not a number, NaN or infinite.
    """
    expected = f"a vector of {size} finite numbers"
    try:
        vector = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidValueError(name, repr(value), expected) from error
    if vector.shape != (size,):
        raise InvalidValueError(name, f"shape {vector.shape}", expected)
    if not all(map(isfinite, vector.tolist())):
        raise InvalidValueError(name, vector.tolist(), expected)
    return vector


def frozen_vector(name: str, value: ArrayLike, size: int) -> Vector:
    """Like `checked_vector`, and the result cannot be written to."""
    vector = checked_vector(name, value, size)
    vector.setflags(write=False)
    return vector


def check_pose(name: str, pose: SE3) -> None:
    """Check that a pose is finite and has a unit quaternion.

    Raises:
        InvalidValueError: It has NaN, or its quaternion is not of length 1.
    """
    numbers = checked_vector(name, pose.wxyz_xyz, 7)
    if abs(np.linalg.norm(numbers[:4]) - 1.0) > 1e-6:
        raise InvalidValueError(name, numbers[:4].tolist(), "a pose with a unit quaternion")
