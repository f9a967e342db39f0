from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.ik.multistart import Preference
from robo47_qp.ik.solver import IkResult, Tolerance, judged
from robo47_qp.model.arm import Arm
from tests.plain_arm import PlainArm

NONE = Preference(seed=0.0, limits=0.0, manipulability=0.0, clearance=0.0)
NAMES = ("seed", "limits", "manipulability", "clearance")


def answer(arm: Arm, q: Vector, clearance: float | None = None) -> IkResult:
    return replace(judged(arm, arm.pose(q), q, Tolerance(), 1), clearance=clearance)


def qualities(plain: PlainArm, found: list[IkResult], q_seed: Vector) -> dict[str, Vector]:
    """What the fields of the class say, each written out for one answer after another."""
    span = plain.q_max - plain.q_min
    seed, limits, manipulability = [], [], []
    for result in found:
        q = result.q
        shares = [(q[i] - q_seed[i]) / span[i] for i in range(plain.n)]
        seed.append(1.0 - (sum(share**2 for share in shares) / plain.n) ** 0.5)
        rooms = [min(q[i] - plain.q_min[i], plain.q_max[i] - q[i]) for i in range(plain.n)]
        limits.append(min(rooms[i] / (span[i] / 2) for i in range(plain.n)))
        J = plain.jacobian(q)
        manipulability.append(max(np.linalg.det(J @ J.T), 0.0) ** 0.5)
    known = [result.clearance for result in found if result.clearance is not None]
    clear = np.array(known) if len(known) == len(found) else np.zeros(len(found))
    return {
        "seed": np.array(seed),
        "limits": np.array(limits),
        "manipulability": np.array(manipulability) / max(manipulability),
        "clearance": clear / max(clear.max(), 1e-300),
    }


def drawn(arm: Arm, plain: PlainArm, rng: np.random.Generator, count: int) -> list[IkResult]:
    return [
        answer(arm, rng.uniform(plain.q_min, plain.q_max), float(rng.uniform(0.01, 0.2)))
        for _ in range(count)
    ]


@pytest.mark.parametrize("name", NAMES)
def test_each_weight_alone_decides(
    arm: Arm, plain: PlainArm, name: str, rng: np.random.Generator
) -> None:
    for _ in range(10):
        found, q_seed = drawn(arm, plain, rng, 6), rng.uniform(plain.q_min, plain.q_max)
        quality = qualities(plain, found, q_seed)[name]
        assert ((quality >= 0.0) & (quality <= 1.0)).all()
        ranked = replace(NONE, **{name: 0.7}).ranked(arm, found, q_seed)
        assert [found.index(result) for result in ranked] == np.argsort(-quality).tolist()


@given(weights=st.tuples(*[st.floats(0.0, 2.0)] * 4), number=st.integers(0, 1000))
def test_the_best_has_the_largest_weighted_sum(
    arm: Arm, plain: PlainArm, weights: tuple[float, float, float, float], number: int
) -> None:
    rng = np.random.default_rng(number)
    found, q_seed = drawn(arm, plain, rng, 5), rng.uniform(plain.q_min, plain.q_max)
    named = dict(zip(NAMES, weights, strict=True))
    parts = qualities(plain, found, q_seed)
    score = np.sum([named[name] * parts[name] for name in NAMES], axis=0)
    ranked = Preference(**named).ranked(arm, found, q_seed)
    order = [found.index(result) for result in ranked]
    assert sorted(order) == list(range(5))
    assert (np.diff(score[order]) <= 1e-7).all()


def test_the_defaults_put_the_seed_first() -> None:
    p = Preference()
    assert p.seed > p.limits > max(p.manipulability, p.clearance) > 0.0


def test_equal_answers_keep_their_order(arm: Arm, plain: PlainArm) -> None:
    """Mirrored about the seed, each way is as long and leaves as much room."""
    q_seed = plain.at(np.full(8, 0.5))
    ways = [0.0, 0.1, -0.1, 0.1, -0.1]
    found = [answer(arm, q_seed + np.where(np.arange(arm.n) == 0, w, 0.0)) for w in ways]
    order = [found.index(result) for result in NONE.ranked(arm, found, q_seed)]
    assert order == [0, 1, 2, 3, 4]
    twins = [answer(arm, found[k].q.copy()) for k in (1, 0, 1, 0)]
    ranked = Preference().ranked(arm, twins, q_seed)
    assert [twins.index(result) for result in ranked] == [1, 3, 0, 2]


def test_the_scale_of_all_weights_does_not_matter(
    arm: Arm, plain: PlainArm, rng: np.random.Generator
) -> None:
    found = drawn(arm, plain, rng, 8)
    once = Preference().ranked(arm, found, arm.home)
    # A power of two: rounding is the same.
    double = Preference(seed=2.0, limits=1.0, manipulability=0.4, clearance=0.4)
    assert double.ranked(arm, found, arm.home) == once


def test_ways_are_shares_of_each_joints_range(arm: Arm, plain: PlainArm) -> None:
    """The same angle is a longer way for a joint that has less of a range."""
    span = plain.q_max - plain.q_min
    wide, narrow = int(span.argmax()), int(span.argmin())
    assert span[wide] > 1.2 * span[narrow]
    q_seed = plain.at(np.full(8, 0.5))
    found = [
        answer(arm, q_seed + np.where(np.arange(arm.n) == joint, way, 0.0))
        for joint, way in ((narrow, 0.2), (wide, 0.2))
    ]
    ranked = replace(NONE, seed=1.0).ranked(arm, found, q_seed)
    assert [found.index(result) for result in ranked] == [1, 0]


def test_the_joint_with_the_least_room_counts(arm: Arm, plain: PlainArm) -> None:
    tight = np.full(8, 0.5)
    tight[1] = 0.05
    lower, upper = plain.at(tight), plain.at(np.where(tight == 0.05, 0.96, tight))
    even = plain.at(np.full(8, 0.1))
    found = [answer(arm, q) for q in (lower, upper, even)]
    ranked = replace(NONE, limits=1.0).ranked(arm, found, arm.home)
    assert [found.index(result) for result in ranked] == [2, 0, 1]


def test_a_singular_answer_is_the_last_one(arm: Arm, plain: PlainArm) -> None:
    stretched = np.clip(np.zeros(arm.n), plain.q_min, plain.q_max)
    stretched[3] = 0.0
    found = [answer(arm, q) for q in (stretched, arm.home)]
    ranked = replace(NONE, manipulability=1.0).ranked(arm, found, stretched)
    assert [found.index(result) for result in ranked] == [1, 0]
    alone = [found[0], answer(arm, stretched.copy())]
    assert replace(NONE, manipulability=1.0).ranked(arm, alone, arm.home) == tuple(alone)


def test_clearance_counts_where_all_answers_know_theirs(arm: Arm) -> None:
    far = replace(NONE, clearance=1.0)
    for clearances, expected in (
        ((0.01, 0.05, 0.03), [1, 2, 0]),
        ((-0.02, 0.05, 0.0), [1, 2, 0]),
        ((0.01, None, 0.03), [0, 1, 2]),
        ((None, None, None), [0, 1, 2]),
        # Where nothing is clear, there is no best one to be a share of.
        ((0.0, 0.0, 0.0), [0, 1, 2]),
    ):
        found = [answer(arm, arm.home, clearance) for clearance in clearances]
        ranked = far.ranked(arm, found, arm.home)
        assert [found.index(result) for result in ranked] == expected


def test_none_and_one_are_given_back(arm: Arm) -> None:
    assert Preference().ranked(arm, [], arm.home) == ()
    one = answer(arm, arm.home)
    assert Preference().ranked(arm, [one], arm.home) == (one,)


def test_answers_are_left_alone(arm: Arm, plain: PlainArm, rng: np.random.Generator) -> None:
    found = drawn(arm, plain, rng, 4)
    before, q_seed = [result.q.tolist() for result in found], arm.home.copy()
    order = list(found)
    Preference().ranked(arm, found, q_seed)
    assert [result.q.tolist() for result in found] == before
    assert found == order
    assert q_seed.tolist() == arm.home.tolist()


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("weight", [-0.1, float("nan"), float("inf"), float("-inf")])
def test_a_weight_is_finite_and_not_negative(name: str, weight: float) -> None:
    message = rf"preference for {name} must be 0 or more and finite; found {weight}\."
    with pytest.raises(InvalidValueError, match=message):
        Preference(**{name: weight})
    assert getattr(Preference(**{name: 0.0}), name) == 0.0
