from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from robo47_qp.evaluation.benchmarks.motion.motion_check import violations
from robo47_qp.evaluation.benchmarks.motion.reference_kinematics import ReferenceKinematics
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.blending import Corner, cut_corners
from robo47_qp.motion.paths.curves import BlendError
from robo47_qp.motion.planner import Leg
from robo47_qp.motion.timing.rest_to_rest import plan_ptp
from robo47_qp.motion.trajectory import Trajectory
from tests.plain_arm import PlainArm

ARM, PLAIN, LOOK, DT = Arm(PANDA), PlainArm(PANDA), ReferenceKinematics(PANDA), 1e-3
PROFILE = PANDA.profile


def chain(rng: np.random.Generator, size: float = 0.6) -> list[np.ndarray]:
    inside = 0.1 * (ARM.q_max - ARM.q_min)
    steps = ARM.home + rng.uniform(-size, size, (4, ARM.n))
    return list(np.clip(steps, ARM.q_min + inside, ARM.q_max - inside))


def motions(points: list[np.ndarray]) -> list[Trajectory]:
    return [plan_ptp(a, b, PROFILE, DT) for a, b in pairwise(points)]


def promises(motion: Trajectory) -> list[str]:
    """What is broken of limits, bounds and derivatives, by differences of the samples."""
    leg = Leg(
        waypoint=None,  # type: ignore[arg-type]
        ik=None,  # type: ignore[arg-type]
        trajectory=motion,
        T_world_start=None,  # type: ignore[arg-type]
        T_world_goal=None,  # type: ignore[arg-type]
    )
    return violations(LOOK, [leg], PROFILE)


def places(q: np.ndarray) -> np.ndarray:
    return np.array([PLAIN.tool(row)[0] for row in q])


@settings(max_examples=12)
@given(seed=st.integers(0, 10_000), radius=st.floats(0.004, 0.1))
# Of states of these chains Ruckig misses the position at the end.
@example(seed=16, radius=0.1)
@example(seed=4767, radius=0.1)
def test_a_cut_is_quicker_and_keeps_limits_bounds_and_radius(seed: int, radius: float) -> None:
    points = chain(np.random.default_rng(seed))
    parts = motions(points)
    try:
        whole, passes = cut_corners(ARM, parts, [Corner(radius, PROFILE)] * 2)
    except BlendError:
        assume(False)
    assert promises(whole) == []
    assert whole.q[0].tolist() == parts[0].q[0].tolist()
    assert whole.q[-1].tolist() == parts[-1].q[-1].tolist()
    assert whole.steps < sum(part.steps for part in parts)
    corners = places(np.array(points[1:3]))
    for k, corner in zip(passes, corners, strict=True):
        assert np.linalg.norm(PLAIN.tool(whole.q[k])[0] - corner) <= radius + 1e-9
    # Outside the balls around the corners, every configuration is on the lines between points.
    tool = places(whole.q[::9])
    for q, place in zip(whole.q[::9], tool, strict=True):
        if np.linalg.norm(corners - place, axis=1).min() > radius + 1e-9:
            assert min(beside(q, a, b) for a, b in pairwise(points)) < 1e-9


def beside(q: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    share = np.clip((q - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
    return float(np.abs(q - a - share * (b - a)).max())


def test_straight_on_the_corner_is_hardly_slower_than_one_motion() -> None:
    way = np.array([0.6, 0.1, -0.2, 0.3, 0.1, 0.2, 0.3])
    points = [ARM.home, ARM.home + way, ARM.home + 2.0 * way]
    whole, _ = cut_corners(ARM, motions(points), [Corner(0.2, PROFILE)])
    at_once, stopping = plan_ptp(points[0], points[2], PROFILE, DT), motions(points)
    saved = sum(part.steps for part in stopping) - whole.steps
    assert saved > 0.6 * (sum(part.steps for part in stopping) - at_once.steps)


def test_a_radius_too_small_to_save_anything_leaves_the_stop() -> None:
    parts = motions(chain(np.random.default_rng(3)))
    whole, passes = cut_corners(ARM, parts, [Corner(1e-9, PROFILE)] * 2)
    assert whole.steps == sum(part.steps for part in parts)
    assert passes == [parts[0].steps, parts[0].steps + parts[1].steps]
    assert not whole.v[passes].any()


def test_a_wider_radius_is_never_slower() -> None:
    parts = motions(chain(np.random.default_rng(4)))
    steps = [
        cut_corners(ARM, parts, [Corner(radius, PROFILE)] * 2)[0].steps
        for radius in (0.002, 0.01, 0.05, 0.1)
    ]
    assert steps == sorted(steps, reverse=True)
    assert steps[-1] < steps[0]


def test_a_cut_that_would_leave_the_joint_limits_is_not_made() -> None:
    """The first joint turns round on the cut, and its limit is where it does."""
    way = np.array([0.5, 0.1, -0.2, 0.3, 0.1, 0.2, 0.3])
    back = way * np.array([-1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    points = [ARM.home, ARM.home + way, ARM.home + way + back]
    parts, narrow = motions(points), Arm(PANDA)
    free, _ = cut_corners(ARM, parts, [Corner(0.1, PROFILE)])
    # As wide as the way that was found it is taken, and narrower another.
    narrow.q_max[0] = free.q[:, 0].max()
    assert np.array_equal(cut_corners(narrow, parts, [Corner(0.1, PROFILE)])[0].q, free.q)
    narrow.q_max[0] -= 1e-4
    assert not np.array_equal(cut_corners(narrow, parts, [Corner(0.1, PROFILE)])[0].q, free.q)


def test_the_slower_profile_holds_outside_the_cut() -> None:
    points = chain(np.random.default_rng(8))
    slow = PROFILE.slowed(0.5)
    parts = [plan_ptp(points[0], points[1], slow, DT), plan_ptp(points[1], points[2], PROFILE, DT)]
    whole, _ = cut_corners(ARM, parts, [Corner(0.05, PROFILE)])
    assert promises(whole) == []
    far = np.linalg.norm(places(whole.q) - places(points[1][None]), axis=1) > 0.05 + 1e-9
    first = int((~far).argmax())
    assert (np.abs(whole.v[:first]) <= slow.v_max * (1 + 1e-9)).all()


def test_a_radius_that_is_not_left_is_refused() -> None:
    parts = motions(chain(np.random.default_rng(9), size=0.02))
    with pytest.raises(BlendError, match=r"it ends within the blend radius of 500\.0 mm") as caught:
        cut_corners(ARM, parts, [Corner(1e-6, PROFILE), Corner(0.5, PROFILE)])
    assert caught.value.segment == 1
