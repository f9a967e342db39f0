"""Joint targets that change while the arm moves: no jump, bounds kept, limits kept."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robo47_qp.arrays import Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import PlanError, RefusalReason
from robo47_qp.model.arm import Arm, JointReference
from robo47_qp.model.robot import MotionProfile
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.timing.lower_bound import least_time
from robo47_qp.motion.trajectory import Trajectory
from robo47_qp.run.policy.motion import JointTargets
from tests.runs import Reach, make_runner

ARM, PROFILE = Arm(PANDA), PANDA.profile


def at_rest(q: Vector) -> JointReference:
    return JointReference(q, np.zeros(ARM.n), np.zeros(ARM.n))


@dataclass
class Loop:
    """A control loop that follows its references exactly."""

    reference: JointReference = field(default_factory=lambda: at_rest(ARM.home))
    tracked: list[Trajectory] = field(default_factory=list)
    arm: Arm = ARM
    profile: MotionProfile = PROFILE

    def begin(self, name: str, **_: bool) -> None:
        pass

    def track(self, trajectory: Trajectory) -> None:
        starts = (trajectory.q[0], trajectory.v[0], trajectory.a[0])
        assert np.array_equal(starts, self.reference)
        self.tracked.append(trajectory)
        self.reference = trajectory.end

    def states(self) -> list[np.ndarray]:
        """Positions, velocities and accelerations of all that was tracked."""
        return [
            np.vstack([getattr(one, name)[min(i, 1) :] for i, one in enumerate(self.tracked)])
            for name in "qva"
        ]


def goal(rng: np.random.Generator) -> Vector:
    near: Vector = ARM.home + rng.uniform(-0.4, 0.4, ARM.n)
    return near


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000), every=st.integers(1, 400))
def test_a_goal_that_changes_while_moving_leaves_no_jump(seed: int, every: int) -> None:
    rng, loop = np.random.default_rng(seed), Loop()
    targets = JointTargets(loop)  # type: ignore[arg-type]
    for _ in range(0, min(800, 200 * every), every):
        targets.go(goal(rng), every)
    q, v, a = loop.states()
    assert (np.abs(v) <= PROFILE.v_max * (1 + 1e-6)).all()
    assert (np.abs(a) <= PROFILE.a_max * (1 + 1e-6)).all()
    assert (np.abs(np.diff(a, axis=0)) / TIMESTEP <= PROFILE.j_max * (1 + 1e-6)).all()
    jerk = PROFILE.j_max.max()
    assert np.abs(np.diff(q, axis=0) - 0.5 * TIMESTEP * (v[1:] + v[:-1])).max() <= jerk * 1e-9
    assert np.abs(np.diff(v, axis=0) - 0.5 * TIMESTEP * (a[1:] + a[:-1])).max() <= jerk * 1e-6


def test_it_comes_to_rest_at_the_last_goal_and_stays() -> None:
    loop, rng = Loop(), np.random.default_rng(3)
    targets, last = JointTargets(loop), goal(rng)  # type: ignore[arg-type]
    targets.go(goal(rng), 400)
    targets.go(last, 5000)
    targets.go(last, 10)
    end = loop.reference
    assert end.q == pytest.approx(last, abs=1e-12)
    assert not end.v.any()
    assert not end.a.any()


def test_from_rest_it_takes_the_time_of_the_slowest_joint() -> None:
    loop, there = Loop(), ARM.home + np.array([0.5, 0.1, 0.0, 0.2, -0.3, 0.2, 0.4])
    best = least_time(0.5, PROFILE.v_max[0], PROFILE.a_max[0], PROFILE.j_max[0])
    JointTargets(loop).go(there, 4000)  # type: ignore[arg-type]
    arrival = int((loop.tracked[0].q != there).any(axis=1).sum()) * TIMESTEP
    assert best - 1e-9 <= arrival <= best + TIMESTEP


@pytest.mark.parametrize("side", [-1, 1])
def test_a_joint_that_cannot_turn_round_in_time_is_named(side: int) -> None:
    """The goal that is refused leaves the old one, and nothing is commanded."""
    q, v = ARM.home.copy(), np.zeros(ARM.n)
    q[1] = (ARM.q_max if side > 0 else ARM.q_min)[1] - side * 0.1
    v[1] = side * 1.5
    loop = Loop(reference=JointReference(q, v, np.zeros(ARM.n)))
    told = r"joint2 is so fast that it leaves its limits by 0\.\d+"
    with pytest.raises(PlanError, match=told) as caught:
        JointTargets(loop).go(q, 10)  # type: ignore[arg-type]
    assert caught.value.rejection is not None
    assert caught.value.rejection.reason is RefusalReason.JOINT_LIMIT
    assert not loop.tracked


def test_a_refused_goal_leaves_the_old_one() -> None:
    loop = Loop()
    targets = JointTargets(loop)  # type: ignore[arg-type]
    targets.go(ARM.home + 0.1, 100)
    with pytest.raises(PlanError, match="leaves its limits"):
        targets.go(ARM.q_max + 0.1, 100)
    targets.go(ARM.home + 0.1, 3000)
    assert loop.reference.q == pytest.approx(ARM.home + 0.1, abs=1e-12)


def test_the_pace_of_the_planner_slows_it_down() -> None:
    runner, _ = make_runner(Reach(), speed=0.5)
    loop = Loop(profile=runner.loop.profile)
    JointTargets(loop).go(ARM.home + 0.5, 3000)  # type: ignore[arg-type]
    assert np.abs(loop.tracked[0].v).max() <= 0.5 * PROFILE.v_max[0] * (1 + 1e-6)
