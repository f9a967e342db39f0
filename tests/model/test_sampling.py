import numpy as np

from robo47_qp.model.sampling import spread
from tests.plain_arm import PlainArm


def test_configurations_are_spread_evenly_over_every_joint(plain: PlainArm) -> None:
    unit = (spread(plain.q_min, plain.q_max, 50) - plain.q_min) / (plain.q_max - plain.q_min)
    for joint in unit.T:
        counts = np.histogram(joint, bins=5, range=(0.0, 1.0))[0]
        assert counts.min() >= 5
        assert counts.max() <= 16


def test_configurations_are_spread_evenly_over_pairs_of_joints(plain: PlainArm) -> None:
    unit = (spread(plain.q_min, plain.q_max, 60) - plain.q_min) / (plain.q_max - plain.q_min)
    correlation = np.corrcoef(unit.T) - np.eye(plain.n)
    assert np.abs(correlation).max() < 0.4
    for i in range(plain.n):
        for k in range(i):
            filled = np.histogram2d(unit[:, i], unit[:, k], bins=3, range=[[0, 1], [0, 1]])[0]
            assert filled.min() >= 1
