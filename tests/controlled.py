"""What the tests of controllers share: a world without code of the package, and self-motions."""

from collections.abc import Callable

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.control.controller import Controller
from robo47_qp.model.arm import Arm, JointReference, JointState
from robo47_qp.model.payload import Payload
from tests.plain_arm import PlainArm

DT = 1e-3
LOAD = Payload(
    mass=0.5,
    inertia=(4e-4, 5e-4, 6e-4),
    T_tcp_com=SE3.from_translation(np.array([0.02, 0.0, 0.05])),
)
"""Light enough for the motors of every arm."""


class World:
    """The welded arm in MuJoCo, driven by torques and pushed at its tool."""

    def __init__(self, plain: PlainArm, q: Vector, v: Vector | None = None) -> None:
        self.m = plain.welded
        self.d = mujoco.MjData(self.m)
        self.d.qpos[:] = q
        if v is not None:
            self.d.qvel[:] = v
        self._tcp = self.m.site(plain.robot.tcp).id

    def state(self) -> JointState:
        return JointState(self.d.qpos.copy(), self.d.qvel.copy())

    def step(self, tau: Vector, force: Vector | None = None, torque: Vector | None = None) -> None:
        m, d = self.m, self.d
        d.qfrc_applied[:] = tau
        if force is not None or torque is not None:
            # All that a force at a point of a body needs: what it does is found by the step.
            mujoco.mj_kinematics(m, d)
            mujoco.mj_comPos(m, d)
            zero, body = np.zeros(3), int(m.site_bodyid[self._tcp])
            point = d.site_xpos[self._tcp].copy()
            F, T = (zero if part is None else part for part in (force, torque))
            mujoco.mj_applyFT(m, d, F, T, point, body, d.qfrc_applied)
        mujoco.mj_step(m, d)

    def kinetic_energy(self) -> float:
        m, d = self.m, self.d
        M = np.zeros((m.nv, m.nv))
        mujoco.mj_forward(m, d)
        mujoco.mj_fullM(m, d, M)
        return float(0.5 * d.qvel @ M @ d.qvel)


def at_rest(q: Vector) -> JointReference:
    return JointReference(q, np.zeros(len(q)), np.zeros(len(q)))


def controlled(
    world: World,
    controller: Controller,
    arm: Arm,
    q_ref: Vector,
    seconds: float,
    look: Callable[[JointState], None] = lambda _: None,
    push: tuple[Vector | None, Vector | None] = (None, None),
) -> JointState:
    """Hold a reference for a while under a force and a torque; returns the last state."""
    reference = at_rest(q_ref)
    for _ in range(round(seconds / DT)):
        state = world.state()
        look(state)
        world.step(controller.torque(arm, reference, state), *push)
    return world.state()


def self_motion(arm: Arm, steps: int) -> Vector:
    """A configuration with the tool at its home pose, so many milliradians of elbow away."""
    q, home = arm.home.copy(), arm.pose(arm.home)
    along = np.zeros(arm.n)
    for _ in range(steps):
        n = np.linalg.svd(arm.jacobian(q))[2][-1]
        along = n if n @ along >= 0 else -n
        q = q + 1e-3 * along
        q = q + np.linalg.pinv(arm.jacobian(q)) @ arm.pose_error(home, q)
    return q


def tool_offset(plain: PlainArm, q: Vector, home: SE3) -> Vector:
    """Position of the tool at q from that of a pose, in the world [m]."""
    offset: Vector = plain.tool(q)[0] - home.translation()
    return offset
