"""Joint paths: smooth where stretches meet, on them elsewhere, refused where there is no room."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.following.joint_path import JointPath, Stretch
from robo47_qp.motion.paths.curves import BlendError
from tests.plain_arm import PlainArm

ARM, PLAIN = Arm(PANDA), PlainArm(PANDA)
TIMES = np.array([1.0, 0.5, 2.0])
RADII = (0.03, 0.02)
MEETS = np.cumsum(TIMES)[:-1]


@dataclass(frozen=True)
class Straight:
    """From one configuration to another, as the parameter rises."""

    first: Vector
    last: Vector

    def __call__(self, x: Vector | float, nu: int = 0) -> Matrix:
        way = self.last - self.first
        x = np.asarray(x, dtype=float)[..., None]
        orders = (self.first + x * way, 0.0 * x + way, 0.0 * (x + way))
        found: Matrix = orders[nu]
        return found


def corners() -> list[Vector]:
    """Four configurations, with turns of different joints between them."""
    found = [ARM.home]
    for joint, by in ((0, 0.5), (1, 0.3), (3, -0.6)):
        q = found[-1].copy()
        q[joint] += by
        found.append(q)
    return found


def stretches() -> list[Stretch]:
    ends = corners()
    return [
        Stretch(
            curve=Straight(ends[i], ends[i + 1]),
            time=float(time),
            cuts=np.array([0.0, 0.01, 0.5, 0.99, 1.0]),
            passes=np.array([0.25]) if i == 2 else np.zeros(0),
        )
        for i, time in enumerate(TIMES)
    ]


def path(radii: tuple[float, float] = RADII) -> JointPath:
    return JointPath(ARM, stretches(), radii)


def tool(q: Vector) -> Vector:
    return np.asarray(PLAIN.tool(q)[0])


def off_stretches(q: Matrix) -> Vector:
    """Distance of each configuration from the nearest of the straight stretches [rad]."""
    found = []
    ends = corners()
    for a, b in pairwise(ends):
        s = np.clip((q - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        found.append(np.abs(q - a - s[:, None] * (b - a)).max(axis=1))
    nearest: Vector = np.min(found, axis=0)
    return nearest


def test_it_is_continuous_up_to_the_curvature() -> None:
    """Each order is the slope of the one before, also across the ends of the bends."""
    one, step = path(), 1e-4
    s = np.arange(step, 1.0 - step, step)
    for nu in (0, 1):
        slope = (one(s + step, nu) - one(s - step, nu)) / (2.0 * step)
        scale = np.abs(one(s, nu + 1)).max()
        assert np.abs(slope - one(s, nu + 1)).max() < 2e-2 * scale
    second = one(s, 2)
    assert np.abs(np.diff(second, axis=0)).max() < 0.03 * np.abs(second).max()
    np.testing.assert_allclose(one(0.0), corners()[0])
    np.testing.assert_allclose(one(1.0), corners()[-1])
    np.testing.assert_array_equal(one(0.3, 1), one(np.array([0.3]), 1)[0])


def test_the_tool_leaves_the_stretches_within_its_radii_and_uses_one_side_of_each_up() -> None:
    one = path()
    s = np.linspace(0.0, 1.0, 20_001)
    q = one(s)
    bent = off_stretches(q) > 1e-9
    assert one.time == pytest.approx(TIMES.sum())
    for meet, corner, radius in zip(MEETS, corners()[1:-1], RADII, strict=True):
        mine = bent & (np.abs(s * one.time - meet) < 0.25)
        away = [float(np.linalg.norm(tool(row) - tool(corner))) for row in q[mine][[0, -1]]]
        assert max(away) <= radius + 1e-9
        assert max(away) == pytest.approx(radius, abs=1e-3)
        # As long before the meeting as after it.
        first, last = s[mine][[0, -1]] * one.time
        assert meet - first == pytest.approx(last - meet, abs=1e-3)
        assert meet - first > 0.01


def test_it_tells_where_waypoints_are_passed_and_sections_end() -> None:
    one = path()
    wanted = [MEETS[0], MEETS[1], MEETS[1] + 0.25 * TIMES[2]]
    assert (one.passes * one.time).tolist() == pytest.approx(wanted)
    cuts = one.cuts * one.time
    assert (np.diff(cuts) > 0.0).all()
    assert cuts[[0, -1]].tolist() == pytest.approx([0.0, TIMES.sum()])
    s = np.linspace(0.0, 1.0, 20_001)
    bent = s[off_stretches(one(s)) > 1e-9] * one.time
    for meet in MEETS:
        mine = bent[np.abs(bent - meet) < 0.25]
        # Both ends of the bend are cuts, and nothing inside it is one.
        for edge in (mine[0], mine[-1]):
            assert np.abs(cuts - edge).min() < 1e-3
        assert not ((cuts > mine[0] + 1e-3) & (cuts < mine[-1] - 1e-3)).any()
    for start, time in zip([0.0, *MEETS], TIMES, strict=True):
        assert np.abs(cuts - (start + 0.5 * time)).min() < 1e-12


def test_a_stretch_without_room_for_both_its_bends_is_named() -> None:
    length = float(np.linalg.norm(tool(corners()[2]) - tool(corners()[1])))
    enough = 0.4 * length
    assert len(path((enough, enough)).passes) == 3
    with pytest.raises(BlendError, match=r"would take 1[12]\d % of it") as caught:
        path((0.6 * length, 0.6 * length))
    assert caught.value.segment == 1
    with pytest.raises(BlendError, match=r"ends within the blend radius of \d+\.\d mm") as caught:
        path((1.1 * length, 0.01))
    assert caught.value.segment == 1


@dataclass(frozen=True)
class Wave:
    """The first joint swings away and back and away."""

    first: Vector

    def __call__(self, x: Vector | float, nu: int = 0) -> Matrix:
        x = np.asarray(x, dtype=float)[..., None]
        w = 2.5 * np.pi
        swing = (np.sin(w * x), w * np.cos(w * x), -(w**2) * np.sin(w * x))[nu]
        found: Matrix = (self.first if nu == 0 else 0.0 * self.first) + 0.3 * np.eye(7)[0] * swing
        return found


def test_a_bend_ends_where_the_tool_first_leaves_the_radius() -> None:
    ends, radius = corners(), 0.05
    wave = Wave(ends[1])
    none = {"cuts": np.array([0.0, 1.0]), "passes": np.zeros(0)}
    pair = [
        Stretch(curve=Straight(ends[0], ends[1]), time=10.0, **none),
        Stretch(curve=wave, time=10.0, **none),
    ]
    (end,) = [cut for cut in JointPath(ARM, pair, [radius]).cuts * 20.0 if 10.0 < cut < 20.0]
    u = np.linspace(0.0, 1.0, 4001)
    away = np.array([np.linalg.norm(tool(q) - tool(ends[1])) for q in wave(u)])
    assert (np.diff(np.sign(away - radius)) != 0).sum() == 5
    side = Straight(ends[1], ends[0])
    back = np.array([np.linalg.norm(tool(q) - tool(ends[1])) for q in side(u)])
    swings, comes = (10.0 * u[np.argmax(way > radius)] for way in (away, back))
    assert swings < comes
    assert end - 10.0 == pytest.approx(swings, abs=3e-3)
