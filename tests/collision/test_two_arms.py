"""Closing speeds of pairs of geoms on two arms, against differences of their distances."""

import numpy as np

from robo47_qp.collision.clearance import Clearance
from robo47_qp.ik.stream.stream import StreamIk
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots import load_robot


def test_rows_of_pairs_within_and_between_two_arms_are_slopes_of_their_distances() -> None:
    arm = Arm(load_robot("panda_pair"))
    clearance, rng = Clearance(arm, 0.02), np.random.default_rng(1)
    solver = StreamIk(clearance=0.02).build(arm)
    bounds, sides, h = solver._clearance_bounds, {"left": 0, "right": 0, "between": 0}, 1e-6
    assert bounds is not None
    for _ in range(4):
        q = rng.uniform(arm.q_min, arm.q_max)
        solver.reset(q)
        near = np.flatnonzero((bounds._bound < 0.3) & (bounds._bound > 0.02))
        for pair in rng.permutation(near)[:25].tolist():
            steps = h * np.eye(arm.n)
            slope = [
                clearance.distance_of(pair, q + step) - clearance.distance_of(pair, q - step)
                for step in steps
            ]
            np.testing.assert_allclose(bounds._A[pair], -np.array(slope) / (2 * h), atol=1e-3)
            of = {name.partition("_")[0] for name in clearance.pairs.names[pair]}
            sides[of.pop() if len(of) == 1 else "between"] += 1
    assert min(sides.values()) > 3
