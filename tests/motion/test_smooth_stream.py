"""Smoothed streams: no step in acceleration, no bound broken, no jump at the start."""

from itertools import pairwise

import numpy as np
import pytest
from mink import SE3

from robo47_qp.ik.stream.stream import StreamIk
from robo47_qp.model.arm import Arm, JointReference
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.smooth_stream import SmoothStream
from robo47_qp.motion.trajectory import Trajectory

DT, W = 1e-3, 20
ARM = Arm(PANDA)
MOVING = JointReference(ARM.home + 0.05, np.linspace(-0.5, 0.6, 7), np.linspace(1.0, -2.0, 7))


def smooth(now: JointReference, window: int = W) -> SmoothStream:
    stream = SmoothStream(StreamIk(dt=DT).build(ARM), window)
    stream.reset(now)
    return stream


def rests(q: np.ndarray) -> JointReference:
    return JointReference(q, np.zeros(7), np.zeros(7))


def blocks(stream: SmoothStream, targets: list[SE3 | None]) -> list[Trajectory]:
    return [stream.block([target] * 25) for target in targets]


def jumping(rng: np.random.Generator, count: int) -> list[SE3 | None]:
    """Targets that jump by decimetres, one of them missing."""
    home = ARM.pose(ARM.home)
    shifts = rng.uniform(-0.2, 0.2, (count, 3))
    targets: list[SE3 | None] = [SE3.from_translation(shift) @ home for shift in shifts]
    targets[count // 2] = None
    return targets


@pytest.mark.parametrize("now", [rests(ARM.home), MOVING], ids=["at rest", "moving"])
def test_it_goes_on_from_the_reference_without_a_step(now: JointReference) -> None:
    part = smooth(now).block([ARM.pose(ARM.home)] * 3)
    np.testing.assert_array_equal(part.q[0], now.q)
    np.testing.assert_array_equal(part.v[0], now.v)
    np.testing.assert_array_equal(part.a[0], now.a)
    # The step to the first sample is that of the state.
    np.testing.assert_allclose(part.q[1] - now.q, now.v * DT, atol=2e-3 * DT)
    np.testing.assert_allclose(part.v[1] - now.v, now.a * DT, atol=0.4 * DT)
    assert np.abs(part.a[1] - now.a).max() <= 2 * PANDA.profile.a_max.max() / W + 1e-9


def test_it_bounds_velocity_acceleration_and_jerk(rng: np.random.Generator) -> None:
    parts = blocks(smooth(rests(ARM.home)), jumping(rng, 40))
    profile = PANDA.profile
    v, a, jerk = (
        max(float(np.abs(getattr(part, name)).max()) for part in parts)
        for name in ("v", "a", "jerk")
    )
    assert 0.3 < v <= profile.v_max[0] * (1 + 1e-9)
    assert 2.9 < a <= profile.a_max[0] * (1 + 1e-9)
    assert 200.0 < jerk <= 2 * profile.a_max[0] / (W * DT) * (1 + 1e-9)


def test_parts_join_and_velocities_are_those_of_positions(rng: np.random.Generator) -> None:
    parts = blocks(smooth(MOVING), jumping(rng, 10))
    for before, after in pairwise(parts):
        for name in ("q", "v", "a"):
            np.testing.assert_array_equal(getattr(before, name)[-1], getattr(after, name)[0])
    q, v, a = (np.concatenate([getattr(p, name)[1:] for p in parts]) for name in ("q", "v", "a"))
    # The stream's ticks have constant acceleration; the mean of such steps is one again.
    np.testing.assert_allclose(np.diff(q, axis=0), 0.5 * DT * (v[1:] + v[:-1]), atol=1e-12)
    np.testing.assert_allclose(np.diff(v, axis=0)[W:], DT * a[1 + W :], atol=1e-12)


def test_it_is_the_stream_delayed_by_half_a_window() -> None:
    target = SE3.from_translation(np.array([0.0, 0.0, 0.1])) @ ARM.pose(ARM.home)
    plain = StreamIk(dt=DT).build(ARM)
    plain.reset(ARM.home)
    q = np.array([plain.tick(target).q for _ in range(300)])
    part = smooth(rests(ARM.home), 21).block([target] * 300)
    np.testing.assert_allclose(part.q[1:][-200:], q[-210:-10], atol=2e-4)
    assert np.abs(q[-200:] - q[-210:-10]).max() > 2e-3


def test_without_a_target_it_comes_to_rest_exactly() -> None:
    parts = blocks(smooth(MOVING), [None] * 20)
    assert parts[0].v.any()
    assert not parts[-1].v.any()
    assert not parts[-1].a.any()


def test_it_stays_inside_the_limits_that_it_is_driven_into() -> None:
    q = ARM.home.copy()
    q[3] = ARM.q_max[3] - 0.01
    beyond = ARM.home.copy()
    beyond[3] = ARM.q_max[3] + 0.5
    now = JointReference(q, np.zeros(7), np.zeros(7))
    parts = blocks(smooth(now), [ARM.pose(beyond)] * 20)
    highest = max(float(part.q[:, 3].max()) for part in parts)
    assert ARM.q_max[3] - 0.01 < highest <= ARM.q_max[3]
