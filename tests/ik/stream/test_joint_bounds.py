"""Braking in time: the box of velocities against brute force over what can follow."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo47_qp._core.library import using
from robo47_qp.errors import InvalidValueError
from robo47_qp.ik.stream.joint_bounds import (
    JointBounds,
    braked,
    max_stoppable_speed,
    stopping_distance,
)
from robo47_qp.model.robot import MotionProfile

DT = 1e-3
unit = st.floats(0.0, 1.0)
a_maxima = st.floats(0.05, 50.0)
speeds = st.floats(0.0, 4.0)


def joint_bounds(
    low: float, high: float, v: float, a: float, margin: float = 0.0, dt: float = DT
) -> JointBounds:
    profile = MotionProfile.uniform(1, v=v, a=a, j=1.0)
    return JointBounds(np.array([low]), np.array([high]), profile, dt, margin)


def travel_to_rest(v: float, a: float) -> float:
    """Full braking, tick by tick, never beyond standstill: the way that it takes."""
    way = 0.0
    while v > 0.0:
        v_next = max(0.0, v - a * DT)
        way += DT * (v + v_next) / 2
        v = v_next
    return way


def peak(q: float, v: float, v_next: float) -> tuple[float, float]:
    """Lowest and highest position inside one tick, by many samples."""
    t = np.linspace(0.0, DT, 201)
    path = q + v * t + 0.5 * (v_next - v) / DT * t**2
    return float(path.min()), float(path.max())


@given(speeds, a_maxima)
def test_stopping_distance_is_that_of_braking_tick_by_tick(v: float, a: float) -> None:
    a = max(a, v / 2.0)  # at most 2000 ticks
    expected = travel_to_rest(v, a)
    assert stopping_distance(v, a, DT) == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert stopping_distance(-v, a, DT) == stopping_distance(v, a, DT)
    # Between the formula of continuous time and one tick's travel above it.
    assert v**2 / (2 * a) - 1e-12 <= expected <= v**2 / (2 * a) + a * DT**2 / 8 + 1e-12


@given(speeds, a_maxima, unit)
def test_the_fastest_velocity_uses_up_the_room(v: float, a: float, extra: float) -> None:
    room = float(stopping_distance(v, a, DT)) + extra
    v_next = float(max_stoppable_speed(room, v, a, DT))
    used = DT * (v + v_next) / 2 + float(stopping_distance(v_next, a, DT))
    assert used == pytest.approx(room, rel=1e-9, abs=1e-12)
    assert v_next >= max(v - a * DT, 0.0) - 1e-9


def test_no_room_allows_no_speed() -> None:
    assert max_stoppable_speed(-1.0, 0.5, 2.0, DT) == 0.0
    assert max_stoppable_speed(0.0, 0.0, 2.0, DT) == 0.0


@given(unit, unit, unit, a_maxima, st.floats(0.05, 3.0), st.floats(1e-3, 6.0))
def test_from_a_viable_state_every_choice_in_the_box_is_viable(
    where: float, how_fast: float, choice: float, a: float, v_max: float, width: float
) -> None:
    one = joint_bounds(-width / 2, width / 2, v_max, a)
    q = one.q_min + where * (one.q_max - one.q_min)
    up = max_stoppable_speed(one.q_max - q, np.zeros(1), a, DT)
    down = max_stoppable_speed(one.q_min * -1 + q, np.zeros(1), a, DT)
    v = np.clip((2 * how_fast - 1) * v_max, -down, up) * (1 - 1e-9)
    assert one.is_viable(q, v)
    for _ in range(30):
        box = one.box(q, v)
        assert not box.recovering
        assert box.low <= box.high
        rest = braked(v, one.a_max, DT)
        assert box.low - 1e-9 <= rest <= box.high + 1e-9
        v_next = box.low + choice * (box.high - box.low)
        assert abs(v_next - v) <= a * DT * (1 + 1e-9)
        assert abs(v_next) <= v_max
        lowest, highest = peak(q[0], v[0], v_next[0])
        assert lowest >= one.q_min - 1e-9
        assert highest <= one.q_max + 1e-9
        q, v = one.moved(q, v, v_next), v_next
        # Brute force: brake from here, and stay inside.
        end = q + np.sign(v) * travel_to_rest(float(abs(v[0])), max(a, 1e-3))
        assert one.q_min - 1e-9 <= end <= one.q_max + 1e-9


def test_the_box_leaves_out_nothing_that_could_be_braked() -> None:
    """Its upper end against a search by halving over simulated braking."""
    one = joint_bounds(-1.0, 1.0, 10.0, 5.0)
    rng = np.random.default_rng(3)
    tight = 0
    for _ in range(100):
        room = rng.uniform(1e-6, 0.05)
        q = np.array([1.0 - room])
        v = max_stoppable_speed(np.array([room]), np.zeros(1), 5.0, DT) * rng.uniform(0.97, 1.0)
        if not one.is_viable(q, v):
            continue
        low, high = max(0.0, float(v[0]) - 5.0 * DT), float(v[0]) + 5.0 * DT
        for _ in range(50):
            middle = (low + high) / 2
            end = q[0] + DT * (v[0] + middle) / 2 + travel_to_rest(middle, 5.0)
            low, high = (middle, high) if end <= 1.0 else (low, middle)
        assert one.box(q, v).high == pytest.approx(low, rel=1e-9, abs=1e-9)
        tight += bool(low < v[0] + 4.9 * DT)
    assert tight > 20


def test_driven_at_a_limit_a_joint_stops_on_it_without_touching_the_brakes_limit() -> None:
    one = joint_bounds(-0.5, 0.5, 2.0, 7.0)
    q, v = np.zeros(1), np.zeros(1)
    fastest_seen = 0.0
    for _ in range(2000):
        v_next = one.box(q, v).high
        assert abs(v_next - v) <= 7.0 * DT + 1e-12
        q, v = one.moved(q, v, v_next), v_next
        fastest_seen = max(fastest_seen, float(v[0]))
    assert q == pytest.approx(0.5, abs=1e-9)
    assert v == pytest.approx(0.0, abs=1e-9)
    assert fastest_seen > 1.5


@given(st.floats(-3.0, 3.0), st.floats(-6.0, 6.0), st.floats(0.5, 20.0), unit)
def test_any_state_is_brought_back_and_never_faster_than_the_joint_bounds(
    q0: float, v0: float, a: float, choice: float
) -> None:
    dt = 4.0 * DT
    one = joint_bounds(-1.0, 1.0, 2.0, a, dt=dt)
    q, v = np.array([q0]), np.array([v0])
    was_viable = one.is_viable(q, v)
    assert one.box(q, v).recovering or was_viable or abs(v0) < 2.1
    for _ in range(int((abs(v0) / a + 4 * np.sqrt(8.0 / a) + 8.0) / dt)):
        box = one.box(q, v)
        v_next = box.low + choice * (box.high - box.low)
        assert abs(v_next - v) <= a * dt + 1e-12
        q, v = one.moved(q, v, v_next), v_next
        if one.is_viable(q, v):
            break
    assert one.is_viable(q + np.clip(q, -1, 1) * -1e-9, v * (1 - 1e-9)) or abs(q[0]) < 1 + 1e-9
    assert abs(v[0]) <= 2.0 + 1e-9


def test_a_margin_is_left_of_every_limit() -> None:
    one = joint_bounds(-1.0, 1.0, 2.0, 5.0, margin=0.01)
    kept = np.concatenate([one.q_min, one.q_max, one.v_max, one.a_max])
    np.testing.assert_allclose(kept, [-0.98, 0.98, 1.98, 4.95])


def test_an_empty_range_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="q_min must be below q_max"):
        joint_bounds(1.0, 1.0, 1.0, 1.0)


def test_the_box_of_several_joints_is_that_of_each(rng: np.random.Generator) -> None:
    """Against `max_stoppable_speed` over arrays, near limits and far from them, fast and slow."""
    q_max, v_max, a_max = np.array([1.0, 0.4, 2.0]), np.array([2.0, 1.0, 0.5]), np.array([15, 7, 1])
    profile = MotionProfile(v_max=v_max, a_max=a_max, j_max=np.ones(3))
    three = JointBounds(-q_max, q_max, profile, DT, 0.0)
    near = 0
    for _ in range(500):
        q = q_max * np.sign(rng.normal(size=3)) * (1.0 - rng.uniform(size=3) ** 3)
        most, least = (max_stoppable_speed(q_max - s * q, np.zeros(3), a_max, DT) for s in (1, -1))
        v = np.clip(rng.uniform(-1.0, 1.0, 3) * v_max, -least, most) * (1 - 1e-9)
        up, down = (max_stoppable_speed(q_max - s * q, s * v, a_max, DT) for s in (1, -1))
        box = three.box(q, v)
        high = np.minimum(np.minimum(v + a_max * DT, v_max), up)
        np.testing.assert_allclose(box.high, high, atol=1e-9)
        np.testing.assert_allclose(box.low, np.maximum(np.maximum(v - a_max * DT, -v_max), -down))
        assert not box.recovering
        near += int((up < v_max).sum())
    assert near > 50


def test_the_core_tells_the_box_of_the_reference_to_the_bit(rng: np.random.Generator) -> None:
    """Of states all over, near limits of position and of velocity, and beyond them."""
    profile = MotionProfile.uniform(3, v=1.0, a=7.0, j=1.0)
    q_max = np.array([0.4, 1.0, np.inf])
    with using("numpy"):
        reference = JointBounds(-q_max, q_max, profile, DT, 1e-6)
    core = JointBounds(-q_max, q_max, profile, DT, 1e-6)
    kinds = [0, 0]
    for _ in range(3000):
        q = np.clip(q_max, 0.0, 2.0) * rng.uniform(-1.005, 1.005, 3)
        v = rng.uniform(-1.05, 1.05, 3) * rng.choice([0.0, 0.1, 1.0])
        if rng.uniform() < 0.5:
            # About as fast as can still be stopped.
            way = np.where(v < 0.0, -1.0, 1.0)
            fastest = max_stoppable_speed(np.minimum(q_max - way * q, 1.0), 0.0, 7.0, DT)
            v = way * fastest * rng.uniform(0.97, 1.001)
        expected, found = reference.box(q, v), core.box(q, v)
        assert found.low.tolist() == expected.low.tolist()
        assert found.high.tolist() == expected.high.tolist()
        assert found.recovering == expected.recovering
        assert (core._compiled_box(q, v) is None) == (reference._viable_box(q, v) is None)
        kinds[found.recovering] += 1
    assert min(kinds) > 100
