import gc
import weakref
from collections.abc import Callable
from copy import copy
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mink import SE3, SO3
from scipy.spatial.transform import Rotation

from robo47_qp.arrays import Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm
from robo47_qp.model.payload import Payload
from robo47_qp.model.robot import Robot
from robo47_qp.model.robots.panda import PANDA
from tests.examples import fractions, poses, rates, rotations, turned
from tests.plain_arm import PlainArm
from tests.robots import HELD, both, edited


def test_the_arm_has_the_joints_of_the_robot_and_their_ranges(
    robot: Robot, arm: Arm, plain: PlainArm
) -> None:
    assert arm.n == len(robot.joints)
    assert arm.q_min.tolist() == plain.q_min.tolist()
    assert arm.q_max.tolist() == plain.q_max.tolist()
    assert arm.home.tolist() == robot.home.tolist()
    assert arm.payload is None


@given(at=fractions)
def test_pose_is_that_of_the_tool_in_the_robots_own_model(
    arm: Arm, plain: PlainArm, at: Vector
) -> None:
    q = plain.at(at)
    position, R = plain.tool(q)
    T_world_tcp = arm.pose(q)
    assert T_world_tcp.translation() == pytest.approx(position, abs=1e-12)
    assert np.abs(T_world_tcp.rotation().as_matrix() - R).max() < 1e-12


@given(at=fractions)
def test_jacobian_is_the_derivative_of_the_pose_in_the_tool_frame(
    arm: Arm, plain: PlainArm, at: Vector
) -> None:
    q = plain.at(at)
    J = arm.jacobian(q)
    assert J.shape == (6, arm.n)
    assert np.abs(J - plain.jacobian(q)).max() < 1e-8


def test_jacobian_of_the_stretched_arm(arm: Arm, plain: PlainArm) -> None:
    q = np.clip(np.zeros(arm.n), arm.q_min, arm.q_max)
    assert np.abs(arm.jacobian(q) - plain.jacobian(q)).max() < 1e-8


@given(at=fractions, v=rates)
def test_half_v_m_v_is_the_kinetic_energy(arm: Arm, plain: PlainArm, at: Vector, v: Vector) -> None:
    q, v = plain.at(at), v[: plain.n]
    energy = 0.5 * float(v @ arm.mass_matrix(q) @ v)
    assert energy == pytest.approx(plain.kinetic_energy(q, v), rel=1e-6, abs=1e-9)


@given(at=fractions)
def test_mass_matrix_is_symmetric_and_positive_definite(
    arm: Arm, plain: PlainArm, at: Vector
) -> None:
    M = arm.mass_matrix(plain.at(at))
    assert M.shape == (arm.n, arm.n)
    assert M.tolist() == M.T.tolist()
    # The rotors alone have the inertia `armature`.
    assert np.linalg.eigvalsh(M).min() > plain.armature.min()


@given(at=fractions, v=rates)
def test_mass_matrix_is_what_acceleration_costs(
    arm: Arm, plain: PlainArm, at: Vector, v: Vector
) -> None:
    q, v, still = plain.at(at), v[: plain.n], np.zeros(plain.n)
    rest = arm.inverse_dynamics(q, v, still)
    columns = [arm.inverse_dynamics(q, v, e) - rest for e in np.eye(arm.n)]
    assert np.abs(arm.mass_matrix(q) - np.array(columns).T).max() < 1e-10


@given(at=fractions)
def test_at_rest_the_torque_is_the_slope_of_the_potential_energy(
    arm: Arm, plain: PlainArm, at: Vector
) -> None:
    q, still = plain.at(at), np.zeros(plain.n)
    torque = arm.inverse_dynamics(q, still, still)
    assert np.abs(torque - plain.gravity_torque(q)).max() < 1e-6


@given(at=fractions, v=rates)
def test_coriolis_terms_are_the_christoffel_symbols_of_the_mass_matrix(
    arm: Arm, plain: PlainArm, at: Vector, v: Vector
) -> None:
    q, v, still = plain.at(at), v[: plain.n], np.zeros(plain.n)
    h = 1e-5
    dM = np.array(
        [(arm.mass_matrix(q + h * e) - arm.mass_matrix(q - h * e)) / (2 * h) for e in np.eye(arm.n)]
    )
    expected = np.einsum("kij,j,k->i", dM, v, v) - 0.5 * np.einsum("ijk,j,k->i", dM, v, v)
    even = 0.5 * (arm.inverse_dynamics(q, v, still) + arm.inverse_dynamics(q, -v, still))
    assert np.abs(even - arm.inverse_dynamics(q, still, still) - expected).max() < 1e-6


@given(at=fractions, v=rates)
def test_damping_takes_torque_in_proportion_to_the_speed(
    arm: Arm, plain: PlainArm, at: Vector, v: Vector
) -> None:
    q, v, still = plain.at(at), v[: plain.n], np.zeros(plain.n)
    odd = 0.5 * (arm.inverse_dynamics(q, v, still) - arm.inverse_dynamics(q, -v, still))
    assert (plain.damping > 0.0).all()
    assert odd == pytest.approx(plain.damping * v, abs=1e-10)


def test_the_dynamics_of_a_wrist_without_rotors_are_those_of_a_step_of_mujoco() -> None:
    """MuJoCo's own step, of the same model without what `Arm` adds, moves as was asked for."""
    light = Arm(replace(PANDA, armature=np.zeros(7)))
    world = copy(light.model)
    world.dof_armature[:], world.opt.timestep = 0.0, TIMESTEP
    assert (light.model.dof_armature > 0.0).all()
    d = mujoco.MjData(world)
    for q, v, a in np.random.default_rng(3).uniform(-0.4, 0.4, (20, 3, 7)):
        d.qpos, d.qvel, d.qfrc_applied = (
            light.home + q,
            v,
            light.inverse_dynamics(light.home + q, v, 9.0 * a),
        )
        mujoco.mj_step(world, d)
        np.testing.assert_allclose((d.qvel - v) / TIMESTEP, 9.0 * a, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("payload", [None, HELD], ids=["empty", "carrying"])
@given(at=fractions, v=rates, a=rates)
def test_the_torque_gives_the_acceleration_in_forward_dynamics(
    robot: Robot, payload: Payload | None, at: Vector, v: Vector, a: Vector
) -> None:
    arm, plain = both(robot, payload)
    q, v, a = plain.at(at), v[: plain.n], a[: plain.n]
    tau = arm.inverse_dynamics(q, v, a)
    assert np.abs(plain.acceleration(q, v, tau) - a).max() < 1e-8


def test_there_are_no_joint_stops(arm: Arm, plain: PlainArm) -> None:
    still = np.zeros(arm.n)
    for q in (arm.q_min - 0.5, arm.q_max + 0.5):
        torque = arm.inverse_dynamics(q, still, still)
        assert np.abs(torque - plain.gravity_torque(q)).max() < 1e-6


def test_bodies_that_are_only_drawn_keep_their_mass(robot: Robot, tmp_path: Path) -> None:
    drawn = '<geom type="sphere" size="0.05" mass="2" contype="0" conaffinity="0"/>'
    added = f'<site name="{robot.tcp}"'
    heavy = edited(robot, tmp_path, added, f'<body pos="0 0.1 0.2">{drawn}</body>{added}')
    plain, still = PlainArm(heavy), np.zeros(len(robot.joints))
    torque = Arm(heavy).inverse_dynamics(robot.home, still, still)
    assert np.abs(torque - plain.gravity_torque(robot.home)).max() < 1e-6


def test_another_belief_is_another_arm(robot: Robot, arm: Arm) -> None:
    still = np.zeros(arm.n)
    before = arm.inverse_dynamics(robot.home, still, still)
    loaded = arm.with_payload(HELD)
    assert loaded.payload is HELD
    assert (loaded.inverse_dynamics(robot.home, still, still) != before).any()
    assert arm.payload is None
    assert arm.inverse_dynamics(robot.home, still, still).tolist() == before.tolist()
    empty = loaded.with_payload(None)
    assert empty.payload is None
    assert empty.inverse_dynamics(robot.home, still, still).tolist() == before.tolist()


def test_a_margin_draws_every_limit_in(robot: Robot, arm: Arm) -> None:
    inner = Arm(robot, margin=0.01)
    room = 0.01 * (arm.q_max - arm.q_min)
    np.testing.assert_allclose(inner.q_min, arm.q_min + room, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(inner.q_max, arm.q_max - room, rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(inner.pose(robot.home).wxyz_xyz, arm.pose(robot.home).wxyz_xyz)


def test_another_belief_keeps_the_margin(robot: Robot) -> None:
    inner = Arm(robot, margin=0.01)
    for other in (inner.with_payload(HELD), inner.with_payload(HELD).with_payload(None)):
        np.testing.assert_array_equal(other.q_min, inner.q_min)
        np.testing.assert_array_equal(other.q_max, inner.q_max)


@pytest.mark.parametrize("margin", [-0.1, 0.5, np.nan])
def test_a_margin_that_leaves_nothing_is_refused(robot: Robot, margin: float) -> None:
    with pytest.raises(InvalidValueError, match=r"margin must be at least 0 and below 0\.5"):
        Arm(robot, margin=margin)


@given(target=poses, at=fractions)
def test_distance_is_that_of_the_points_and_the_angle_between_the_axes(
    arm: Arm, plain: PlainArm, target: SE3, at: Vector
) -> None:
    q = plain.at(at)
    assert arm.pose_distance(target, q) == pytest.approx(plain.errors(q, target), abs=1e-9)


@given(angle=st.floats(-10.0, 10.0), axis=st.integers(0, 2))
def test_the_angle_of_a_turn_is_the_smaller_way_round(arm: Arm, angle: float, axis: int) -> None:
    target = turned(arm.pose(arm.home), axis, angle)
    distance, found = arm.pose_distance(target, arm.home)
    assert distance == pytest.approx(0.0, abs=1e-12)
    assert found == pytest.approx(np.arccos(np.cos(angle)), abs=1e-7)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_exact_half_turn_is_half_a_turn(arm: Arm, plain: PlainArm, axis: int) -> None:
    """The quaternion between tool and target has w = 0, to the last bit."""
    for q in (arm.home, plain.at(np.full(8, 0.4))):
        target = arm.pose(q) @ SE3.from_rotation(SO3(np.eye(4)[1 + axis]))
        assert arm.pose_distance(target, q) == pytest.approx((0.0, np.pi), abs=1e-9)
        assert np.abs(arm.pose_error(target, q)[3:]) == pytest.approx(
            np.pi * np.eye(3)[axis], abs=1e-9
        )


@given(target=poses, at=fractions)
def test_the_way_to_a_pose_leads_there_in_the_frame_of_the_tool(
    arm: Arm, plain: PlainArm, target: SE3, at: Vector
) -> None:
    q = plain.at(at)
    kept = target.wxyz_xyz.copy()
    position, R = plain.tool(q)
    way = arm.pose_error(target, q)
    assert position + R @ way[:3] == pytest.approx(target.translation(), abs=1e-12)
    there = R @ Rotation.from_rotvec(way[3:]).as_matrix()
    assert np.abs(there - target.rotation().as_matrix()).max() < 1e-9
    assert np.linalg.norm(way[3:]) <= np.pi + 1e-9
    assert target.wxyz_xyz.tolist() == kept.tolist()


@given(at=fractions)
def test_limit_margin_is_the_way_to_the_closest_limit(
    arm: Arm, plain: PlainArm, at: Vector
) -> None:
    q = plain.at(at)
    margin = arm.limit_margin(q)
    steps = np.vstack([np.eye(arm.n), -np.eye(arm.n)])
    assert all(plain.inside(q + (margin - 1e-9) * step) for step in steps) or margin < 1e-9
    assert not all(plain.inside(q + (margin + 1e-9) * step) for step in steps)


def test_limit_margin_is_negative_outside_by_how_far(arm: Arm) -> None:
    for i in range(arm.n):
        for limit, sign in ((arm.q_min, -1.0), (arm.q_max, 1.0)):
            q = arm.home.copy()
            q[i] = limit[i] + sign * 0.25
            assert arm.limit_margin(q) == pytest.approx(-0.25)
            q[i] = limit[i]
            assert arm.limit_margin(q) == 0.0


@given(at=fractions)
def test_what_the_tool_reaches_is_not_beyond_reach(arm: Arm, plain: PlainArm, at: Vector) -> None:
    assert arm.beyond_reach(plain.tool(plain.at(at))[0]) == 0.0


@given(at=fractions, target=rotations, far=st.floats(0.0, 5.0))
def test_beyond_reach_is_never_more_than_what_is_missing(
    arm: Arm, plain: PlainArm, at: Vector, target: SO3, far: float
) -> None:
    point = target.as_matrix()[:, 0] * far
    missing = float(np.linalg.norm(point - plain.tool(plain.at(at))[0]))
    assert arm.beyond_reach(point) <= missing + 1e-12


@given(direction=rotations)
def test_far_away_nearly_all_of_the_distance_is_out_of_reach(
    arm: Arm, plain: PlainArm, direction: SO3
) -> None:
    ray = direction.as_matrix()[:, 0]
    near, far = arm.beyond_reach(10.0 * ray), arm.beyond_reach(1010.0 * ray)
    assert far - near == pytest.approx(1000.0, rel=1e-3)


def test_the_bound_on_the_reach_is_of_use(arm: Arm, plain: PlainArm) -> None:
    rng = np.random.default_rng(3)
    tools = np.array([plain.tool(rng.uniform(arm.q_min, arm.q_max))[0] for _ in range(3000)])
    for point in 3.0 * np.vstack([np.eye(3), -np.eye(3)]):
        missing = np.linalg.norm(tools - point, axis=1).min()
        assert 0.8 * missing < arm.beyond_reach(point) <= missing


READS: dict[str, Callable[[Arm, Vector], Vector]] = {
    "pose": lambda arm, q: arm.pose(q).wxyz_xyz,
    "jacobian": lambda arm, q: arm.jacobian(q),
    "mass_matrix": lambda arm, q: arm.mass_matrix(q),
    "inverse_dynamics": lambda arm, q: arm.inverse_dynamics(q, 0.3 * q, -0.7 * q),
    "pose_error": lambda arm, q: arm.pose_error(SE3.identity(), q),
}
EVERY = pytest.mark.parametrize("read", READS.values(), ids=READS.keys())


@EVERY
def test_answers_do_not_depend_on_what_was_asked_before(
    robot: Robot, read: Callable[[Arm, Vector], Vector]
) -> None:
    rng = np.random.default_rng(1)
    arm = Arm(robot)
    q, other = (rng.uniform(arm.q_min, arm.q_max) for _ in range(2))
    first = read(Arm(robot), q)
    for before in READS.values():
        before(arm, other)
        assert read(arm, q).tolist() == first.tolist()


@EVERY
def test_answers_are_the_callers_own(robot: Robot, read: Callable[[Arm, Vector], Vector]) -> None:
    arm = Arm(robot)
    q = arm.home.copy()
    answer = read(arm, q)
    kept = answer.copy()
    for ask in READS.values():
        ask(arm, arm.q_max)
    assert answer.tolist() == kept.tolist()
    answer[...] = 7.0
    assert read(arm, q).tolist() == kept.tolist()
    assert q.tolist() == robot.home.tolist()


def test_the_arms_own_arrays_are_not_those_of_its_model(robot: Robot) -> None:
    arm, q = Arm(robot), robot.home.copy()
    margin = arm.model.jnt_range.copy()
    arm.q_min[:] = arm.q_max[:] = arm.home[:] = 0.0
    assert arm.model.jnt_range.tolist() == margin.tolist()
    assert robot.home.tolist() == q.tolist()


def test_checked_q_takes_a_copy(arm: Arm) -> None:
    q = arm.home.copy()
    checked = arm.checked_q("q", q)
    q[:] = 9.0
    assert checked.tolist() == arm.home.tolist()
    assert arm.checked_q("q", arm.home.tolist()).tolist() == arm.home.tolist()


def test_what_is_derived_from_an_arm_is_built_once_and_goes_with_it(robot: Robot) -> None:
    built = []

    class Scratch:
        def __init__(self, arm: Arm, size: int) -> None:
            built.append(size)
            self.arm = arm

    arm, other = Arm(robot), Arm(robot)
    assert arm.derived(Scratch, 3) is arm.derived(Scratch, 3)
    assert arm.derived(Scratch, 4) is not arm.derived(Scratch, 3)
    assert other.derived(Scratch, 3) is not arm.derived(Scratch, 3)
    assert other.derived(Scratch, 3).arm is other
    assert built == [3, 4, 3]
    kept = weakref.ref(arm.derived(Scratch, 3))
    del arm
    gc.collect()
    assert kept() is None
