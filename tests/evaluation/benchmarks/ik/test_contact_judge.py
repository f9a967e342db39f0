from dataclasses import replace

import numpy as np

from robo47_qp.collision.clearance import Clearance
from robo47_qp.evaluation.benchmarks.ik.contact_judge import SEEN, ContactJudge
from robo47_qp.ik.solver import Tolerance, judged
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from tests.plain_arm import PlainArm
from tests.small_robots import cell

ARM = Arm(PANDA, obstacles=cell())
JUDGE = ContactJudge(PANDA, cell())


def test_contacts_and_distances_agree_on_what_is_clear() -> None:
    """Two ways to the same figure: contacts of taken-apart capsules, distances of whole ones."""
    rng = np.random.default_rng(3)
    clearance = Clearance(ARM, 0.01)
    clear = 0
    for _ in range(150):
        q = rng.uniform(ARM.q_min, ARM.q_max)
        distance, contact = clearance.nearest(q)[0], JUDGE.clearance(q)
        assert (distance > 0.0) == (contact > 0.0)
        if 0.0 < distance < SEEN:
            clear += 1
            # The judge also sees pairs that the clearance leaves out as built that way, and its
            # contacts of cylinders are found by iteration.
            assert contact <= distance + 1e-4
    assert clear > 20


def test_the_pose_and_the_limits_are_judged() -> None:
    plain = PlainArm(PANDA)
    target = ARM.pose(ARM.home)
    result = judged(ARM, target, ARM.home, Tolerance(), 0)
    assert JUDGE.accepts(result, target)
    assert not JUDGE.accepts(replace(result, q=ARM.home + 1e-5), target)
    q = np.random.default_rng(0).uniform(ARM.q_min, ARM.q_max)
    assert JUDGE.accepts(replace(result, q=q), ARM.pose(q))
    for bound, sign in ((plain.q_min, -1.0), (plain.q_max, 1.0)):
        q = ARM.home.copy()
        q[0] = bound[0]
        assert JUDGE.accepts(replace(result, q=q), ARM.pose(q))
        q[0] += sign * 1e-6
        assert not JUDGE.accepts(replace(result, q=q), ARM.pose(q))
