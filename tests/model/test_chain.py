"""The compiled kinematics beside MuJoCo's, on every robot and on one of any structure."""

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.model import chain as chain_module
from robo47_qp.model.arm import Arm
from robo47_qp.model.chain import Chain
from robo47_qp.model.robot import Robot
from robo47_qp.model.robots.panda_pair import panda_pair
from tests.robots import MAKERS, is_at_hand

EXACT = 1e-12
Pair = tuple[Vector, Vector]
NAMES = [name for name in sorted(MAKERS) if is_at_hand(name)]


@pytest.mark.parametrize("name", [*NAMES, "panda_pair"])
def test_frames_and_jacobians_are_those_of_mujoco(name: str) -> None:
    robot: Robot = panda_pair() if name == "panda_pair" else MAKERS[name]()
    arm = Arm(robot)
    m, chain = arm.model, arm.derived(Chain)
    rng = np.random.default_rng(0)
    jacobian = np.zeros((6, arm.n))
    frames, jacobians = list[Pair](), list[Pair]()
    for q in rng.uniform(arm.q_min, arm.q_max, (200, arm.n)):
        chain.move(q)
        d = arm.place_only(q)
        mujoco.mj_comPos(m, d)
        for place, site in enumerate(arm.tool_sites):
            T = chain.frame(place)
            frames.append((T, np.concatenate([d.site_xmat[site], d.site_xpos[site]])))
            mujoco.mj_jacSite(m, d, jacobian[:3], jacobian[3:], site)
            J = chain.jacobian(int(chain.joint[place]), T[9:].copy())
            jacobians.append((J, jacobian.copy()))
        geoms = [chain.frame(chain.first_geom + geom) for geom in range(m.ngeom)]
        frames += zip(geoms, np.hstack([d.geom_xmat, d.geom_xpos]), strict=True)
    for pairs in (frames, jacobians):
        found, expected = (np.array(each) for each in zip(*pairs, strict=True))
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=EXACT)


ODD = """<mujoco><compiler angle="radian"/><worldbody>
  <body pos="0.1 0.2 0.3" quat="0.5 0.5 -0.5 0.5">
    <joint name="a" axis="1 2 3" pos="0.05 0 0.02" ref="0.4" range="-2 2" limited="true"/>
    <joint name="b" type="slide" axis="0 1 1" ref="0.1" range="-1 1" limited="true"/>
    <geom size="0.1"/>
    <body pos="0.2 0 0.1" quat="0 1 0 0"><body pos="0 0.3 0">
      <joint name="c" axis="0 0 -1" pos="0 0.1 0" range="-2 2" limited="true"/>
      <geom size="0.1 0.2" type="capsule" pos="0 0 0.3"/><site name="tip" pos="0.1 0.2 0.3"/>
    </body></body>
    <body pos="0 0 0.4"><joint name="d" axis="1 0 0" range="-2 2" limited="true"/>
      <geom size="0.1"/></body>
  </body></worldbody></mujoco>"""


def test_joints_off_their_bodies_origin_and_with_references() -> None:
    """Two joints of one body, a body without any between others, a branch, `ref`."""
    model = mujoco.MjModel.from_xml_string(ODD)
    data = mujoco.MjData(model)
    hinges = model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE
    arm = SimpleNamespace(model=model, n=4, hinges=hinges, tool_sites=(model.site("tip").id,))
    chain = Chain(arm)  # type: ignore[arg-type]
    rng = np.random.default_rng(1)
    for q in rng.uniform(-2.0, 2.0, (50, 4)):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        chain.move(q)
        T = chain.frame()
        np.testing.assert_allclose(T[:9], data.site_xmat[0], rtol=0.0, atol=EXACT)
        np.testing.assert_allclose(T[9:], data.site_xpos[0], rtol=0.0, atol=EXACT)


def test_an_arm_of_more_joints_than_the_core_takes_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(chain_module, "MAX_JOINTS", 6)
    with pytest.raises(InvalidValueError, match=r"at most 6 .* ROBO47_BACKEND=numpy; found 7"):
        Chain(Arm(MAKERS["panda"]()))
