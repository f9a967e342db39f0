"""Two arms in one model, held to the single arm that each of them is."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from mink import SE3

from robo47_qp.collision.clearance import Clearance
from robo47_qp.errors import InvalidValueError, UnknownNameError
from robo47_qp.model.arm import Arm
from robo47_qp.model.payload import Payload
from robo47_qp.model.robot import Robot, Tool
from robo47_qp.model.robots import load_robot
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.robots.panda_pair import APART, panda_pair
from robo47_qp.model.tool_poses import ToolPoses

H = 1e-6
BOX = Payload(mass=0.5, inertia=(1e-3, 1e-3, 1e-3), T_tcp_com=SE3.identity())
SHIFTS = {"left": np.array([0.0, APART / 2, 0.0]), "right": np.array([0.0, -APART / 2, 0.0])}


@pytest.fixture(scope="module")
def pair() -> Arm:
    return Arm(panda_pair())


@pytest.fixture(scope="module")
def single() -> Arm:
    return Arm(PANDA)


def configurations(arm: Arm, count: int = 20) -> list[np.ndarray]:
    return list(np.random.default_rng(0).uniform(arm.q_min, arm.q_max, (count, arm.n)))


def test_the_package_offers_it_by_name() -> None:
    robot = load_robot("panda_pair")
    assert [tool.name for tool in robot.tools] == ["left", "right"]
    assert (robot.tools[0].tcp, robot.tools[0].gripper) == (robot.tcp, robot.gripper)


def test_a_robot_of_one_tool_has_that_one() -> None:
    (tool,) = PANDA.tools
    assert (tool.tcp, tool.gripper) == (PANDA.tcp, PANDA.gripper)


def test_each_arm_is_where_the_single_one_would_be(pair: Arm, single: Arm) -> None:
    for q in configurations(pair):
        for i, shift in enumerate(SHIFTS.values()):
            own = single.pose(q[7 * i : 7 * i + 7])
            there = pair.pose(q, i)
            np.testing.assert_allclose(there.translation(), own.translation() + shift, atol=1e-12)
            turn = there.rotation().inverse() @ own.rotation()
            assert np.linalg.norm(turn.log()) < 1e-9


def test_the_errors_and_their_jacobians_agree_with_differences(pair: Arm) -> None:
    for q in configurations(pair, 5):
        target = ToolPoses({"right": pair.pose(q, 1), "left": pair.pose(q, 0)})
        assert max(pair.pose_distance(target, q)) < 1e-9
        J = pair.error_jacobian(target, q)
        for k, step in enumerate(H * np.eye(pair.n)):
            moved = pair.pose_error(target, q - step) - pair.pose_error(target, q + step)
            np.testing.assert_allclose(J[:, k], moved / (2 * H), atol=1e-7)


def test_the_distance_of_several_tools_is_that_of_the_worst(pair: Arm) -> None:
    q = pair.home
    up = SE3.from_translation(np.array([0.0, 0.0, 0.02]))
    target = ToolPoses({"left": pair.pose(q, 0), "right": up @ pair.pose(q, 1)})
    assert pair.pose_distance(target, q) == pytest.approx((0.02, 0.0), abs=1e-9)


def test_only_its_own_joints_move_a_tool(pair: Arm) -> None:
    T = SE3.identity()
    for names, moved in (("left", 7), ("right", 7)):
        joints = pair.joints_of(ToolPoses({names: T}))
        assert [j.startswith(names) for j in pair.robot.joints] == joints.tolist()
        assert joints.sum() == moved
    assert pair.joints_of(ToolPoses({"left": T, "right": T})).all()
    assert pair.joints_of(T).tolist() == pair.joints_of(ToolPoses({"left": T})).tolist()


def test_the_arms_share_no_inertia(pair: Arm, single: Arm) -> None:
    for q in configurations(pair, 5):
        M = pair.mass_matrix(q)
        assert not M[:7, 7:].any()
        np.testing.assert_allclose(M[:7, :7], single.mass_matrix(q[:7]), atol=1e-12)
        np.testing.assert_allclose(M[7:, 7:], single.mass_matrix(q[7:]), atol=1e-12)


def test_each_tool_carries_its_own_payload(pair: Arm, single: Arm) -> None:
    still, none = np.zeros(14), np.zeros(7)
    loaded, one = pair.with_payload({"right": BOX}), single.with_payload(BOX)
    for q in configurations(pair, 5):
        tau = loaded.inverse_dynamics(q, still, still)
        np.testing.assert_allclose(tau[:7], single.inverse_dynamics(q[:7], none, none), atol=1e-10)
        np.testing.assert_allclose(tau[7:], one.inverse_dynamics(q[7:], none, none), atol=1e-10)


def test_a_single_payload_is_the_main_tools(pair: Arm) -> None:
    assert pair.with_payload(BOX).payloads == {"left": BOX}


def test_a_target_far_from_one_arm_is_beyond_reach(pair: Arm) -> None:
    far = SE3.from_translation(np.array([0.3, 1.6, 0.4]))
    assert pair.target_beyond_reach(ToolPoses({"left": far})) == pair.beyond_reach(
        far.translation(), 0
    )
    both = ToolPoses({"left": far, "right": far})
    assert pair.target_beyond_reach(both) == pair.beyond_reach(far.translation(), 1) > 0.5


def test_the_arms_keep_clear_of_each_other(pair: Arm) -> None:
    clearance, m = Clearance(pair, 0.01), pair.model
    across = [
        (a, b)
        for (a, b), names in zip(clearance.pairs.kept, clearance.pairs.names, strict=True)
        if names[0].split("_")[0] != names[1].split("_")[0]
    ]
    geoms = [
        [g for g in range(m.ngeom) if m.body(m.geom_bodyid[g]).name.startswith(side)]
        for side in SHIFTS
    ]
    assert len(clearance.pairs.kept) >= 600
    # All pairs across, but for the two bases, which stand still.
    still = [sum(m.body_weldid[m.geom_bodyid[g]] == 0 for g in side) for side in geoms]
    assert len(across) == len(geoms[0]) * len(geoms[1]) - still[0] * still[1]
    data, touching = mujoco.MjData(m), 0
    for q in configurations(pair, 80):
        data.qpos[:] = q
        mujoco.mj_kinematics(m, data)
        brute = min(mujoco.mj_geomDistance(m, data, a, b, 10.0, None) for a, b in across)
        touching += brute < 0.0
        assert clearance.nearest(q)[0] <= brute + 1e-6
        if brute < 0.0:
            assert not clearance.clear(q, 0.0)
    assert touching >= 3


def test_tools_are_asked_for_by_their_names(pair: Arm) -> None:
    with pytest.raises(UnknownNameError, match="middle"):
        pair.pose_error(ToolPoses({"middle": SE3.identity()}), pair.home)
    with pytest.raises(UnknownNameError, match="middle"):
        pair.with_payload({"middle": BOX})


def test_tools_have_different_names() -> None:
    robot: Robot = panda_pair()
    with pytest.raises(InvalidValueError, match="names of tools"):
        replace(robot, more_tools=(Tool(name="left", tcp="right_tcp"),))


def test_poses_of_tools_are_checked() -> None:
    with pytest.raises(InvalidValueError, match="at least one"):
        ToolPoses({})
    with pytest.raises(InvalidValueError, match="'left'"):
        ToolPoses({"left": SE3(np.array([1.0, 0, 0, 0, np.nan, 0, 0]))})
    with pytest.raises(InvalidValueError, match=r"mink\.SE3"):
        ToolPoses({"left": np.zeros(7)})  # type: ignore[dict-item]
