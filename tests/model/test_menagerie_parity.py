"""The Panda written here against MuJoCo Menagerie's, which has other files and other hands."""

import os
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA

STATES = 1000
HAND_TO_TCP = np.array([0.0, 0.0, 0.1034])
Models = tuple[mujoco.MjModel, mujoco.MjModel]


@pytest.fixture(scope="module")
def models() -> Models:
    """Ours and theirs, each by MuJoCo alone."""
    root = os.environ.get("MENAGERIE_ROOT")
    if root is None:
        pytest.skip("MENAGERIE_ROOT is not set: no checkout of mujoco_menagerie to compare with")
    path = Path(root) / f"{PANDA.menagerie}.xml"
    if not path.is_file():
        pytest.skip(f"MENAGERIE_ROOT={root} holds no {PANDA.menagerie}.xml to compare with")
    ours = mujoco.MjModel.from_xml_path(str(PANDA.mjcf))
    return ours, mujoco.MjModel.from_xml_path(str(path))


@pytest.fixture
def states(models: Models) -> Iterator[tuple[mujoco.MjData, mujoco.MjData]]:
    """Both models in the same random states."""

    def pairs() -> Iterator[tuple[mujoco.MjData, mujoco.MjData]]:
        ours, theirs = models
        data = mujoco.MjData(ours), mujoco.MjData(theirs)
        rng = np.random.default_rng(7)
        for _ in range(STATES):
            q = rng.uniform(ours.jnt_range[:, 0], ours.jnt_range[:, 1])
            v = rng.normal(size=ours.nv)
            for model, d in zip(models, data, strict=True):
                d.qpos[:], d.qvel[:] = q, v
                mujoco.mj_forward(model, d)
            yield data

    return pairs()


def mass_matrix(model: mujoco.MjModel, data: mujoco.MjData) -> Matrix:
    M = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    return M


def relative(a: Vector, b: Vector) -> float:
    return float(np.abs(a - b).max() / np.abs(b).max())


def test_the_joints_are_the_same(models: Models) -> None:
    ours, theirs = models
    names = [[model.joint(i).name for i in range(model.njnt)] for model in models]
    assert names[0] == names[1]
    assert names[0][: len(PANDA.joints)] == list(PANDA.joints)
    for field in ("jnt_range", "dof_damping", "dof_armature"):
        a, b = getattr(ours, field), getattr(theirs, field)
        assert a == pytest.approx(b, rel=1e-6), field


def test_the_arm_has_their_joint_limits(models: Models) -> None:
    arm = Arm(PANDA)
    n = arm.n
    assert arm.q_min == pytest.approx(models[1].jnt_range[:n, 0], rel=1e-6)
    assert arm.q_max == pytest.approx(models[1].jnt_range[:n, 1], rel=1e-6)


def test_kinematics_and_dynamics_are_the_same(
    models: Models, states: Iterator[tuple[mujoco.MjData, mujoco.MjData]]
) -> None:
    worst = dict.fromkeys(("position", "rotation", "mass matrix", "bias"), 0.0)
    count = 0
    for ours, theirs in states:
        count += 1
        hand = theirs.body("hand")
        R = hand.xmat.reshape(3, 3)
        site = ours.site(PANDA.tcp)
        M, M_theirs = mass_matrix(models[0], ours), mass_matrix(models[1], theirs)
        found = {
            "position": relative(site.xpos, hand.xpos + R @ HAND_TO_TCP),
            "rotation": float(np.abs(site.xmat.reshape(3, 3) - R).max()),
            "mass matrix": relative(M, M_theirs),
            "bias": relative(ours.qfrc_bias, theirs.qfrc_bias),
        }
        worst = {name: max(worst[name], found[name]) for name in worst}
    assert count == STATES
    assert all(value < 1e-6 for value in worst.values()), worst


def test_the_arm_has_their_tool_pose(
    models: Models, states: Iterator[tuple[mujoco.MjData, mujoco.MjData]]
) -> None:
    arm = Arm(PANDA)
    for _, theirs in states:
        T_world_tcp = arm.pose(theirs.qpos[: arm.n].copy())
        hand = theirs.body("hand")
        R = hand.xmat.reshape(3, 3)
        assert relative(T_world_tcp.translation(), hand.xpos + R @ HAND_TO_TCP) < 1e-6
        assert np.abs(T_world_tcp.rotation().as_matrix() - R).max() < 1e-6
