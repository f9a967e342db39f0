"""What hypothesis draws: configurations, the corners of the joint ranges included."""

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from mink import SE3, SO3

from robo47_qp.arrays import Vector

_JOINTS = 8

fractions = arrays(np.float64, _JOINTS, elements=st.floats(0.0, 1.0))
"""Where each joint is in its range, 0 and 1 included; see `PlainArm.at`."""

inner_fractions = arrays(np.float64, _JOINTS, elements=st.floats(0.1, 0.9))
"""The same, away from the limits."""

rates = arrays(np.float64, _JOINTS, elements=st.floats(-2.0, 2.0))
"""Joint velocities [rad/s] or accelerations [rad/s²]."""

_number = st.floats(-1.0, 1.0)

rotations = (
    st.tuples(_number, _number, _number, _number)
    .map(np.array)
    .filter(lambda wxyz: bool(np.linalg.norm(wxyz) > 0.1))
    .map(lambda wxyz: SO3(wxyz / np.linalg.norm(wxyz)))
)
"""Rotations, half turns and quaternions with w < 0 among them."""

poses = st.builds(
    SE3.from_rotation_and_translation, rotations, arrays(np.float64, 3, elements=_number)
)
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
