"""The judge of IK answers, against answers made by hand."""

import mujoco
import numpy as np
import pytest
from hypothesis import given
from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.evaluation.benchmarks.ik.judge import LOOSE, TIGHT, IkVerdict, Judge
from robo47_qp.ik.solver import Tolerance
from robo47_qp.model.arm import Arm
from robo47_qp.model.obstacle import Obstacle, Shape
from robo47_qp.model.robot import Robot
from robo47_qp.model.robots.panda import PANDA
from tests.examples import fractions, inner_fractions, poses, shifted, turned
from tests.plain_arm import PlainArm

JUDGE = Judge(PANDA)
ARM = Arm(PANDA)
PLAIN = PlainArm(PANDA)
# The hand is in the foot of the base, every joint in its range.
FOLDED = np.array([0.0, 1.7, 0.0, -2.9, 0.0, 0.5, 0.8])


def test_the_limits_of_success_are_those_promised() -> None:
    assert LOOSE.position == 1e-3
    assert LOOSE.orientation == pytest.approx(0.1 * np.pi / 180)
    assert Tolerance(position=1e-4, orientation=1e-3) == TIGHT


def test_the_right_answer_is_right(robot: Robot) -> None:
    home = np.asarray(robot.home)
    verdict = Judge(robot).verdict(Arm(robot).pose(home), home)
    assert verdict.position_error < 1e-12
    assert verdict.orientation_error < 1e-7
    assert verdict.limit_excess == 0.0
    assert verdict.free
    assert verdict.pair is None
    assert verdict.within(TIGHT)


@given(at=fractions, target=poses)
def test_errors_are_those_of_elementary_geometry(at: Vector, target: SE3) -> None:
    q = PLAIN.at(at)
    verdict = JUDGE.verdict(target, q)
    position, angle = PLAIN.errors(q, target)
    assert verdict.position_error == pytest.approx(position, abs=1e-12)
    assert verdict.orientation_error == pytest.approx(angle, abs=1e-7)


@pytest.mark.parametrize(
    ("away", "loose", "tight"),
    [
        (0.99e-4, True, True),
        (1.01e-4, True, False),
        (0.99e-3, True, False),
        (1.01e-3, False, False),
    ],
)
def test_distance_decides(away: float, loose: bool, tight: bool) -> None:
    target = shifted(ARM.pose(PANDA.home), np.array([0.0, away, 0.0]))
    verdict = JUDGE.verdict(target, PANDA.home)
    assert (verdict.within(LOOSE), verdict.within(TIGHT)) == (loose, tight)


@pytest.mark.parametrize(
    ("angle", "loose", "tight"),
    [
        (0.99e-3, True, True),
        (1.01e-3, True, False),
        (1.74e-3, True, False),
        (1.75e-3, False, False),
    ],
)
def test_angle_decides(angle: float, loose: bool, tight: bool) -> None:
    target = turned(ARM.pose(PANDA.home), 1, angle)
    verdict = JUDGE.verdict(target, PANDA.home)
    assert (verdict.within(LOOSE), verdict.within(TIGHT)) == (loose, tight)


def test_half_a_turn_is_half_a_turn() -> None:
    verdict = JUDGE.verdict(turned(ARM.pose(PANDA.home), 0, np.pi), PANDA.home)
    assert verdict.orientation_error == pytest.approx(np.pi, abs=1e-7)


@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize("side", [-1, 1])
def test_a_billionth_outside_a_limit_is_outside(joint: int, side: int) -> None:
    q = np.array(PANDA.home)
    limit = PLAIN.q_max[joint] if side > 0 else PLAIN.q_min[joint]
    q[joint] = limit
    assert JUDGE.verdict(ARM.pose(q), q).within(TIGHT)
    q[joint] = limit + side * 1e-9
    verdict = JUDGE.verdict(ARM.pose(q), q)
    assert verdict.limit_excess == pytest.approx(1e-9, rel=1e-3)
    assert not verdict.within(LOOSE)


def test_an_arm_inside_itself_is_not_free() -> None:
    assert PLAIN.inside(FOLDED)
    verdict = JUDGE.verdict(ARM.pose(FOLDED), FOLDED)
    assert verdict.within(TIGHT)
    assert not verdict.free
    assert verdict.penetration > 1e-3
    assert verdict.pair is not None
    assert set(verdict.pair) <= {PLAIN.full.body(i).name for i in range(PLAIN.full.nbody)}


@given(at=inner_fractions)
def test_contacts_are_those_of_mujocos_own_forward_pass(at: Vector) -> None:
    q = PLAIN.at(at)
    m, d = PLAIN.full, mujoco.MjData(PLAIN.full)
    d.qpos[: len(q)] = q
    mujoco.mj_forward(m, d)
    touching = [distance for distance in d.contact.dist if distance < 0.0]
    verdict = JUDGE.verdict(ARM.pose(q), q)
    assert verdict.free is (not touching)
    assert verdict.penetration == pytest.approx(-min(touching, default=0.0), abs=1e-12)


def test_what_stands_around_counts_and_what_touches_at_home_does_not() -> None:
    q = PANDA.home + np.array([1.0, 0.3, 0.0, 0.3, 0.0, 0.0, 0.0])
    there, home = ARM.pose(q), ARM.pose(PANDA.home)

    def with_ball(place: SE3) -> Judge:
        ball = Obstacle(name="ball", shape=Shape.SPHERE, size=(0.05,), T_world_obstacle=place)
        return Judge(PANDA, [ball])

    assert JUDGE.verdict(there, q).free
    assert with_ball(there).verdict(home, PANDA.home).free
    assert not with_ball(there).verdict(there, q).free
    assert with_ball(home).verdict(home, PANDA.home).free


@pytest.mark.parametrize("q", [np.full(7, np.nan), np.zeros(6), np.zeros((7, 1)), [np.inf] * 7])
def test_no_configuration_is_no_answer(q: Vector) -> None:
    verdict = JUDGE.verdict(ARM.pose(PANDA.home), q)
    assert verdict.position_error == np.inf
    assert not verdict.within(LOOSE)
    assert not verdict.within(Tolerance(position=1e9, orientation=1e9))


def test_no_pose_is_never_reached() -> None:
    for numbers in (np.full(7, np.nan), np.zeros(7)):
        assert not JUDGE.verdict(SE3(numbers), PANDA.home).within(LOOSE)


def test_a_verdict_needs_all_three() -> None:
    fine = IkVerdict(0.0, 0.0, 0.0, 0.0, None)
    assert fine.within(TIGHT)
    assert not fine._replace(position_error=1.0).within(LOOSE)
    assert not fine._replace(orientation_error=1.0).within(LOOSE)
    assert not fine._replace(limit_excess=1e-12).within(LOOSE)
