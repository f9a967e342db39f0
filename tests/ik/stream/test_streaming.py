"""Streaming IK: what is commanded, tick by tick, judged by differences and MuJoCo on its own."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.collision.clearance import Clearance
from robo47_qp.errors import InvalidValueError, UnknownNameError
from robo47_qp.ik.stream.settings import Event, StreamTick
from robo47_qp.ik.stream.stream import StreamIk, StreamSolver
from robo47_qp.model.arm import Arm
from robo47_qp.model.obstacle import Obstacle, Shape
from robo47_qp.model.robot import MotionProfile, Robot
from tests.plain_arm import PlainArm

DT = 1e-3


def commands(stream: StreamSolver, targets: Sequence[object]) -> list[StreamTick]:
    return [stream.tick(target) for target in targets]


def audit(arm: Arm, ticks: list[StreamTick], q0: Vector, profile: MotionProfile) -> None:
    """Limits by differences of positions alone, and q, v, a against one another."""
    q = np.array([q0, *(tick.q for tick in ticks)])
    v = np.array([np.zeros(arm.n), *(tick.v for tick in ticks)])
    a = np.array([tick.a for tick in ticks])
    assert (q >= arm.q_min).all()
    assert (q <= arm.q_max).all()
    assert (np.abs(v) <= profile.v_max).all()
    assert (np.abs(a) <= profile.a_max).all()
    np.testing.assert_allclose(np.diff(q, axis=0) / DT, (v[1:] + v[:-1]) / 2, atol=1e-9)
    np.testing.assert_allclose(np.diff(v, axis=0) / DT, a, atol=1e-9)
    assert (np.abs(np.diff(q, axis=0)) / DT <= profile.v_max + 1e-9).all()
    assert (np.abs(np.diff(q, n=2, axis=0)) / DT**2 <= profile.a_max + 1e-6).all()


def hostile(arm: Arm, rng: np.random.Generator, count: int) -> list[object]:
    """Targets that jump, leave reach, turn about, go through the base, and are no poses."""
    targets: list[object] = []
    while len(targets) < count:
        pose = arm.pose(rng.uniform(arm.q_min, arm.q_max))
        kind = rng.integers(5)
        length = int(rng.integers(50, 400))
        if kind == 0:
            targets += [SE3(np.full(7, np.nan))] * (length // 4)
        elif kind == 1:
            far = SE3.from_translation(rng.normal(size=3) * 10.0 ** rng.uniform(0, 12))
            targets += [far @ pose] * length
        elif kind == 2:
            step = SE3.exp(np.concatenate([rng.normal(size=3), 3 * rng.normal(size=3)]) * DT)
            for _ in range(length):
                pose = pose @ step
                targets.append(pose)
        elif kind == 3:
            targets += [SE3.from_rotation(pose.rotation())] * length
        else:
            targets += [pose] * length
    return targets[:count]


def test_limits_hold_whatever_the_target_does(arm: Arm, rng: np.random.Generator) -> None:
    for profile in (arm.robot.rated, arm.robot.profile):
        stream = StreamIk(profile=profile).build(arm)
        ticks = commands(stream, hostile(arm, rng, 3000))
        audit(arm, ticks, arm.home, profile)
        assert stream.counts[Event.RECOVERING] == 0
        assert stream.counts[Event.NO_ANSWER] == 0
        assert stream.counts[Event.TARGET_JUMPED] > 3
        assert stream.counts[Event.TARGET_REFUSED] > 10
        assert max(np.abs(tick.v / profile.v_max).max() for tick in ticks) > 0.5


def test_every_count_is_the_number_of_ticks_that_told_it(
    arm: Arm, rng: np.random.Generator
) -> None:
    stream = StreamIk().build(arm)
    ticks = commands(stream, hostile(arm, rng, 1000))
    for event in Event:
        assert stream.counts[event] == sum(event in tick.events for tick in ticks)
    stream.reset(arm.home)
    assert set(stream.counts.values()) == {0}


def test_same_targets_same_commands_to_the_bit(arm: Arm) -> None:
    def run() -> bytes:
        targets = hostile(arm, np.random.default_rng(11), 1500)
        ticks = commands(StreamIk().build(arm), targets)
        return b"".join(t.q.tobytes() + t.v.tobytes() + t.a.tobytes() for t in ticks)

    first = run()
    stream = StreamIk().build(arm)
    commands(stream, hostile(arm, np.random.default_rng(12), 100))
    assert run() == first


def test_a_static_target_is_reached_and_not_passed(arm: Arm, plain: PlainArm) -> None:
    rng = np.random.default_rng(2)
    for _ in range(4):
        aside = 0.2 * rng.uniform(-1.0, 1.0, arm.n)
        target = arm.pose(np.clip(arm.home + aside, arm.q_min, arm.q_max))
        ticks = commands(StreamIk().build(arm), [target] * 2500)
        distance, angle = plain.errors(ticks[-1].q, target)
        assert distance < 1e-6
        assert angle < 1e-6
        errors = np.array([tick.position_error + 0.3 * tick.orientation_error for tick in ticks])
        assert np.diff(errors).max() < 1e-6
        assert np.abs(ticks[-1].v).max() < 1e-2


def circle(arm: Arm, count: int, speed: float, radius: float) -> list[SE3]:
    """From the home pose, round a circle in a plane through the tool's z axis."""
    T = arm.pose(arm.home)
    angles = speed / radius * DT * np.arange(count)
    return [
        T @ SE3.from_translation(radius * np.array([0.0, np.sin(t), np.cos(t) - 1.0]))
        for t in angles
    ]


def test_a_target_on_a_circle_is_followed_within_a_tenth_of_a_millimetre(
    arm: Arm, plain: PlainArm
) -> None:
    targets = circle(arm, 3000, 0.1, 0.05)
    ticks = commands(StreamIk().build(arm), targets)
    late = range(600, 2999)
    assert max(ticks[k].position_error for k in late) < 1e-4
    assert max(ticks[k].orientation_error for k in late) < 1e-3
    # What the ticks tell is what MuJoCo sees: the error when asked, one command earlier.
    for k in (600, 1300, 2900):
        distance, angle = plain.errors(ticks[k - 1].q, targets[k])
        assert ticks[k].position_error == pytest.approx(distance, abs=1e-9)
        assert ticks[k].orientation_error == pytest.approx(angle, abs=1e-7)


def test_one_count_of_a_jump_and_the_arm_goes_on(arm: Arm) -> None:
    T = arm.pose(arm.home)
    away = T @ SE3.from_translation(np.array([0.0, 0.0, -0.1]))
    ticks = commands(StreamIk().build(arm), [T] * 10 + [away] * 2000)
    told = [k for k, tick in enumerate(ticks) if tick.events]
    assert told == [10]
    assert ticks[10].events == (Event.TARGET_JUMPED,)
    assert ticks[-1].position_error < 1e-6


@pytest.mark.parametrize(
    "target",
    [
        SE3(np.full(7, np.nan)),
        SE3(np.array([1.0, 0, 0, 0, 0, np.inf, 0])),
        SE3(np.zeros(7)),
        SE3(np.array([2.0, 0, 0, 0, 0, 0, 0])),
        SE3(np.array([1e200, 0, 0, 0, 0, 0, 0])),
        SE3(np.array(["1", "0", "0", "0", "0", "0", "0"])),
        SE3(np.array([1, 0, 0, 0, 0, 0, 1j])),
        SO3.identity(),
        np.eye(4),
        None,
        "home",
    ],
    ids=[
        "nan",
        "infinite",
        "zero",
        "twice",
        "huge",
        "text",
        "complex",
        "so3",
        "matrix",
        "none",
        "word",
    ],
)
def test_what_is_no_pose_brakes_the_arm_and_is_told(arm: Arm, target: object) -> None:
    stream = StreamIk().build(arm)
    there = arm.pose(np.clip(arm.home + 0.3, arm.q_min, arm.q_max))
    moving = commands(stream, [there] * 150)[-1]
    assert np.abs(moving.v).max() > 0.1
    profile = arm.robot.profile
    v = moving.v
    for _ in range(2000):
        tick = stream.tick(target)
        assert tick.events == (Event.TARGET_REFUSED,)
        assert np.isnan(tick.position_error)
        assert np.isnan(tick.orientation_error)
        expected = np.sign(v) * np.maximum(np.abs(v) - profile.a_max * DT, 0.0)
        np.testing.assert_allclose(tick.v, expected, atol=1e-5)
        v = tick.v
        if (v == 0.0).all():
            break
    assert (v == 0.0).all()
    assert stream.tick(there).events == ()


def test_an_integer_pose_is_a_pose(arm: Arm) -> None:
    assert StreamIk().build(arm).tick(SE3(np.array([1, 0, 0, 0, 0, 0, 1]))).events == ()


def test_a_start_outside_the_limits_is_brought_back_and_told(arm: Arm, plain: PlainArm) -> None:
    stream = StreamIk().build(arm)
    profile = arm.robot.profile
    q0 = plain.q_max + 0.02
    v0 = 1.2 * profile.v_max
    stream.reset(q0, v0)
    ticks = commands(stream, [arm.pose(arm.home)] * 3000)
    assert ticks[0].events == (Event.RECOVERING,)
    assert max(np.abs(tick.a / profile.a_max).max() for tick in ticks) <= 1.0
    late = [tick for tick in ticks if Event.RECOVERING not in tick.events]
    assert len(late) > 500
    assert all(plain.inside(tick.q) for tick in ticks[-500:])
    assert ticks[-1].events == ()


def test_the_arm_returns_home_in_the_null_space_only(arm: Arm, plain: PlainArm) -> None:
    """Where the arm has a joint to spare, posture changes while the tool stays."""
    rng = np.random.default_rng(4)
    q0 = np.clip(arm.home + rng.uniform(-0.4, 0.4, arm.n), arm.q_min, arm.q_max)
    stream, lazy = StreamIk().build(arm), StreamIk(home_gain=0.0).build(arm)
    target = arm.pose(q0)
    stream.reset(q0)
    lazy.reset(q0)
    ticks = commands(stream, [target] * 1500)
    assert max(plain.errors(tick.q, target)[0] for tick in ticks[::50]) < 1e-4
    assert np.abs(commands(lazy, [target] * 200)[-1].q - q0).max() < 1e-9
    assert spare(arm, ticks[-1].q) <= 0.5 * spare(arm, q0) + 1e-9


def spare(arm: Arm, q: Vector) -> float:
    """Length of the way home that the tool would not notice [rad]."""
    J: Matrix = arm.jacobian(q)
    way = arm.home - q
    return float(np.linalg.norm(way - np.linalg.pinv(J) @ J @ way))


@pytest.fixture(scope="module")
def among(robot: Robot) -> Arm:
    """The arm over a table, with a ball in the way of its tool."""
    tool = Arm(robot).pose(Arm(robot).home).translation()
    table = SE3.from_translation(np.array([tool[0], tool[1], tool[2] - 0.25]))
    ball = SE3.from_translation(tool + np.array([0.0, 0.3, 0.0]))
    return Arm(
        robot,
        obstacles=[
            Obstacle(name="table", shape=Shape.BOX, size=(0.2, 0.3, 0.02), T_world_obstacle=table),
            Obstacle(name="ball", shape=Shape.SPHERE, size=(0.08,), T_world_obstacle=ball),
        ],
    )


def test_clearance_and_limits_hold_whatever_the_target_does(
    among: Arm, rng: np.random.Generator
) -> None:
    clearance = Clearance(among, 0.01)
    assert len(clearance.pairs.kept) >= 30
    for profile in (among.robot.rated, among.robot.profile):
        stream = StreamIk(profile=profile, clearance=0.01).build(among)
        ticks = commands(stream, hostile(among, rng, 2500))
        audit(among, ticks, among.home, profile)
        least = [clearance.nearest(tick.q)[0] for tick in ticks[::3]]
        assert min(least) >= 0.01
        assert min(least) < 0.03  # it came close enough to tell
        assert stream.counts[Event.TOO_CLOSE] == 0
        assert stream.counts[Event.NO_ANSWER] == 0
        for event in Event:
            assert stream.counts[event] == sum(event in tick.events for tick in ticks)


@pytest.fixture(scope="module")
def pressed(among: Arm) -> list[StreamTick]:
    """Three seconds of a target in the middle of the ball."""
    return commands(StreamIk(clearance=0.01).build(among), [into_the_ball(among)] * 3000)


def into_the_ball(among: Arm) -> SE3:
    ball = among.obstacles[1].T_world_obstacle.translation()
    return SE3.from_rotation_and_translation(among.pose(among.home).rotation(), ball)


def test_before_a_target_inside_an_obstacle_the_arm_stops(
    among: Arm, pressed: list[StreamTick]
) -> None:
    clearance = Clearance(among, 0.01)
    distances = [clearance.nearest(tick.q)[0] for tick in pressed[::5]]
    assert min(distances) >= 0.01
    assert min(distances) < 0.015
    blind = commands(StreamIk().build(among), [into_the_ball(among)] * 2000)
    assert min(clearance.nearest(tick.q)[0] for tick in blind[::20]) < 0.0
    assert pressed[-1].position_error < pressed[0].position_error
    assert np.abs(pressed[-1].v / among.robot.profile.v_max).max() < 0.1
    nearest = clearance.nearest(pressed[-2].q)[0]
    assert pressed[-1].clearance == pytest.approx(nearest, abs=1e-9)
    assert pressed[-1].rows > 0


def test_a_start_too_close_is_told_and_parted(among: Arm, pressed: list[StreamTick]) -> None:
    wider = Clearance(among, 0.02)
    q0 = pressed[-1].q
    assert wider.nearest(q0)[0] < 0.015
    stream = StreamIk(clearance=0.02).build(among)
    stream.reset(q0)
    ticks = commands(stream, [into_the_ball(among)] * 1500)
    assert Event.TOO_CLOSE in ticks[0].events
    assert Event.TOO_CLOSE not in ticks[-1].events
    assert wider.nearest(ticks[-1].q)[0] >= 0.02
    audit(among, ticks, q0, among.robot.profile)


def test_returned_arrays_are_the_callers_own(arm: Arm) -> None:
    stream = StreamIk().build(arm)
    tick = stream.tick(arm.pose(arm.home))
    tick.q[:], tick.v[:] = 99.0, 99.0
    stream.q[:] = 77.0
    stream.v[:] = 77.0
    assert np.abs(stream.tick(arm.pose(arm.home)).q).max() < 10.0


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("dt", 0.0, "dt must be above 0 and finite"),
        ("dt", -1e-3, "dt must be above 0 and finite"),
        ("dt", np.nan, "dt must be above 0 and finite"),
        ("dt", np.inf, "dt must be above 0 and finite"),
        ("margin", 0.5, r"margin must be at least 0 and below 0\.5"),
        ("clearance", -0.01, "clearance must be 0 or more and finite"),
        ("braking_share", 0.0, "braking_share must be above 0 and at most 1"),
        ("braking_share", 1.1, "braking_share must be above 0 and at most 1"),
        ("max_pairs", 0, "max_pairs must be a whole number, 1 or more"),
        ("gain", np.nan, "gain must be above 0 and finite"),
        ("gain", 500.0, r"gain must be at most 300 at a tick of 0.001 s, or it oscillates"),
        ("reserve", 1.5, "reserve must be above 0 and at most 1"),
        ("buffer", -1.0, "buffer must be 0 or more and finite"),
        ("home_gain", -1.0, "home_gain must be 0 or more and finite"),
        ("radian_length", -1.0, "radian_length must be above 0 and finite"),
    ],
)
def test_settings_without_sense_are_refused(name: str, value: float, message: str) -> None:
    settings: dict[str, Any] = {name: value}
    with pytest.raises(InvalidValueError, match=message):
        StreamIk(**settings)


def test_a_backend_or_a_start_that_is_none_is_refused(arm: Arm) -> None:
    with pytest.raises(UnknownNameError, match="No QP solver is called 'nosuch'"):
        StreamIk(backend="nosuch").build(arm)
    stream = StreamIk().build(arm)
    with pytest.raises(InvalidValueError, match="q must be a vector of"):
        stream.reset(np.full(arm.n, np.nan))
    with pytest.raises(InvalidValueError, match="v must be a vector of"):
        stream.reset(arm.home, np.zeros(arm.n + 1))


def test_too_close_is_closer_than_the_clearance_whatever_is_aimed_at(
    among: Arm, pressed: list[StreamTick]
) -> None:
    q0 = pressed[-1].q
    nearest = Clearance(among, 0.01).nearest(q0)[0]
    for clearance, told in ((nearest - 1e-3, False), (nearest + 1e-4, True)):
        stream = StreamIk(clearance=clearance, buffer=2e-3).build(among)
        stream.reset(q0)
        assert (Event.TOO_CLOSE in stream.tick(among.pose(q0)).events) is told
