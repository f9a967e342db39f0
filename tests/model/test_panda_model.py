"""The Panda's model against the manufacturer's tables, not against its own file."""

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from tests.robots import GRIPPER

ARM = Arm(PANDA)
# Craig's convention: a [m], d [m], alpha [rad] of each link, by the control parameters page.
DH = (
    (0.0, 0.333, 0.0),
    (0.0, 0.0, -np.pi / 2),
    (0.0, 0.316, np.pi / 2),
    (0.0825, 0.0, np.pi / 2),
    (-0.0825, 0.384, -np.pi / 2),
    (0.0, 0.0, np.pi / 2),
    (0.088, 0.0, np.pi / 2),
)
FLANGE, HAND_TURN, HAND_TO_TCP = 0.107, -np.pi / 4, 0.1034


def craig(a: float, d: float, alpha: float, theta: float) -> Matrix:
    ca, sa, ct, st_ = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
    return np.array(
        [
            [ct, -st_, 0.0, a],
            [st_ * ca, ct * ca, -sa, -d * sa],
            [st_ * sa, ct * sa, ca, d * ca],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


@given(q=arrays(np.float64, 7, elements=st.floats(-3.0, 3.0)))
def test_the_tool_is_where_the_denavit_hartenberg_table_says(q: Vector) -> None:
    T = np.eye(4)
    for (a, d, alpha), theta in zip(DH, q, strict=True):
        T = T @ craig(a, d, alpha, theta)
    T = T @ craig(0.0, FLANGE, 0.0, 0.0) @ craig(0.0, HAND_TO_TCP, 0.0, HAND_TURN)
    assert np.abs(ARM.pose(q).as_matrix() - T).max() < 1e-9


def test_joint_ranges_are_the_manufacturers() -> None:
    assert ARM.q_min.tolist() == [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]
    assert ARM.q_max.tolist() == [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]


def test_rated_limits_are_the_manufacturers() -> None:
    assert PANDA.rated.v_max.tolist() == [2.175] * 4 + [2.61] * 3
    assert PANDA.rated.a_max.tolist() == [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]
    assert PANDA.rated.j_max.tolist() == [7500, 3750, 5000, 6250, 7500, 10000, 10000]
    assert PANDA.tau_max.tolist() == [87.0] * 4 + [12.0] * 3
    assert PANDA.tau_rate_max.tolist() == [1000.0] * 7


def test_the_default_profile_is_within_the_rated_one() -> None:
    for name in ("v_max", "a_max", "j_max"):
        assert (getattr(PANDA.profile, name) <= getattr(PANDA.rated, name)).all()


def test_the_mass_is_that_of_the_identified_links_and_hand() -> None:
    links = (0.629769, 4.970684, 0.646926, 3.228604, 3.587895, 1.225946, 1.666555, 0.735522)
    assert ARM.model.body_mass.sum() == pytest.approx(sum(links) + 0.73 + 2 * 0.015, rel=1e-9)


def test_at_home_the_tool_points_down_in_front_of_the_base_well_inside_the_limits() -> None:
    T_world_tcp = ARM.pose(ARM.home)
    assert T_world_tcp.rotation().as_matrix() == pytest.approx(np.diag([1, -1, -1]), abs=1e-9)
    x, y, z = T_world_tcp.translation()
    assert 0.25 < x < 0.35
    assert y == pytest.approx(0.0, abs=1e-9)
    assert 0.45 < z < 0.55
    assert ARM.limit_margin(ARM.home) > 0.5


def test_the_motors_can_hold_the_arm_anywhere(rng: np.random.Generator) -> None:
    still = np.zeros(7)
    for _ in range(200):
        q = rng.uniform(ARM.q_min, ARM.q_max)
        assert (np.abs(ARM.inverse_dynamics(q, still, still)) < PANDA.tau_max).all()


def test_the_file_has_a_torque_motor_with_the_rated_torque_for_every_joint() -> None:
    model = mujoco.MjModel.from_xml_path(str(PANDA.mjcf))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for joint, motor, tau_max in zip(PANDA.joints, PANDA.motors, PANDA.tau_max, strict=True):
        i, dof = model.actuator(motor).id, model.joint(joint).dofadr[0]
        for asked, got in ((1.0, 1.0), (1e3, tau_max), (-1e3, -tau_max)):
            data.ctrl[:] = 0.0
            data.ctrl[i] = asked
            mujoco.mj_forward(model, data)
            assert data.qfrc_actuator[dof] == pytest.approx(got)


def test_the_fingers_close_on_the_tool_point_from_both_sides() -> None:
    model = mujoco.MjModel.from_xml_path(str(PANDA.mjcf))
    data = mujoco.MjData(model)
    gripper = GRIPPER
    for width in (0.0, 0.03, gripper.width_max):
        for joint in gripper.joints:
            data.qpos[model.joint(joint).qposadr[0]] = width / 2
        mujoco.mj_forward(model, data)
        tcp = data.site(PANDA.tcp)
        pads = [data.geom(name).xpos - tcp.xpos for name in ("left_pad", "right_pad")]
        inner = [tcp.xmat.reshape(3, 3).T @ pad for pad in pads]
        half = model.geom("left_pad").size[1]
        assert inner[0][1] - half == pytest.approx(width / 2, abs=1e-9)
        assert inner[1][1] + half == pytest.approx(-width / 2, abs=1e-9)
        for pad in inner:
            assert pad[[0, 2]] == pytest.approx([0.0, 0.0], abs=1e-9)


def test_the_gripper_is_described_as_it_is_modelled() -> None:
    model = mujoco.MjModel.from_xml_path(str(PANDA.mjcf))
    gripper = GRIPPER
    assert gripper.width_max == sum(model.joint(joint).range[1] for joint in gripper.joints)
    servo = model.actuator(gripper.actuator)
    assert servo.ctrlrange.tolist() == [0.0, gripper.width_max]
    assert servo.forcerange[1] == gripper.force_max * gripper.force_gain
    for joint, finger in zip(gripper.joints, gripper.fingers, strict=True):
        assert model.body(finger).jntadr[0] == model.joint(joint).id
