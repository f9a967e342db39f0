"""Arms on a rail and on a mobile base, held to the arm that they carry."""

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
from mink import SE3, SO3

from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.ik.mink import MinkIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import ToolFrame
from robo47_qp.model.robots import load_robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.robots.panda_rail import rail
from robo47_qp.motion.planner import Planner
from robo47_qp.motion.waypoint import Motion, Waypoint, tool_down
from robo47_qp.stack import ClassicalStack
from tests.robots import arm_of

NAMES = ("panda_rail", "panda_base")
RAISED = SE3.from_translation(np.array([0.0, 0.0, 0.05]))
"""Where the arm's base stands on its carrier."""


@pytest.fixture(params=NAMES)
def carried(request: pytest.FixtureRequest) -> Arm:
    return arm_of(request.param)


def carrier_pose(arm: Arm, q: Vector) -> SE3:
    """Where the carrier's joints put it, by hand."""
    if arm.n == 8:
        return SE3.from_translation(np.array([0.0, q[0], 0.0]))
    return SE3.from_rotation_and_translation(SO3.from_z_radians(q[2]), np.array([q[0], q[1], 0.0]))


def configurations(arm: Arm, count: int) -> list[Vector]:
    return list(np.random.default_rng(0).uniform(arm.q_min, arm.q_max, (count, arm.n)))


def test_the_tool_is_where_the_carrier_takes_the_arms(carried: Arm) -> None:
    single = Arm(PANDA)
    for q in configurations(carried, 30):
        there = carrier_pose(carried, q) @ RAISED @ single.pose(q[-7:])
        assert carried.pose_distance(there, q) == pytest.approx((0.0, 0.0), abs=1e-9)


def test_the_arms_own_dynamics_are_those_of_the_arm(carried: Arm) -> None:
    """The carrier at rest and level: the arm's block of M, and its torques of gravity."""
    single, still = Arm(PANDA), np.zeros(carried.n)
    for q in configurations(carried, 10):
        M, alone = carried.mass_matrix(q), single.mass_matrix(q[-7:])
        np.testing.assert_allclose(M[-7:, -7:], alone, atol=1e-9)
        tau = carried.inverse_dynamics(q, still, still)
        at_rest = single.inverse_dynamics(q[-7:], still[-7:], still[-7:])
        np.testing.assert_allclose(tau[-7:], at_rest, atol=1e-9)
        # A level carrier carries no weight.
        np.testing.assert_allclose(tau[:-7], 0.0, atol=1e-9)


def test_a_slide_accelerates_the_whole_mass(carried: Arm) -> None:
    mass = float(carried.model.body_mass.sum())
    for q in configurations(carried, 5):
        M = carried.mass_matrix(q)
        slides = [i for i, unit in enumerate(carried.robot.units) if unit == "m"]
        assert [M[i, i] for i in slides] == pytest.approx([mass] * len(slides))


def test_ratings_are_those_of_the_carrier_and_then_of_the_arm(carried: Arm) -> None:
    robot = carried.robot
    for limits, arms in ((robot.rated, PANDA.rated), (robot.profile, PANDA.profile)):
        for name in ("v_max", "a_max", "j_max"):
            assert getattr(limits, name)[-7:].tolist() == getattr(arms, name).tolist()
            assert (getattr(robot.profile, name) <= getattr(robot.rated, name)).all()
    assert robot.tau_max[-7:].tolist() == PANDA.tau_max.tolist()
    assert robot.home[:-7].tolist() == [0.0] * (carried.n - 7)
    assert robot.units[-7:] == ("rad",) * 7
    assert robot.slides == tuple(
        j for j, unit in zip(robot.joints, robot.units, strict=True) if unit == "m"
    )


def test_the_motors_can_accelerate_it_as_rated(carried: Arm) -> None:
    """Each joint of the carrier at its rated acceleration, alone, with 0.7 of its motor."""
    still = np.zeros(carried.n)
    for q in configurations(carried, 30):
        for i in range(carried.n - 7):
            a = still.copy()
            a[i] = carried.robot.rated.a_max[i]
            tau = carried.inverse_dynamics(q, still, a)
            assert abs(tau[i]) <= 0.7 * carried.robot.tau_max[i]


def test_neighbours_of_the_arm_stay_excluded(carried: Arm) -> None:
    assert carried.model.nexclude == Arm(PANDA).model.nexclude


@pytest.mark.parametrize("solver", ["mink", "qp", "lm", "dls"])
def test_every_pose_of_a_configuration_is_reached(solver: str, carried: Arm) -> None:
    ik = ClassicalStack(ik=solver).solver()
    for q in configurations(carried, 10):
        target = carried.pose(q)
        found = ik.solve(carried, target, carried.home)
        assert found.converged, found.explanation
        assert max(carried.pose_distance(target, found.q)) <= 1e-6
        assert carried.limit_margin(found.q) >= 0.0


def test_a_dear_carrier_moves_less(carried: Arm, rng: np.random.Generator) -> None:
    """For poses that the arm alone would nearly reach; all are reached with either cost."""
    k = carried.n - 7
    costs = ([1.0] * carried.n, [10.0] * k + [1.0] * 7)
    solvers = [MultiStart(solver=MinkIk(max_iterations=50, joint_cost=cost)) for cost in costs]
    ways: list[list[float]] = []
    for _ in range(15):
        target = carried.pose(carried.home + rng.uniform(-0.3, 0.3, carried.n))
        found = [ik.solve(carried, target, carried.home) for ik in solvers]
        assert all(one.converged for one in found)
        ways.append([float(np.abs(one.q[:k]).max()) for one in found])
    plain, dear = np.median(ways, axis=0)
    assert dear < 0.3 * plain


@pytest.mark.parametrize("motion", [Motion.PTP, Motion.LIN])
def test_a_motion_far_along_the_carrier_keeps_every_limit(motion: Motion, carried: Arm) -> None:
    robot, start = carried.robot, carried.home
    planner = Planner(ik=ClassicalStack(ik="qp").solver(), profile=robot.profile)
    goal = carried.pose(start) @ SE3.from_translation(np.array([0.05, -1.5, 0.1]))
    waypoint = Waypoint(name="far", target=goal, motion=motion)
    leg = planner.plan(carried, waypoint, start, 1e-3)
    assert max(carried.pose_distance(goal, leg.trajectory.end.q)) <= 1e-5
    t = leg.trajectory
    for rows, limit in ((t.v, robot.profile.v_max), (t.a, robot.profile.a_max)):
        assert (np.abs(rows) <= limit * (1.0 + 1e-6)).all()
    assert (np.abs(t.jerk) <= robot.profile.j_max * (1.0 + 1e-3)).all()
    assert (t.q >= carried.q_min).all()
    assert (t.q <= carried.q_max).all()
    if motion is Motion.LIN:
        ends = carried.pose(start).translation(), goal.translation()
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        for q in t.q[::25]:
            off = carried.pose(q).translation() - ends[0]
            assert np.linalg.norm(off - along * (off @ along)) < 1e-4


def test_out_of_reach_is_told_past_the_end_of_the_rail() -> None:
    arm = arm_of("panda_rail")
    ik = ClassicalStack(ik="qp").solver()
    assert ik.solve(arm, tool_down([0.4, 2.4, 0.3]), arm.home).converged
    assert not ik.solve(arm, tool_down([0.4, 3.2, 0.3]), arm.home).converged


def test_the_file_has_no_copy_of_the_arm() -> None:
    for name in NAMES:
        robot = load_robot(name)
        assert "link1" not in robot.mjcf.read_text("utf-8")
        spec = mujoco.MjSpec.from_file(str(robot.mjcf))
        assert spec.body("panda_link7") is not None


@pytest.mark.parametrize("beside", ["dry_friction", "armature", "tool", "T_world_base"])
def test_an_arm_that_is_not_all_in_its_file_is_refused(beside: str) -> None:
    others: dict[str, Any] = {"tool": ToolFrame(body="hand"), "T_world_base": SE3.identity()}
    value = others.get(beside, np.ones(7))
    with pytest.raises(InvalidValueError, match=f"'panda' with {beside} beside its file"):
        rail().carrying(replace(PANDA, **{beside: value}))
