"""Motion of the tool against finite differences of its pose."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robo47_qp._core.library import using
from robo47_qp.arrays import Matrix
from robo47_qp.model.arm import Arm
from robo47_qp.motion.tool_motion import tool_motion, tool_places
from tests.small_robots import small_robot

COUNT = 12
_STENCIL = np.arange(-3, 4)
"""Central differences of sixth, sixth and fourth order (Fornberg, 1988)."""
_FIRST = np.array([-1, 9, -45, 0, 45, -9, 1]) / 60
_SECOND = np.array([2, -27, 270, -490, 270, -27, 2]) / 180
_THIRD = np.array([1, -8, 13, 0, -13, 8, -1]) / 8


@pytest.fixture
def joints(arm: Arm, rng: np.random.Generator) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """Random q, v, a and jerk."""
    span = arm.q_max - arm.q_min
    q = arm.q_min + span * rng.uniform(0.2, 0.8, (COUNT, arm.n))
    v, a, j = rng.normal(size=(3, COUNT, arm.n))
    return q, v, a, j


def test_it_is_the_derivative_of_the_pose(
    arm: Arm, joints: tuple[Matrix, Matrix, Matrix, Matrix]
) -> None:
    found = tool_motion(arm, *joints)
    h = 5e-3
    for k, (q, v, a, j) in enumerate(zip(*joints, strict=True)):
        times = h * _STENCIL[:, None]
        poses = [arm.pose(row) for row in q + v * times + a * times**2 / 2 + j * times**3 / 6]
        x = np.array([pose.translation() for pose in poses])
        assert found.v[k] == pytest.approx(_FIRST @ x / h, rel=1e-8, abs=1e-9)
        assert found.a[k] == pytest.approx(_SECOND @ x / h**2, rel=1e-6, abs=1e-7)
        assert found.j[k] == pytest.approx(_THIRD @ x / h**3, rel=1e-4, abs=1e-4)
        # Angular: of the rotation matrix, w^ = R' R^T and so on.
        R = np.array([pose.rotation().as_matrix() for pose in poses])
        dR, ddR, dddR = (
            np.einsum("s,sij->ij", weights, R) / h**order
            for order, weights in ((1, _FIRST), (2, _SECOND), (3, _THIRD))
        )
        here = R[3].T
        w = dR @ here
        dw = ddR @ here + dR @ dR.T
        ddw = dddR @ here + 2 * ddR @ dR.T + dR @ ddR.T
        for name, skew, near in (
            ("turn_v", w, 1e-8),
            ("turn_a", dw, 1e-6),
            ("turn_j", ddw, 1e-4),
        ):
            vector = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
            assert getattr(found, name)[k] == pytest.approx(vector, rel=near, abs=10 * near)


SHIFTED = """
<mujoco><worldbody><body name="base"><geom size="0.02"/>
  <body pos="0.1 0 0.2"><joint name="a" axis="0.3 0 1" ref="0.7" range="-2 2"/><geom size="0.02"/>
    <body pos="0 0.3 0"><joint name="b" type="slide" axis="1 0.2 0" ref="-0.1" range="-1 1"/>
      <geom size="0.02"/>
      <body pos="0 0.2 0.1"><joint name="c" axis="0 1 0" pos="0 0 0.05" range="-2 2"/>
        <geom size="0.02"/><site name="tool" pos="0.1 0.2 0.3"/>
</body></body></body></body></worldbody></mujoco>
"""


def test_joints_may_have_their_zero_anywhere(tmp_path: Path, rng: np.random.Generator) -> None:
    arm = Arm(small_robot(tmp_path, SHIFTED, ("a", "b", "c"), slides=("b",)))
    q = rng.uniform(-0.5, 0.5, (COUNT, 3))
    v, a, j = rng.normal(size=(3, COUNT, 3))
    found, h = tool_motion(arm, q, v, a, j), 5e-3
    for k in range(COUNT):
        t = h * _STENCIL[:, None]
        way = q[k] + v[k] * t + a[k] * t**2 / 2 + j[k] * t**3 / 6
        x = np.array([arm.pose(row).translation() for row in way])
        assert found.v[k] == pytest.approx(_FIRST @ x / h, abs=1e-8)
        assert found.a[k] == pytest.approx(_SECOND @ x / h**2, abs=1e-6)


def test_velocities_are_those_of_the_jacobian(
    arm: Arm, joints: tuple[Matrix, Matrix, Matrix, Matrix]
) -> None:
    found = tool_motion(arm, *joints)
    q, v, _, _ = joints
    for k in range(COUNT):
        twist = arm.jacobian(q[k]) @ v[k]
        R = Rotation.from_matrix(arm.pose(q[k]).rotation().as_matrix())
        assert found.v[k] == pytest.approx(R.apply(twist[:3]), abs=1e-12)
        assert found.turn_v[k] == pytest.approx(R.apply(twist[3:]), abs=1e-12)


def test_an_arm_at_rest_has_a_tool_at_rest(arm: Arm) -> None:
    still = np.zeros((3, arm.n))
    for part in tool_motion(arm, np.tile(arm.home, (3, 1)), still, still, still):
        assert not part.any()


def test_places_are_the_same_to_the_bit_in_the_core(arm: Arm, rng: np.random.Generator) -> None:
    q = rng.uniform(arm.q_low, arm.q_high, (50, arm.n))[::2]
    for tool in range(len(arm.robot.tools)):
        found = []
        for backend in ("compiled", "numpy"):
            with using(backend):
                found.append(tool_places(arm, q, tool))
        for one, other in zip(*found, strict=True):
            np.testing.assert_array_equal(one, other)


def test_motion_in_the_core_is_that_of_numpy(arm: Arm, rng: np.random.Generator) -> None:
    q = rng.uniform(arm.q_low, arm.q_high, (300, arm.n))
    v, a, j = (10.0**k * rng.normal(size=q.shape) for k in range(3))
    for tool in range(len(arm.robot.tools)):
        with using("numpy"):
            expected = tool_motion(arm, q, v, a, j, tool)
        with using("compiled"):
            found = tool_motion(arm, q, v, a, j, tool)
        for one, other in zip(found, expected, strict=True):
            np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-12 * np.abs(other).max())
