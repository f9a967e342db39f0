"""IK of several tools at once, on two arms."""

from dataclasses import replace

import numpy as np
import pytest
from mink import SE3

from robo47_qp.collision.clearance import Clearance
from robo47_qp.errors import UnknownNameError
from robo47_qp.ik.dls import DlsIk
from robo47_qp.ik.gauss_newton import Stall
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.mink import MinkIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.qp import QpIk
from robo47_qp.ik.seeds import library_of
from robo47_qp.ik.solver import IkSolver, Reason
from robo47_qp.ik.tool_error import error_to
from robo47_qp.model.arm import Arm
from robo47_qp.model.obstacle import Obstacle, Shape
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.robots.panda_pair import panda_pair
from robo47_qp.model.tool_poses import ToolPoses
from robo47_qp.stack import ClassicalStack

SINGLE = (MinkIk(), QpIk(), LmIk(), DlsIk())


@pytest.fixture(scope="module")
def pair() -> Arm:
    return Arm(panda_pair())


def both(arm: Arm, q: np.ndarray, q_right: np.ndarray | None = None) -> ToolPoses:
    right = arm.pose(q if q_right is None else q_right, 1)
    return ToolPoses({"left": arm.pose(q, 0), "right": right})


def test_what_only_another_tool_stands_in_is_not_inevitable() -> None:
    """The target is of the right tool alone; the left hand begins in an obstacle."""
    free = Arm(panda_pair())
    x, y, z = free.pose(free.home, 0).translation()
    block = Obstacle(
        name="block",
        shape=Shape.BOX,
        size=(0.03, 0.03, 0.03),
        T_world_obstacle=SE3.from_translation(np.array([x, y + 0.12, z + 0.08])),
    )
    arm = Arm(panda_pair(), obstacles=[block])
    there = SE3.from_translation(np.array([0.1, 0.0, -0.1])) @ free.pose(free.home, 1)
    ik = MultiStart(solver=LmIk(max_iterations=30, stall=Stall(), clearance=0.01))
    assert Clearance(arm, 0.01).nearest(arm.home)[0] < 0.0
    found = ik.solve(arm, ToolPoses({"right": there}), arm.home)
    assert found.converged
    assert Clearance(arm, 0.01).nearest(found.q)[0] >= 0.01 - 1e-9
    both_told = ToolPoses({"left": free.pose(free.home, 0), "right": there})
    stuck = ik.solve(arm, both_told, arm.home)
    assert (stuck.reason, stuck.inevitable) == (Reason.COLLISION, True)
    assert stuck.pair == ("left_hand", "block")


def inside(arm: Arm, rng: np.random.Generator) -> np.ndarray:
    q: np.ndarray = rng.uniform(arm.q_min, arm.q_max)
    return q


@pytest.mark.parametrize("ik", SINGLE, ids=lambda ik: type(ik).__name__)
def test_both_tools_get_where_they_are_near(pair: Arm, ik: IkSolver) -> None:
    rng = np.random.default_rng(0)
    for _ in range(5):
        q = 0.5 * (pair.home + inside(pair, rng))
        found = ik.solve(pair, both(pair, q), q + rng.uniform(-0.05, 0.05, pair.n))
        assert found.converged
        for tool in (0, 1):
            away = pair.pose(q, tool).inverse() @ pair.pose(found.q, tool)
            assert np.linalg.norm(away.log()) < 5e-6


@pytest.mark.parametrize("name", ["mink", "qp", "lm"])
def test_poses_of_both_are_found_from_home(pair: Arm, name: str) -> None:
    ik, rng = ClassicalStack(ik=name).solver(), np.random.default_rng(1)
    for _ in range(20):
        target = both(pair, inside(pair, rng))
        found = ik.solve(pair, target, pair.home)
        assert found.converged, found.explanation
        assert max(pair.pose_distance(target, found.q)) <= 1e-6
        assert pair.limit_margin(found.q) >= 0.0


def test_the_arms_stay_clear_of_each_other(pair: Arm) -> None:
    ik, rng = ClassicalStack(ik="qp").solver(0.01), np.random.default_rng(2)
    clearance, looked = pair.derived(Clearance, 0.01), 0
    while looked < 10:
        q = inside(pair, rng)
        if clearance.clear(q, 0.01):
            looked += 1
            found = ik.solve(pair, both(pair, q), pair.home)
            assert found.converged, found.explanation
            assert clearance.nearest(found.q)[0] >= 0.01 - 1e-9


def test_tools_in_one_place_are_refused_as_a_collision(pair: Arm) -> None:
    pose = SE3.from_rotation_and_translation(
        pair.pose(pair.home, 0).rotation(), np.array([0.5, 0.0, 0.4])
    )
    target = ToolPoses({"left": pose, "right": pose})
    ik = ClassicalStack(ik="qp").solver(0.01)
    assert isinstance(ik, MultiStart)
    found = replace(ik, max_restarts=6).solve(pair, target, pair.home)
    assert found.reason is Reason.COLLISION
    assert found.pair is not None
    assert {name.split("_")[0] for name in found.pair} == {"left", "right"}


def test_a_tool_that_is_not_named_keeps_its_joints(pair: Arm) -> None:
    ik, rng = ClassicalStack(ik="qp").solver(), np.random.default_rng(3)
    for _ in range(5):
        q, seed = inside(pair, rng), inside(pair, rng)
        for target, kept in (
            (pair.pose(q), slice(7, 14)),
            (ToolPoses({"left": pair.pose(q, 0)}), slice(7, 14)),
            (ToolPoses({"right": pair.pose(q, 1)}), slice(0, 7)),
        ):
            found = ik.solve(pair, target, seed)
            assert found.converged, found.explanation
            assert found.q[kept].tolist() == seed[kept].tolist()


def test_one_tool_out_of_reach_is_told(pair: Arm) -> None:
    far = SE3.from_translation(np.array([0.4, -1.9, 0.4]))
    target = ToolPoses({"left": pair.pose(pair.home, 0), "right": far})
    found = ClassicalStack(ik="qp").solver().solve(pair, target, pair.home)
    assert found.reason is Reason.OUT_OF_REACH
    assert found.beyond_reach == pair.beyond_reach(far.translation(), 1) > 0.0


def test_a_tool_that_is_not_there_is_bad_input(pair: Arm) -> None:
    target = ToolPoses({"middle": SE3.identity()})
    for ik in SINGLE:
        with pytest.raises(UnknownNameError, match="middle"):
            ik.solve(pair, target, pair.home)


def test_the_error_of_several_tools_is_theirs_one_after_the_other(pair: Arm) -> None:
    rng = np.random.default_rng(4)
    q, q_target = inside(pair, rng), inside(pair, rng)
    target, whole = both(pair, q_target), error_to(pair, (0, 1))
    whole.set_target(target)
    squares = whole.move(q)
    whole.update_jacobian()
    parts = []
    for tool, pose in enumerate(target.values()):
        part = error_to(pair, (tool,))
        part.set_target(pose)
        parts.append(part.move(q))
        part.update_jacobian()
        rows = slice(6 * tool, 6 * tool + 6)
        assert whole.e[rows].tolist() == part.e.tolist()
        assert whole.J[rows].tolist() == part.J.tolist()
    np.testing.assert_allclose(squares, np.sum(parts, axis=0), rtol=1e-12)


def test_the_library_of_one_of_two_arms_is_that_of_the_arm_alone(pair: Arm) -> None:
    alone = library_of(Arm(PANDA), 50)
    for tool, joints in enumerate((slice(0, 7), slice(7, 14))):
        library = library_of(pair, 50, tool)
        assert library.q[:, joints].tolist() == alone.q.tolist()
        np.testing.assert_allclose(library.feature[:, 3:], alone.feature[:, 3:], atol=1e-6)
