"""The mended joint limit against braking tick by tick, and what mink's own limits do."""

import mink
import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError, UnknownNameError
from robo47_qp.ik.mended import JointLimit

MODEL = mujoco.MjModel.from_xml_string("""<mujoco><compiler angle="radian" autolimits="true"/>
<worldbody>
  <body><joint name="free" axis="0 0 1"/><geom size=".1"/>
    <body><joint name="turn" range="-1 1"/><geom size=".1"/>
      <body><joint name="slide" type="slide" range="-.5 1.5"/><geom size=".1"/></body></body></body>
  <body><joint name="ball" type="ball"/><geom size=".1"/></body>
  <body><freejoint name="floating"/><geom size=".1"/></body>
</worldbody></mujoco>""")
SPEEDS = {"turn": 2.0, "slide": 0.5, "free": 1.0}
ACCELERATIONS = {"turn": 3.0, "slide": 2.0, "free": 5.0}
V, A = np.array([1.0, 2.0, 0.5]), np.array([5.0, 3.0, 2.0])
LOW, HIGH = np.array([-np.inf, -1.0, -0.5]), np.array([np.inf, 1.0, 1.5])
dts = st.sampled_from([1e-3, 2e-3, 0.02, 0.1])


def at(q: Vector) -> mink.Configuration:
    full = MODEL.qpos0.copy()
    full[:3] = q
    return mink.Configuration(MODEL, full)


def whole(v: Vector) -> Vector:
    return np.concatenate([v, np.zeros(MODEL.nv - 3)])


def way_to_rest(v: float, a: float, dt: float) -> float:
    """Steps v dt, each slower by a dt than the one before, until it stands."""
    way = 0.0
    while v > 0.0:
        way, v = way + v * dt, v - a * dt
    return way


@given(place=st.floats(0.0, 1.0), speed=st.floats(-1.0, 1.0), joint=st.sampled_from([1, 2]), dt=dts)
def test_the_largest_step_is_the_largest_that_can_still_be_stopped(
    place: float, speed: float, joint: int, dt: float
) -> None:
    q, v = np.array([0.0, 0.1, 0.2]), np.zeros(3)
    q[joint] = LOW[joint] + place * (HIGH[joint] - LOW[joint])
    v[joint] = speed * V[joint]
    limit = JointLimit(MODEL, SPEEDS, ACCELERATIONS)
    limit.set_velocity(whole(v))
    box = limit.box(at(q), dt)
    step = A[joint] * dt
    for end, sign in ((box.high, 1.0), (-box.low, -1.0)):
        found = end[joint] / dt
        room = HIGH[joint] - q[joint] if sign > 0.0 else q[joint] - LOW[joint]
        now = sign * v[joint]
        assert now - step - 1e-9 <= found <= min(V[joint], now + step) + 1e-9 or now > V[joint]
        stops = way_to_rest(found, A[joint], dt) <= room + 1e-9
        braking_hardest = found == pytest.approx(max(0.0, now - step), abs=1e-9)
        assert stops or braking_hardest
        at_a_bound = found >= min(V[joint], now + step) - 1e-9
        faster = way_to_rest(found * (1.0 + 1e-6) + 1e-9, A[joint], dt)
        assert at_a_bound or faster > room - 1e-9 or now < 0.0


@given(seed=st.integers(0, 10_000), dt=dts)
def test_whatever_is_asked_for_ranges_speeds_and_accelerations_are_kept(
    seed: int, dt: float
) -> None:
    """By mink.solve_ik, with targets far outside the ranges that jump now and then."""
    rng, c = np.random.default_rng(seed), at(np.zeros(3))
    limit, task = JointLimit(MODEL, SPEEDS, ACCELERATIONS), mink.PostureTask(MODEL, 1.0)
    before = np.zeros(3)
    for tick in range(60):
        if tick % 15 == 0:
            target = MODEL.qpos0.copy()
            target[:3] = rng.uniform(-5.0, 5.0, 3)
            task.set_target(target)
        v = mink.solve_ik(c, [task], dt, "daqp", limits=[limit])
        limit.set_velocity(v)
        c.integrate_inplace(v, dt)
        assert (np.abs(v[:3]) <= V + 1e-9).all()
        assert (np.abs(v[:3] - before) <= A * dt + 1e-9).all()
        assert (c.q[:3] <= HIGH + 1e-9).all()
        assert (c.q[:3] >= LOW - 1e-9).all()
        before = v[:3]


@settings(max_examples=20)
@given(
    outside=st.floats(1e-6, 0.5),
    speed=st.floats(-1.5, 1.5),
    upper=st.booleans(),
    dt=st.sampled_from([0.01, 0.02]),
)
def test_a_joint_outside_or_too_fast_is_brought_back_in_time(
    outside: float, speed: float, upper: bool, dt: float
) -> None:
    q = np.array([0.0, 1.0 + outside if upper else -1.0 - outside, 0.0])
    v = np.array([0.0, 2.0 * speed, 0.0])
    c, limit, task = at(q), JointLimit(MODEL, SPEEDS, ACCELERATIONS), mink.PostureTask(MODEL, 1.0)
    pulled = MODEL.qpos0.copy()
    pulled[1] = 9.0 if upper else -9.0
    task.set_target(pulled)
    limit.set_velocity(whole(v))
    # To rest, and the way back from rest; a bit more for what falls between ticks.
    farthest = outside + (2.0 * speed) ** 2 / (2.0 * 3.0)
    in_time = abs(2.0 * speed) / 3.0 + 2.0 * np.sqrt(farthest / 3.0) + farthest / 2.0 + 12.0 * dt
    before = v
    for _ in range(int(in_time / dt) + 1):
        v = mink.solve_ik(c, [task], dt, "daqp", limits=[limit])[:3]
        limit.set_velocity(whole(v))
        c.integrate_inplace(whole(v), dt)
        assert (np.abs(v - before) <= A * dt + 1e-9).all()
        before = v
    assert abs(c.q[1]) <= 1.0 + 1e-6
    assert abs(v[1]) <= 2.0 + 1e-9


def test_without_accelerations_it_comes_back_at_full_speed_and_stops_at_the_end() -> None:
    c, limit, task = at(np.array([0.0, 1.01, 0.0])), JointLimit(MODEL, SPEEDS), posture(0.0)
    v = mink.solve_ik(c, [task], 2e-3, "daqp", limits=[limit])
    assert v[1] == pytest.approx(-2.0)
    task = posture(9.0)
    for _ in range(20):
        v = mink.solve_ik(c, [task], 2e-3, "daqp", limits=[limit])
        c.integrate_inplace(v, 2e-3)
        limit.set_velocity(v)
    assert c.q[1] == pytest.approx(1.0, abs=1e-9)
    c.update(at(np.zeros(3)).q)
    for _ in range(20):
        c.integrate_inplace(mink.solve_ik(c, [task], 0.1, "daqp", limits=[limit]), 0.1)
    assert c.q[1] == pytest.approx(1.0, abs=1e-9)


def posture(target: float) -> mink.PostureTask:
    task, q = mink.PostureTask(MODEL, 1.0), MODEL.qpos0.copy()
    q[1] = target
    task.set_target(q)
    return task


def test_only_the_joints_named_are_limited() -> None:
    limit = JointLimit(MODEL, {"slide": 0.5}, {"slide": 2.0})
    low, high = limit.box(at(np.zeros(3)), 0.1)
    assert np.isfinite(high).nonzero()[0].tolist() == [2]
    assert np.isfinite(low).nonzero()[0].tolist() == [2]
    G, h = limit.compute_qp_inequalities(at(np.zeros(3)), 0.1)
    assert G is not None
    assert h is not None
    assert G.tolist() == [np.eye(MODEL.nv)[2].tolist(), (-np.eye(MODEL.nv)[2]).tolist()]
    assert h.tolist() == pytest.approx([high[2], -low[2]])


def test_bad_input_is_told() -> None:
    with pytest.raises(UnknownNameError, match="joint is called 'knee'; known: free, turn"):
        JointLimit(MODEL, {"knee": 1.0})
    with pytest.raises(InvalidValueError, match="at least one joint"):
        JointLimit(MODEL, {})
    with pytest.raises(InvalidValueError, match="joints that turn or slide; found ball"):
        JointLimit(MODEL, {"ball": 1.0})
    with pytest.raises(InvalidValueError, match="given for the joints"):
        JointLimit(MODEL, {"turn": 1.0}, {"slide": 1.0})
    with pytest.raises(InvalidValueError, match="positive"):
        JointLimit(MODEL, {"turn": 0.0})
    with pytest.raises(InvalidValueError, match="finite"):
        JointLimit(MODEL, {"turn": 1.0}, {"turn": np.nan})
    limit = JointLimit(MODEL, {"turn": 1.0})
    with pytest.raises(InvalidValueError, match="v must be a vector of 12"):
        limit.set_velocity(np.full(MODEL.nv, np.nan))
    with pytest.raises(InvalidValueError, match="dt must be above 0"):
        limit.box(at(np.zeros(3)), 0.0)


# What plain mink does ---------------------------------------------------------------------------


@pytest.mark.xfail(
    reason="mink 1.3: range and speed are infeasible together", raises=mink.NoSolutionFound
)
def test_minks_limits_bring_a_joint_back() -> None:
    limits = [mink.ConfigurationLimit(MODEL), mink.VelocityLimit(MODEL, {"turn": 2.0})]
    c = at(np.array([0.0, 1.01, 0.0]))
    mink.solve_ik(c, [posture(0.0)], 2e-3, "daqp", limits=limits)


@pytest.mark.xfail(reason="mink 1.3: no limit on acceleration")
def test_minks_limits_leave_room_to_brake() -> None:
    limits = [mink.ConfigurationLimit(MODEL), mink.VelocityLimit(MODEL, {"turn": 2.0})]
    c, before, dt = at(np.array([0.0, 0.9, 0.0])), 2.0, 1e-3
    for _ in range(200):
        v = mink.solve_ik(c, [posture(2.0)], dt, "daqp", limits=limits)
        c.integrate_inplace(v, dt)
        assert before - v[1] <= 20.0 * dt
        before = v[1]
