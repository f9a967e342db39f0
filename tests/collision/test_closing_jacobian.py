"""Closing Jacobian against finite differences of distances, on joints of both kinds."""

import mujoco
import numpy as np

from robo47_qp.arrays import Vector
from robo47_qp.collision.motion_bounds import ClosingJacobian

MODEL = """
<mujoco><compiler angle="radian"/><worldbody>
  <geom name="ball" size="0.1" pos="1.2 0.3 0.6"/>
  <body pos="0 0 0.3">
    <joint axis="0 0 1" range="-3 3" pos="0.1 0 0"/>
    <geom name="upper" type="capsule" fromto="0 0 0 0.4 0 0" size="0.04"/>
    <body pos="0.4 0 0">
      <joint axis="0.6 0.8 0" range="-3 3" pos="0 0.1 0"/>
      <joint type="slide" axis="1 0 0" range="-0.5 0.5"/>
      <geom name="tip" size="0.07" pos="0.3 0.1 0"/>
    </body>
  </body>
</worldbody></mujoco>
"""


def test_rates_are_those_of_distances_whichever_geom_moves(rng: np.random.Generator) -> None:
    m = mujoco.MjModel.from_xml_string(MODEL)
    d = mujoco.MjData(m)
    ball, upper, tip = (m.geom(name).id for name in ("ball", "upper", "tip"))
    pairs = ((ball, upper), (ball, tip), (tip, ball), (upper, tip))
    closing = ClosingJacobian(m, d, pairs)
    segment = np.zeros((len(pairs), 6))

    def distances(q: Vector) -> Vector:
        d.qpos[:] = q
        mujoco.mj_kinematics(m, d)
        ways = zip(pairs, segment, strict=True)
        return np.array([mujoco.mj_geomDistance(m, d, a, b, 10.0, way) for (a, b), way in ways])

    overlapping = 0
    for _ in range(60):
        q = rng.uniform(m.jnt_range[:, 0], m.jnt_range[:, 1])
        slopes = [(distances(q + h) - distances(q - h)) / 2e-6 for h in 1e-6 * np.eye(3)]
        distance = distances(q)
        mujoco.mj_comPos(m, d)
        chosen = np.array([3, 1, 0, 2])
        A = closing.rows(chosen, distance[chosen], segment[chosen])
        np.testing.assert_allclose(A, -np.array(slopes).T[chosen], atol=2e-5)
        overlapping += int((distance < 0.0).sum())
    assert overlapping > 0
