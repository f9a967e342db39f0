"""PathProfile: bounds of the tool's motion along a path."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo47_qp.motion.paths.segments import PathProfile


@given(length=st.floats(1e-3, 2.0), angle=st.floats(1e-3, 3.0), pace=st.floats(0.05, 1.0))
def test_a_path_profile_keeps_the_linear_and_the_angular_bounds_and_touches_one(
    length: float, angle: float, pace: float
) -> None:
    profile = PathProfile()
    found = profile.along(length, angle, pace)
    for order, bound in enumerate(found, start=1):
        linear = bound * length / (profile.linear[order - 1] * pace**order)
        angular = bound * angle / (profile.angular[order - 1] * pace**order)
        assert max(linear, angular) == pytest.approx(1.0)


def test_a_path_profile_of_a_turn_or_of_a_line_alone() -> None:
    profile = PathProfile()
    assert profile.along(0.0, 2.0, 1.0) == pytest.approx(np.array(profile.angular) / 2.0)
    assert profile.along(2.0, 0.0, 1.0) == pytest.approx(np.array(profile.linear) / 2.0)
