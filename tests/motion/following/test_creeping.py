"""Creeping and what blocks it: judged by MuJoCo's kinematics of the file alone."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.errors import RefusalReason
from robo47_qp.ik.gauss_newton import Stall
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.solver import IkResult, Reason, Tolerance
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.tool_poses import Target
from robo47_qp.motion.following import small_steps
from robo47_qp.motion.following.small_steps import (
    STRIDE,
    block_reason,
    deviation_reason,
    follow_in_small_steps,
    single_start,
    solve_nearby,
)
from tests.examples import shifted, turned
from tests.plain_arm import PlainArm
from tests.robots import robot_named

PANDA_ARM, PANDA_PLAIN = Arm(PANDA), PlainArm(PANDA)
HINGED, HINGED_PLAIN = Arm(robot_named("hinge6")), PlainArm(robot_named("hinge6"))
TIGHT = Tolerance()
STRETCHED = np.array([2.895, 1.237, 0.083, -0.564, -0.678, 1.029])
BENT = np.array([2.805, 1.332, -0.012, -0.469, -0.583, 0.934])
"""The hinged arm a little short of straight, and bent to the other side: on the way between, slopes
lead nowhere."""


@dataclass
class Stubborn:
    """Gives one answer, changed; remembers what was asked."""

    found: Callable[[Vector], Vector]
    converges: bool
    tolerance: Tolerance = TIGHT
    asked: list[Target] = field(default_factory=list)

    def solve(self, arm: Arm, T_world_target: Target, q_seed: Vector) -> IkResult:
        self.asked.append(T_world_target)
        reached = LmIk().solve(arm, arm.pose(q_seed), q_seed)
        told = replace(reached, q=self.found(q_seed))
        return told if self.converges else replace(told, reason=Reason.NOT_CONVERGED)


def moved(arm: Arm, q: Vector, by: float) -> SE3:
    return arm.pose(q + by * np.cos(np.arange(arm.n)))


@pytest.mark.parametrize(
    ("arm", "plain"), [(PANDA_ARM, PANDA_PLAIN), (HINGED, HINGED_PLAIN)], ids=["panda", "hinge6"]
)
def test_a_pose_next_to_it_is_reached_and_one_further_away_is_not(
    arm: Arm, plain: PlainArm
) -> None:
    target = moved(arm, arm.home, 0.05)
    found = solve_nearby(arm, target, arm.home, TIGHT, starts=0)
    assert found is not None
    assert max(plain.errors(found, target)) <= 1e-6
    assert np.abs(found - arm.home).max() <= STRIDE
    assert solve_nearby(arm, shifted(arm.pose(arm.home), np.full(3, 0.1)), arm.home, TIGHT) is None
    assert solve_nearby(arm, turned(arm.pose(arm.home), 2, 0.6), arm.home, TIGHT) is None


def test_position_and_turn_are_held_to_their_own_tolerance() -> None:
    arm, q = PANDA_ARM, PANDA_ARM.home
    away, askew = shifted(arm.pose(q), np.full(3, 0.1)), turned(arm.pose(q), 2, 0.6)
    assert solve_nearby(arm, away, q, Tolerance(position=1.0, orientation=1.0)) is not None
    assert solve_nearby(arm, away, q, Tolerance(orientation=10.0), starts=0) is None
    assert solve_nearby(arm, askew, q, Tolerance(position=10.0), starts=0) is None


@pytest.mark.parametrize("side", [-1, 1])
def test_limits_are_kept_unless_they_are_not_to_be(side: int) -> None:
    arm, q = HINGED, HINGED.home.copy()
    q[-1] = (arm.q_max if side > 0 else arm.q_min)[-1] - side * 0.02
    beyond = q + side * np.eye(arm.n)[-1] * 0.05
    target = arm.pose(beyond)
    assert solve_nearby(arm, target, q, TIGHT) is None
    assert solve_nearby(arm, target, q, TIGHT, limits=False) == pytest.approx(beyond, abs=1e-5)


def test_where_slopes_tell_nothing_it_starts_from_around_always_the_same() -> None:
    target = HINGED.pose(BENT)
    assert solve_nearby(HINGED, target, STRETCHED, TIGHT, starts=0) is None
    found, again = (solve_nearby(HINGED, target, STRETCHED, TIGHT) for _ in range(2))
    assert found is not None
    assert again is not None
    assert found.tobytes() == again.tobytes()
    assert max(HINGED_PLAIN.errors(found, target)) <= 1e-6


@pytest.mark.parametrize("converges", [False, True])
def test_a_solver_that_fails_or_lands_elsewhere_is_not_what_decides(converges: bool) -> None:
    way = np.cos(np.arange(7.0))
    q, ik = PANDA_ARM.home, Stubborn(lambda q: q + 0.5, converges)
    asked: list[float] = []

    def at(x: float) -> SE3:
        asked.append(x)
        return PANDA_ARM.pose(q + 0.2 * x * way)

    crept = follow_in_small_steps(PANDA_ARM, ik, q, at)
    assert (crept.stuck, crept.at, max(asked)) == (None, 1.0, 1.0)
    assert max(PANDA_PLAIN.errors(crept.q, at(1.0))) <= 1e-6
    assert np.abs(crept.q - q).max() < 0.4
    assert len(crept.results) == len(ik.asked)


def test_it_tells_how_far_it_came_and_what_is_next() -> None:
    q = HINGED.home.copy()
    q[-1] = HINGED.q_max[-1] - 0.5
    start = HINGED.pose(q)

    def at(x: float) -> SE3:
        return turned(start, 2, x)

    crept = follow_in_small_steps(HINGED, LmIk(), q, at)
    assert isinstance(crept.stuck, SE3)
    assert crept.at == pytest.approx(0.5, abs=0.05)
    assert max(HINGED_PLAIN.errors(crept.q, at(crept.at))) <= 2e-6
    assert max(HINGED_PLAIN.errors(crept.q, crept.stuck)) == pytest.approx(2.0**-10, rel=0.01)
    assert HINGED_PLAIN.inside(crept.q)


def test_before_it_is_stuck_it_looks_from_around(monkeypatch: pytest.MonkeyPatch) -> None:
    def only_from_around(*_: object, starts: int, **__: object) -> Vector | None:
        return PANDA.home if starts else None

    monkeypatch.setattr(small_steps, "solve_nearby", only_from_around)
    here, ik = PANDA_ARM.pose(PANDA.home), Stubborn(lambda q: q, False)
    assert follow_in_small_steps(PANDA_ARM, ik, PANDA.home, lambda _: here).stuck is None


def test_of_a_solver_with_many_starts_the_patient_one_start_is_taken() -> None:
    alone = single_start(MultiStart(solver=LmIk(max_iterations=5, stall=Stall())))
    assert isinstance(alone, LmIk)
    assert alone == LmIk(max_iterations=5, stall=Stall()).thorough()
    other = Stubborn(lambda q: q, True)
    assert single_start(other) is other


# What blocks


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("joint", [3, 5])
def test_a_limit_is_told_with_its_joint(side: int, joint: int) -> None:
    arm, q = HINGED, HINGED.home.copy()
    q[joint] = (arm.q_max if side > 0 else arm.q_min)[joint] - side * 0.02
    target = arm.pose(q + side * np.eye(arm.n)[joint] * 0.05)
    assert block_reason(arm, q, target) == (RefusalReason.JOINT_LIMIT, arm.robot.joints[joint])


def test_reach_is_told() -> None:
    out = HINGED.pose(STRETCHED).translation() - [0.05, -0.02, 0.3]
    target = shifted(HINGED.pose(STRETCHED), 0.05 * out / np.linalg.norm(out))
    assert block_reason(HINGED, STRETCHED, target)[0] is RefusalReason.REACH


def test_a_straight_wrist_is_a_singularity_of_its_two_parallel_joints() -> None:
    """It turns about one axis at once only after roll and twist have turned against each other."""
    q = np.array([0.3, 0.4, -1.2, 0.2, 0.0, 0.4])
    roll = HINGED.pose(q + np.array([0.0, 0.0, 0.0, 0.5 * np.pi, 0.02, -0.5 * np.pi]))
    reason, joint = block_reason(HINGED, q, roll)
    assert reason is RefusalReason.SINGULARITY
    assert joint in ("roll", "twist")


def test_another_branch_is_told_with_the_joint_that_differs_most() -> None:
    q = HINGED.home
    target = HINGED.pose(q + 0.8 * np.eye(6)[0])
    assert block_reason(HINGED, q, target) == (RefusalReason.BRANCH, "waist")


@pytest.mark.parametrize("side", [-1, 1])
def test_a_rough_path_along_a_limit_is_told_where(side: int) -> None:
    knots = np.tile(PANDA_ARM.home, (5, 1))
    knots[2, 4] = (PANDA_ARM.q_max if side > 0 else PANDA_ARM.q_min)[4] - side * 5e-4
    reason, joint, q = deviation_reason(
        PANDA_ARM, knots, PANDA_ARM.home, PANDA_ARM.pose(PANDA_ARM.home)
    )
    assert (reason, joint, q.tolist()) == (RefusalReason.JOINT_LIMIT, "joint5", knots[2].tolist())


def test_a_rough_path_is_near_a_singularity_or_has_too_few_knots() -> None:
    straight = np.array([0.3, 0.4, -1.2, 0.2, 0.0, 0.4])
    for q, wanted in (
        (straight, RefusalReason.SINGULARITY),
        (HINGED.home, RefusalReason.PRECISION),
    ):
        knots = np.tile(HINGED.home, (5, 1))
        reason, joint, where = deviation_reason(HINGED, knots, q, HINGED.pose(q))
        assert (reason, where.tolist()) == (wanted, q.tolist())
        assert joint in HINGED.robot.joints
        if wanted is RefusalReason.SINGULARITY:
            assert joint in ("roll", "twist")
