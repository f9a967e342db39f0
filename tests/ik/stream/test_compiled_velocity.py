"""The velocity towards targets by the compiled core is that of the reference."""

from dataclasses import replace

import numpy as np
import pytest
from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.evaluation.benchmarks.ik.hostile_targets import pair_targets, targets
from robo47_qp.ik.stream.compiled_velocity import CompiledVelocity
from robo47_qp.ik.stream.settings import Event, StreamSettings
from robo47_qp.ik.stream.target_velocity import TargetVelocity
from robo47_qp.ik.stream.targets import targets_of
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots import load_robot
from tests.robots import robot_or_skip

SETTINGS = StreamSettings()


def both(arm: Arm, settings: StreamSettings = SETTINGS) -> list[TargetVelocity]:
    profile = arm.robot.rated
    return [kind(settings, arm, profile) for kind in (TargetVelocity, CompiledVelocity)]


def assert_same(pair: list[TargetVelocity], target: object, q: Vector) -> tuple[Event, ...]:
    """Up to rounding times the condition of J Jᵀ: damped, but for the projection of v_home."""
    arm = pair[0]._arm
    expected, found = (one.objective(targets_of(arm, target), q) for one in pair)
    assert set(found.events) == set(expected.events)
    for name in ("position_error", "orientation_error", "H"):
        np.testing.assert_allclose(
            getattr(found, name), getattr(expected, name), rtol=1e-12, atol=1e-12
        )
    np.testing.assert_allclose(found.way.rows, expected.way.rows, rtol=0.0, atol=1e-14)
    singular = np.linalg.svd(expected.way.rows, compute_uv=False)
    share, threshold = singular[-1] / singular[0], pair[0]._settings.singular_threshold
    tolerance = 1e-14 / max(share, threshold / 2.0) ** 2
    tolerance *= max(1.0, float(np.abs(expected.way.whole).max()))
    np.testing.assert_allclose(found.way.whole, expected.way.whole, rtol=0.0, atol=tolerance)
    np.testing.assert_allclose(found.way.paced, expected.way.paced, rtol=0.0, atol=2.0 * tolerance)
    tolerance = 2.0 * tolerance + 3e-15 / max(share, 1e-5) ** 2
    np.testing.assert_allclose(found.v_ref, expected.v_ref, rtol=0.0, atol=tolerance)
    return expected.events


@pytest.mark.parametrize("name", ["panda", "panda_pair", "iiwa14"])
def test_on_hostile_targets(name: str) -> None:
    """Ways along which targets move, jump, are refused or are told for one tool only."""
    rng = np.random.default_rng(4)
    arm = Arm(load_robot(name) if name == "panda_pair" else robot_or_skip(name))
    pair, seen = both(arm), set[Event]()
    q = v = arm.home
    given = targets(arm, rng) if len(arm.robot.tools) == 1 else pair_targets(arm, rng)
    for k in range(6000):
        target = next(given)
        if k % 125 > 4:
            continue
        if k % 125 == 0:
            q = rng.uniform(arm.q_low, arm.q_high)
            v = rng.uniform(-1.0, 1.0, arm.n)
        seen.update(assert_same(pair, target, q + 1e-3 * (k % 125) * v))
    assert Event.TARGET_JUMPED in seen
    assert assert_same(pair, None, arm.home) == (Event.TARGET_REFUSED,)
    for one in pair:
        one.reset()
    # What was reset knows no target before, so none can have jumped.
    assert Event.TARGET_JUMPED not in assert_same(pair, arm.pose(arm.home), arm.home)


@pytest.mark.parametrize("off", [0.0, 1e-7, 1e-3, 0.02])
def test_where_directions_are_lost(off: float) -> None:
    """Stretched and folded: eigenvalues of the core beside those of LAPACK."""
    arm, rng = Arm(load_robot("panda")), np.random.default_rng(6)
    pair = both(arm)
    q = arm.home.copy()
    q[[1, 2, 3, 4, 5]] = [0.0, 0.0, -0.07 - off, 0.0, off]
    for _ in range(10):
        target = arm.pose(arm.drawn(rng))
        assert_same(pair, target, q + off * rng.uniform(-1.0, 1.0, arm.n))


@pytest.mark.parametrize(
    "settings",
    [
        replace(SETTINGS, home_gain=0.0),
        replace(SETTINGS, gain=20.0, reserve=0.2, max_distance=0.05, dt=4e-3),
        replace(SETTINGS, radian_length=1.0, joint_weight=0.1, singular_threshold=0.4),
    ],
)
def test_with_other_settings_and_frozen_joints(settings: StreamSettings) -> None:
    arm, rng = Arm(load_robot("panda")), np.random.default_rng(8)
    pair = both(arm, settings)
    T = arm.pose(arm.home)
    for frozen in ([], [2, 5]):
        for one in pair:
            one.freeze(frozen)
        for k in range(12):
            target = SE3.exp(np.array([0.3, -0.2, 0.1, 0.4, 0.0, -0.5]) * 1e-3 * k) @ T
            assert_same(pair, target, arm.home + 0.1 * rng.uniform(-1.0, 1.0, arm.n))


@pytest.mark.parametrize("between", [{"left": None}, {}])
def test_a_tool_that_had_no_target_in_between_has_no_velocity(between: dict[str, None]) -> None:
    arm = Arm(load_robot("panda_pair"))
    pair = both(arm)
    T = {tool.name: arm.pose(arm.home, i) for i, tool in enumerate(arm.robot.tools)}
    step = SE3.from_translation(np.array([1e-4, 0.0, 0.0]))
    moved = {name: step @ pose for name, pose in T.items()}
    for targets_now in (T, moved, {"right": T["right"], **between}, T, moved):
        assert assert_same(pair, targets_now, arm.home) == (
            (Event.TARGET_REFUSED,) if targets_now.get("left", T) is None else ()
        )
