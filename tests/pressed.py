"""What the tests of pressing share: the Panda with a pad over a table, and what it feels."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.control.active import ActiveController
from robo47_qp.control.pressing import Presser, Pressing
from robo47_qp.ik.qp import QpIk
from robo47_qp.model.arm import Arm, JointReference
from robo47_qp.model.payload import Payload
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.following.lin import Lin
from robo47_qp.motion.paths.segments import PathProfile
from robo47_qp.motion.waypoint import tool_down
from robo47_qp.sim.disturbance import Disturbance, DisturbedSimulation
from tests.controlled import DT, at_rest

PAD_END, RADIUS, PAD_MASS = 0.03, 0.01, 0.01
"""How far the pad's end is below the tool frame [m], its roundness [m], what moves of it [kg]."""
WIPING = PathProfile(linear=(0.1, 0.25, 5.0))


@dataclass(frozen=True, kw_only=True)
class Contact:
    """How the pad and the table give way."""

    time_constant: float = 0.02
    """solref[0] of both [s]: MuJoCo's default is 0.02, and the time step 0.001."""
    spring: float | None = 3000.0
    """Stiffness of the pad along the tool's z [N/m]; None for one that is rigid."""
    damping: float = 100.0
    """Of the pad [N·s/m]."""
    friction: float = 0.3
    """Between pad and table [-]."""

    def build(self, spec: mujoco.MjSpec) -> None:
        # The solver's own arrays belong to the next period once a step is over; sensors do not.
        spec.add_sensor(
            name="tool_force",
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            objtype=mujoco.mjtObj.mjOBJ_XBODY,
            objname="link7",
            intprm=[1 << 1, 3, 1],
        )
        # A body that the program moves.
        board = spec.worldbody.add_body(name="table", pos=[0.5, 0.0, -0.05], mocap=True)
        table = board.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.6, 0.6, 0.05])
        hand = spec.body("hand")
        assert hand is not None
        holder = hand.add_body(name="pad", pos=[0.0, 0.0, 0.1034 + PAD_END - RADIUS], mass=PAD_MASS)
        holder.inertia, holder.explicitinertial = [1e-6] * 3, True
        if self.spring is not None:
            slide = holder.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
            slide.stiffness[0], slide.damping[0], slide.armature = self.spring, self.damping, 0.0
        pad = holder.add_geom(
            name="pad", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[RADIUS, 0, 0], mass=0.0
        )
        for geom in (table, pad):
            geom.solref[0], geom.friction[0] = self.time_constant, self.friction


@cache
def above(x: float, y: float, height: float) -> tuple[float, ...]:
    """Configuration with the pad so far above the table, pointing down."""
    found = QpIk().solve(Arm(PANDA), tool_down((x, y, height + PAD_END)), PANDA.home)
    assert found.converged
    return tuple(found.q.tolist())


PAD = Payload(
    mass=PAD_MASS,
    inertia=(1e-6, 1e-6, 1e-6),
    T_tcp_com=SE3.from_translation(np.array([0.0, 0.0, PAD_END - RADIUS])),
)


class Bench:
    """The arm over a table, pressing down from the first period on."""

    def __init__(
        self,
        contact: Contact,
        settings: Pressing,
        *,
        height: float = 0.05,
        unknown: Payload | None = None,
    ) -> None:
        self.robot = replace(PANDA, home=np.array(above(0.45, -0.15, height)))
        self.sim = DisturbedSimulation(self.robot, contact.build, Disturbance(payload=unknown))
        self.arm = Arm(self.robot, PAD)
        self.presser: Presser = settings.build(self.arm, self.feel)
        self.active = ActiveController(self.presser, self.arm, dt=DT)
        self.reference = at_rest(self.robot.home)
        self.forces: list[float] = []
        """What the table presses back with, after each period [N]."""
        self.heights: list[float] = []
        """Of the pad above the table [m]."""

    def feel(self) -> Vector:
        """Sum of the contact forces on the tool in the last period (3,) [N], in the world."""
        # The sensor gives what the tool exerts.
        force: Vector = -self.sim.data.sensor("tool_force").data
        return force

    def step(self, reference: JointReference | None = None) -> None:
        wanted = self.reference if reference is None else reference
        self.sim.step(self.active.torque(wanted, self.sim.state()))
        self.forces.append(float(self.feel()[2]))
        self.heights.append(float(self.sim.data.geom("pad").xpos[2]) - RADIUS)

    def rest(self, seconds: float) -> None:
        for _ in range(round(seconds / DT)):
            self.step()

    def slide(self, by: Sequence[float]) -> None:
        """Let the reference make a straight motion."""
        goal = SE3.from_translation(np.asarray(by)) @ self.arm.pose(self.reference.q)
        lin = Lin(profile=WIPING)
        way, _ = lin.plan(self.arm, QpIk(), self.reference.q, goal, PANDA.profile, DT)
        for q, v, a in zip(way.q, way.v, way.a, strict=True):
            self.step(JointReference(q, v, a))
        self.reference = at_rest(way.end.q)

    def touched(self) -> int:
        """The first period with a force."""
        return int(np.argmax(np.array(self.forces) > 0.0))

    def touching_speed(self) -> float:
        """How fast the pad came down before [m/s]."""
        k = self.touched()
        return (self.heights[k - 3] - self.heights[k - 2]) / DT
