"""Trajectory: what is read off its samples."""

import numpy as np
import pytest

from robo47_qp.motion.trajectory import Trajectory, hold


@pytest.mark.parametrize("moving", ["q", "v", "a"])
def test_only_what_does_not_move_in_any_way_is_still(moving: str) -> None:
    standing = hold(np.array([0.1, -0.2]), 3, 1e-3)
    assert standing.still
    columns = {name: getattr(standing, name).copy() for name in ("q", "v", "a")}
    columns[moving][2, 1] += 1e-9
    assert not Trajectory(dt=1e-3, **columns).still
