"""Demands on the tool: what is left of them, seeds, reasons, and that they are reached."""

import numpy as np
import pytest
from mink import SE3

from robo47_qp.collision.clearance import Clearance
from robo47_qp.errors import InvalidValueError
from robo47_qp.ik.damping import Damping
from robo47_qp.ik.dls import DlsIk
from robo47_qp.ik.gauss_newton import Stall
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.mink import MinkIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.qp import QpIk
from robo47_qp.ik.solver import Reason, Tolerance
from robo47_qp.ik.tool_demand import FULL, POSITION, Direction, FreeAxis, ToolDemand
from robo47_qp.ik.tool_error import error_to
from robo47_qp.model.arm import Arm
from robo47_qp.model.obstacle import Obstacle, Shape
from robo47_qp.model.robots.panda import PANDA
from tests.composed import ARM, left, several, somewhere
from tests.examples import turned

DEMANDS: list[ToolDemand] = [FULL, FreeAxis(), FreeAxis((1.0, 2.0, 0.5)), Direction(), POSITION]


EACH = pytest.mark.parametrize("demand", DEMANDS, ids=repr)


@EACH
def test_what_is_left_is_what_is_asked_for(demand: ToolDemand) -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        q, target = somewhere(rng), ARM.pose(somewhere(rng))
        expected = left(demand, q, target)
        assert demand.distance(ARM, target, q) == pytest.approx(expected, abs=1e-9)
        error = error_to(ARM, (0,), None, demand)
        error.set_target(target)
        assert np.sqrt(error.move(q)) == pytest.approx(expected, abs=1e-9)


@EACH
def test_errors_fall_by_their_jacobians_near_the_target(demand: ToolDemand) -> None:
    rng = np.random.default_rng(2)
    for _ in range(10):
        q = somewhere(rng)
        dq = 1e-5 * rng.standard_normal(ARM.n)
        target = turned(ARM.pose(q + dq), 2, 0.0)
        e, J = demand.error(ARM, target, q), demand.jacobian(ARM, target, q)
        assert e == pytest.approx(J @ dq, abs=1e-8)
        error = error_to(ARM, (0,), None, demand)
        error.set_target(target)
        error.move(q)
        error.update_jacobian()
        assert error.e == pytest.approx(error.J @ dq, abs=1e-8)


@EACH
def test_the_nearest_pose_is_as_good_as_the_goal_and_no_other_is_nearer(
    demand: ToolDemand,
) -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        q = somewhere(rng)
        start, goal = ARM.pose(q), ARM.pose(somewhere(rng))
        near = demand.nearest(start, goal)
        distance, angle = left(demand, q, near)
        assert (distance, angle) == pytest.approx(left(demand, q, goal), abs=1e-9)
        turn = (start.rotation().inverse() @ near.rotation()).log()
        # All turning that is left is asked for.
        assert np.linalg.norm(turn) == pytest.approx(angle, abs=1e-7)


@pytest.mark.parametrize("demand", DEMANDS[1:], ids=repr)
@pytest.mark.parametrize("kind", [MinkIk, LmIk])
def test_demands_are_reached_from_afar(demand: ToolDemand, kind: type[MinkIk | LmIk]) -> None:
    rng = np.random.default_rng(4)
    ik = MultiStart(
        solver=kind(max_iterations=30, stall=Stall(), tolerance=Tolerance(demand=demand))
    )
    for _ in range(20):
        target = ARM.pose(somewhere(rng, 0.0))
        result = ik.solve(ARM, target, ARM.home)
        assert result.converged, result.explanation
        assert max(left(demand, result.q, target)) < 1.1e-6
        assert (result.q >= ARM.q_min).all()
        assert (result.q <= ARM.q_max).all()


def test_a_free_axis_is_half_a_turn_away_at_most() -> None:
    """Opposite directions are no place to rest."""
    pose = ARM.pose(ARM.home)
    demand = FreeAxis()
    for axis in (0, 1):
        target = turned(pose, axis, np.pi)
        assert demand.distance(ARM, target, ARM.home)[1] == pytest.approx(np.pi)
        tolerance = Tolerance(demand=demand)
        step = MinkIk(max_iterations=1, tolerance=tolerance).solve(ARM, target, ARM.home)
        assert np.abs(step.q - ARM.home).max() > 0.1


@pytest.mark.parametrize("demand", [FreeAxis((1.0, 0.0, 0.0)), Direction((1.0, 0.0, 0.0))])
def test_the_nearest_pose_to_one_half_a_turn_away_has_the_axis(demand: FreeAxis) -> None:
    """To the last digit: there, the quaternion between the two has no real part."""
    starts = [np.array([0.0, 1.0, 0.0, 0.0]), ARM.pose(ARM.home).rotation().wxyz]
    exact = 0
    for start in starts:
        for goal in ([0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0]):
            a, b = (SE3(np.array([*q, 0.3, 0.1, 0.2])) for q in (start, goal))
            exact += (b.rotation() @ a.rotation().inverse()).wxyz[0] == 0.0
            found = demand.nearest(a, b).rotation().as_matrix()[:, 0]
            np.testing.assert_allclose(found, b.rotation().as_matrix()[:, 0], atol=1e-12)
    assert exact >= 3


@pytest.mark.parametrize("kind", [LmIk, MinkIk])
@pytest.mark.parametrize("demand", [FreeAxis(), POSITION])
def test_an_obstacle_that_another_turn_avoids_is_avoided(
    demand: ToolDemand, kind: type[MinkIk | LmIk]
) -> None:
    """Beside the hand, whose whole pose is not asked for: nothing is inevitable there."""
    home = ARM.pose(ARM.home)
    x, y, z = home.translation()
    block = Obstacle(
        name="block",
        shape=Shape.BOX,
        size=(0.03, 0.03, 0.03),
        T_world_obstacle=SE3.from_translation(np.array([x, y + 0.13, z + 0.08])),
    )
    arm = Arm(PANDA, obstacles=[block])
    solvers = {
        one: MultiStart(
            solver=kind(
                max_iterations=30, stall=Stall(), clearance=0.01, tolerance=Tolerance(demand=one)
            )
        )
        for one in (FULL, demand)
    }
    stuck = solvers[FULL].solve(arm, home, arm.home)
    assert (stuck.reason, stuck.inevitable, stuck.restarts) == (Reason.COLLISION, True, 0)
    free = solvers[demand].solve(arm, home, arm.home)
    assert free.converged
    assert Clearance(arm, 0.01).nearest(free.q)[0] >= 0.01 - 1e-9


def test_seeds_are_the_nearest_of_what_is_asked_for() -> None:
    """A target whose turn about its axis no seed has is found as fast as any other."""
    rng = np.random.default_rng(5)
    ik = several(tolerance=Tolerance(demand=FreeAxis()))
    restarts = []
    for _ in range(40):
        target = turned(ARM.pose(somewhere(rng)), 2, rng.uniform(-np.pi, np.pi))
        result = ik.solve(ARM, target, ARM.q_min)
        assert result.converged
        restarts.append(result.restarts)
    assert np.mean(restarts) < 1.5


def test_reasons_speak_of_what_is_asked_for() -> None:
    far = SE3.from_translation(np.array([0.0, 0.0, 3.0]))
    asked = Tolerance(demand=POSITION)
    assert several(tolerance=asked).solve(ARM, far, ARM.home).reason is Reason.OUT_OF_REACH
    pointing = several(tolerance=Tolerance(demand=Direction())).solve(ARM, far, ARM.home)
    assert pointing.converged


def test_a_solver_of_whole_poses_refuses_other_demands() -> None:
    with pytest.raises(InvalidValueError, match="demand must be FULL with"):
        QpIk(tolerance=Tolerance(demand=POSITION))


@pytest.mark.parametrize("demand", [FreeAxis(), Direction(), POSITION])
def test_dls_reaches_what_is_demanded_by_the_step_that_lm_takes(demand: ToolDemand) -> None:
    rng = np.random.default_rng(6)
    asked, law = Tolerance(demand=demand), Damping(constant=0.1)
    reached = 0
    for _ in range(8):
        target = ARM.pose(np.clip(ARM.home + rng.uniform(-0.6, 0.6, 7), ARM.q_min, ARM.q_max))
        dls = DlsIk(tolerance=asked, clip=False, damping=law, max_iterations=1)
        lm = LmIk(tolerance=asked, within_limits=False, damping=law, max_iterations=1)
        a, b = (one.solve(ARM, target, ARM.home).q for one in (dls, lm))
        np.testing.assert_allclose(a, b, atol=1e-5)
        found = DlsIk(tolerance=asked).solve(ARM, target, ARM.home)
        reached += found.converged
        if found.converged:
            assert max(demand.distance(ARM, target, found.q)) < 1.1e-6
    assert reached >= 6


@pytest.mark.parametrize("length", [1e-200, 1e-13, 1e200])
def test_an_axis_may_have_any_length(length: float) -> None:
    assert FreeAxis((3.0 * length, 0.0, -4.0 * length)).axis == pytest.approx((0.6, 0.0, -0.8))
