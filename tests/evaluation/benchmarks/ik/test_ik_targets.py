"""Target sets: what each promises, by MuJoCo on its own."""

from collections.abc import Callable

import numpy as np
import pytest
from mink import SE3

from robo47_qp.evaluation.benchmarks.ik.targets import (
    TargetSet,
    near_limits,
    near_singular,
    tabletop,
    uniform,
)
from robo47_qp.evaluation.benchmarks.ik.unreachable import EXPECTED, HOSTILE, hostile, unreachable
from robo47_qp.evaluation.benchmarks.ik.workspace import find_reach
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA

Make = Callable[[Arm, int, np.random.Generator], TargetSet]
EVERY = (uniform, tabletop, near_limits, near_singular, unreachable, hostile)
ARM = Arm(PANDA)


def made(make: Make, n: int, seed: int = 3) -> TargetSet:
    return make(ARM, n, np.random.default_rng(seed))


def configurations(make: Make, n: int, monkeypatch: pytest.MonkeyPatch) -> np.ndarray:
    """The configurations behind a set that is made by forward kinematics."""
    seen: list[np.ndarray] = []
    pose = ARM.pose

    def noted(q: np.ndarray) -> SE3:
        seen.append(q.copy())
        return pose(q)

    monkeypatch.setattr(ARM, "pose", noted)
    made(make, n)
    return np.array(seen)


@pytest.mark.parametrize("make", EVERY, ids=lambda make: make.__name__)
def test_a_set_is_as_asked_and_repeats(make: Make) -> None:
    first, again, other = made(make, 12), made(make, 12), made(make, 12, seed=4)
    assert first.name == make.__name__
    assert len(first) == len(first.targets) == 12
    for one, two in zip(first.targets, again.targets, strict=True):
        assert repr(one) == repr(two)
    assert repr(first.targets) != repr(other.targets)


def test_it_works_for_every_robot(arm: Arm) -> None:
    for make in EVERY:
        found = make(arm, 6, np.random.default_rng(0))
        assert len(found) == 6


@pytest.mark.parametrize("make", [uniform, near_limits, near_singular], ids=lambda m: m.__name__)
def test_targets_made_by_fk_have_an_answer_inside_the_limits(
    make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    q = configurations(make, 30, monkeypatch)
    assert made(make, 2).reachable is True
    assert q.shape == (30, 7)
    assert (q >= ARM.q_min).all()
    assert (q <= ARM.q_max).all()


def test_uniform_fills_the_joint_ranges(monkeypatch: pytest.MonkeyPatch) -> None:
    q = configurations(uniform, 2000, monkeypatch)
    share = (q - ARM.q_min) / (ARM.q_max - ARM.q_min)
    for column in share.T:
        counts = np.histogram(column, bins=10, range=(0.0, 1.0))[0]
        assert np.abs(counts - 200).max() < 5 * np.sqrt(200)


def test_near_limits_has_four_of_seven_joints_within_a_hundredth(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    q = configurations(near_limits, 400, monkeypatch)
    share = (q - ARM.q_min) / (ARM.q_max - ARM.q_min)
    near = np.minimum(share, 1.0 - share) <= 0.01 + 1e-12
    assert (near.sum(axis=1) >= 4).all()
    assert near.sum(axis=1).mean() < 4.3
    # Every joint, and both of its ends.
    assert (near.mean(axis=0) > 0.4).all()
    assert ((share < 0.01).any(axis=0) & (share > 0.99).any(axis=0)).all()


def test_near_singular_is_more_singular_than_chance(monkeypatch: pytest.MonkeyPatch) -> None:
    def least(q: np.ndarray) -> np.ndarray:
        J = np.array([ARM.jacobian(one) for one in q])
        return np.linalg.svd(J, compute_uv=False)[:, -1]

    chance = least(configurations(uniform, 400, monkeypatch))
    chosen = least(configurations(near_singular, 60, monkeypatch)[-60:])
    assert np.median(chosen) < np.percentile(chance, 6.0)


def test_tabletop_is_in_front_above_the_table_and_points_down() -> None:
    found = made(tabletop, 500)
    p = np.array([T.translation() for T in found.targets])
    z = np.array([T.rotation().as_matrix()[:, 2] for T in found.targets])
    assert found.reachable is None
    assert (p[:, 2] >= 0.02).all()
    assert (z[:, 2] <= -np.cos(np.radians(20.0)) + 1e-9).all()
    assert z[:, 2].max() > -np.cos(np.radians(18.0))
    assert p[:, 0].min() > 0.2
    assert p[:, 0].max() < 0.8
    assert p[:, 1].min() < -0.3
    assert p[:, 1].max() > 0.3
    x = np.array([T.rotation().as_matrix()[:, 0] for T in found.targets])
    assert np.histogram(np.arctan2(x[:, 1], x[:, 0]), bins=8)[0].min() > 30


def test_reach_is_what_brute_force_finds_and_a_little_more() -> None:
    reach = find_reach(ARM)
    rng = np.random.default_rng(0)
    q = rng.uniform(ARM.q_min, ARM.q_max, (4000, ARM.n))
    found = max(float(np.linalg.norm(ARM.pose(one).translation() - reach.centre)) for one in q)
    assert found <= reach.tool < 1.05 * found
    np.testing.assert_allclose(reach.centre, [0.0, 0.0, 0.333], atol=1e-12)
    np.testing.assert_allclose(reach.p_tcp_wrist, [0.0, 0.0, -0.2104], atol=1e-9)


def test_unreachable_targets_are_not_reached_by_many_starts() -> None:
    found = made(unreachable, 50)
    assert found.reachable is False
    assert set(found.kinds) == set(EXPECTED) - set(HOSTILE)
    solver = MultiStart(solver=LmIk(max_iterations=30), max_restarts=25)
    for target, kind in zip(found.targets, found.kinds, strict=True):
        if kind != "inside_base":
            result = solver.solve(ARM, target, ARM.home)
            assert max(result.position_error, result.orientation_error) > 5e-3


def test_too_far_is_beyond_the_stretched_chain_and_just_out_is_not() -> None:
    found = made(unreachable, 200)
    beyond = np.array([ARM.beyond_reach(T.translation()) for T in found.targets])
    kinds = np.array(found.kinds)
    assert (beyond[kinds == "too_far"] > 0.0).all()
    assert (beyond[kinds == "below"] > 0.0).all()
    assert (beyond[kinds == "just_out"] == 0.0).all()
    assert all(T.translation()[2] < -0.5 for T in np.array(found.targets)[kinds == "below"])


def test_inside_the_base_is_within_its_foot() -> None:
    found = made(unreachable, 200)
    p = [T.translation() for T, k in zip(found.targets, found.kinds, strict=True) if "base" in k]
    assert len(p) == 40
    assert np.abs(np.array(p)).max() < 0.2


def test_hostile_targets_are_no_poses() -> None:
    found = made(hostile, 40)
    assert set(found.kinds) == set(HOSTILE)
    for target, kind in zip(found.targets, found.kinds, strict=True):
        numbers = np.asarray(getattr(target, "wxyz_xyz", target), dtype=np.float64)
        match kind:
            case "nan":
                assert np.isnan(numbers).any()
            case "infinite":
                assert np.isinf(numbers).any()
            case "no_rotation":
                assert not numbers[:4].any()
            case _:
                assert numbers.shape != (7,)
