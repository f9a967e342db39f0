"""Solvers of other packages: the same arm, the same protocol; skipped where they are missing."""

import importlib
from importlib.util import find_spec
from types import ModuleType
from typing import Any

import mujoco
import numpy as np
import pytest
from mink import SE3, SO3
from numpy.typing import NDArray
from scipy.linalg import expm

from robo47_qp.errors import MissingExtraError
from robo47_qp.evaluation.benchmarks.ik.peers.kinematic_chain import KinematicChain, kinematic_chain
from robo47_qp.ik.solver import Reason
from robo47_qp.model.arm import Arm

PEERS = {
    "drake": ("pydrake", "DrakeIk"),
    "pink": ("pink", "PinkIk"),
    "optik": ("optik", "OptikIk"),
    "toolbox": ("roboticstoolbox", "ToolboxIk"),
}


@pytest.fixture(params=PEERS)
def peer(request: pytest.FixtureRequest) -> tuple[ModuleType, Any]:
    library, name = PEERS[request.param]
    pytest.importorskip(library, reason=f"{library} is not installed: extra peers")
    module = importlib.import_module(f"robo47_qp.evaluation.benchmarks.ik.peers.{request.param}")
    return module, getattr(module, name)


def product_of_exponentials(chain: KinematicChain, q: NDArray[np.float64]) -> NDArray[np.float64]:
    T = np.eye(4)
    for anchor, axis, slides, value in zip(chain.anchors, chain.axes, chain.slides, q, strict=True):
        twist = np.zeros((4, 4))
        if slides:
            twist[:3, 3] = axis
        else:
            x, y, z = axis
            twist[:3, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
            twist[:3, 3] = -np.cross(axis, anchor)
        T = T @ expm(twist * value)
    tool: NDArray[np.float64] = T @ chain.T_world_tcp.as_matrix()
    return tool


def test_the_chain_is_the_arm(arm: Arm, rng: np.random.Generator) -> None:
    chain = kinematic_chain(arm)
    for q in rng.uniform(arm.q_min, arm.q_max, (20, arm.n)):
        T = product_of_exponentials(chain, q)
        np.testing.assert_allclose(T, arm.pose(q).as_matrix(), atol=1e-12)


def test_the_urdf_is_the_arm_as_mujoco_reads_it(arm: Arm, rng: np.random.Generator) -> None:
    keep = '<mujoco><compiler fusestatic="false" discardvisual="false"/></mujoco></robot>'
    model = mujoco.MjModel.from_xml_string(kinematic_chain(arm).urdf().replace("</robot>", keep))
    data, tip = mujoco.MjData(model), model.body("tip").id
    np.testing.assert_allclose(model.jnt_range, np.column_stack([arm.q_min, arm.q_max]))
    for q in rng.uniform(arm.q_min, arm.q_max, (20, arm.n)):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        T = arm.pose(q).as_matrix()
        np.testing.assert_allclose(data.xpos[tip], T[:3, 3], atol=1e-9)
        np.testing.assert_allclose(data.xmat[tip].reshape(3, 3), T[:3, :3], atol=1e-9)


def test_a_peer_sees_the_same_arm(
    peer: tuple[ModuleType, Any], arm: Arm, rng: np.random.Generator
) -> None:
    module, _ = peer
    for q in rng.uniform(arm.q_min, arm.q_max, (20, arm.n)):
        np.testing.assert_allclose(module.tool_pose(arm, q), arm.pose(q).as_matrix(), atol=1e-9)


def test_a_peer_solves_and_says_what_fk_says(peer: tuple[ModuleType, Any], arm: Arm) -> None:
    solver = peer[1]()
    near = arm.home + 0.1 * np.where(np.arange(arm.n) % 2, 1.0, -1.0)
    target = arm.pose(np.clip(near, arm.q_min, arm.q_max))
    result = solver.solve(arm, target, arm.home)
    assert result.converged
    assert arm.pose_distance(target, result.q) == pytest.approx(
        (result.position_error, result.orientation_error)
    )
    far = SE3.from_rotation_and_translation(SO3.identity(), np.array([50.0, 0.0, 0.0]))
    assert solver.solve(arm, far, arm.home).reason is Reason.OUT_OF_REACH
    assert solver.solve(arm, SE3(np.full(7, np.nan)), arm.home).reason is Reason.INVALID_TARGET


@pytest.mark.parametrize("name", PEERS)
def test_a_missing_peer_says_what_to_install(name: str) -> None:
    library, kind = PEERS[name]
    if find_spec(library) is not None:
        pytest.skip(f"{library} is installed")
    module = importlib.import_module(f"robo47_qp.evaluation.benchmarks.ik.peers.{name}")
    with pytest.raises(MissingExtraError, match=r"pip install '\.\[peers\]'") as caught:
        getattr(module, kind)()
    assert kind in str(caught.value)
