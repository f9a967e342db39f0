"""Disturbance: errors of the world that the controller does not know."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.arrays import Checked, CountOrZero, NotNegative, Positive, Size, Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import JointState
from robo47_qp.model.mjcf import add_payload
from robo47_qp.model.payload import Payload
from robo47_qp.model.robot import Robot
from robo47_qp.sim.camera import CameraNoise, ObjectCamera
from robo47_qp.sim.scene import BuildScene
from robo47_qp.sim.simulation import Simulation


@dataclass(frozen=True, kw_only=True, eq=False)
class Push(Checked):
    """A constant force on the tool point for a limited time."""

    force: Annotated[Vector, Size(3)]
    """The force (3,), in the world [N]."""
    start: NotNegative
    """Time at which it begins [s]."""
    duration: NotNegative = 0.2
    """Time for which it lasts [s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Disturbance(Checked):
    """The errors of one world; by default none."""

    payload: Payload | None = None
    """A body fixed to the tool that the controller does not know."""
    inertia_factor: Positive = 1.0
    """Mass and inertia of every link of the robot, relative to the model [-]."""
    pushes: Sequence[Push] = ()
    delay: CountOrZero = 0
    """Control periods from a command to the motors."""
    noise_q: NotNegative = 0.0
    """Standard deviation of the measured joint positions [rad]."""
    noise_v: NotNegative = 0.0
    """Standard deviation of the measured joint velocities [rad/s]."""
    noise_force: NotNegative = 0.0
    """Standard deviation of each component of the measured tool force [N]."""
    object_mass_factor: Positive = 1.0
    """Mass and inertia of the free bodies, relative to the model [-]."""
    friction_factor: Positive = 1.0
    """Sliding, torsional and rolling friction of all contacts, relative to the model [-]."""
    pose_noise: NotNegative = 0.0
    """Standard deviation of each measured coordinate of an object, per camera frame [m]."""
    heading_noise: NotNegative = 0.0
    """Standard deviation of an object's measured heading, per camera frame [rad]."""
    pose_bias: NotNegative = 0.0
    """Standard deviation of an object's constant error of each measured coordinate [m]."""
    camera_rate: Positive = 30.0
    """Frames per second of a camera with errors; one without measures poses at once [1/s]."""

    @property
    def noisy(self) -> bool:
        """True where a measurement has an error."""
        joints_and_force = self.noise_q or self.noise_v or self.noise_force
        return bool(joints_and_force or self.pose_noise or self.heading_noise or self.pose_bias)


class DisturbedSimulation(Simulation):
    """A simulation with a disturbance.

    It affects motors, inertias, friction and the measured state, tool force and poses;
    `write_now`, `write_last`, `true_state`, `last_tool_force` and `object_pose` are true values.
    """

    def __init__(
        self,
        robot: Robot,
        build_scene: BuildScene,
        disturbance: Disturbance,
        rng: np.random.Generator | None = None,
    ) -> None:
        """Compile the disturbed scene.

        Args:
            robot: See `Simulation`.
            build_scene: See `Simulation`.
            disturbance: The errors of the world.
            rng: Source of the sensor noise; the camera's seed is drawn from it once, here.

        Raises:
            InvalidValueError: There is noise, but no generator.
            UnknownNameError, ModelError: See `Simulation`.
        """
        if rng is None and disturbance.noisy:
            raise InvalidValueError("rng", None, "a numpy Generator where there is sensor noise")
        self.disturbance = disturbance
        self._rng = rng
        self._delayed: deque[Vector] = deque()
        self._camera: ObjectCamera | None = None
        super().__init__(robot, _carrying(robot, build_scene, disturbance.payload))
        self._scale_world()
        noise = CameraNoise(
            position=disturbance.pose_noise,
            heading=disturbance.heading_noise,
            bias=disturbance.pose_bias,
            rate=disturbance.camera_rate,
        )
        if rng is not None and (noise.position or noise.heading or noise.bias):
            self._camera = ObjectCamera(self.objects, noise, int(rng.integers(2**63)))
            self._camera.take(self.time, self.object_pose)

    def reset(self) -> None:
        """See `Simulation.reset`; the delayed commands are those that hold the arm."""
        super().reset()
        if self._camera is not None:
            self._camera.take(self.time, self.object_pose)
        held = self.motor_torque()
        self._delayed = deque(held.copy() for _ in range(self.disturbance.delay))

    def step(self, tau: Vector) -> None:
        """See `Simulation.step`; with the command of `delay` periods ago and the pushes."""
        self._delayed.append(tau.copy())
        if self.disturbance.pushes:
            self._push()
        super().step(self._delayed.popleft())
        if self._camera is not None:
            self._camera.watch(self.time, self.object_pose)

    def state(self) -> JointState:
        """See `Simulation.state`."""
        state, noise = super().state(), self.disturbance
        if self._rng is None or not (noise.noise_q or noise.noise_v):
            return state
        n = len(state.q)
        return JointState(
            state.q + noise.noise_q * self._rng.standard_normal(n),
            state.v + noise.noise_v * self._rng.standard_normal(n),
        )

    def felt_force(self) -> Vector:
        """See `Simulation.felt_force`."""
        force = super().felt_force()
        if self._rng is None or not self.disturbance.noise_force:
            return force
        return force + self.disturbance.noise_force * self._rng.standard_normal(3)

    def true_state(self) -> JointState:
        """See `Simulation.true_state`."""
        return super().state()

    def seen_pose(self, name: str) -> SE3:
        """See `Simulation.seen_pose`; measured in the last frame of the camera."""
        T_world_object = self.object_pose(name)
        return T_world_object if self._camera is None else self._camera.seen(name)

    @property
    def camera_noise(self) -> float:
        """See `Simulation.camera_noise`."""
        return self.disturbance.pose_noise

    @property
    def weights_known(self) -> bool:
        """See `Simulation.weights_known`."""
        return self.disturbance.object_mass_factor == 1.0

    def place_object(self, name: str, T_world_object: SE3) -> None:
        """See `Simulation.place_object`; the camera takes a new frame at once."""
        super().place_object(name, T_world_object)
        if self._camera is not None:
            self._camera.take(self.time, self.object_pose)

    def _push(self) -> None:
        m, d, zero = self.model, self.data, np.zeros(3)
        d.qfrc_applied[:] = 0.0
        for push in self.disturbance.pushes:
            # Half a period of slack: sums of the timestep are not exact.
            if -0.5 * TIMESTEP <= self.time - push.start < push.duration - 0.5 * TIMESTEP:
                tcp = m.site(self.robot.tcp).id
                point, body = d.site_xpos[tcp], int(m.site_bodyid[tcp])
                mujoco.mj_applyFT(m, d, push.force, zero, point, body, d.qfrc_applied)

    def _scale_world(self) -> None:
        m, wrong = self.model, self.disturbance
        m.geom_friction *= wrong.friction_factor
        m.pair_friction *= wrong.friction_factor
        tools = [int(m.site_bodyid[m.site(tool.tcp).id]) for tool in self.robot.tools]
        links = np.isin(m.body_rootid, m.body_rootid[tools])
        for i in np.flatnonzero(links):
            links[i] = m.body(i).name != _PAYLOAD
        free = np.isin(m.body_rootid, [m.body(name).id for name in self.objects])
        for bodies, factor in ((links, wrong.inertia_factor), (free, wrong.object_mass_factor)):
            m.body_mass[bodies] *= factor
            m.body_inertia[bodies] *= factor
        if wrong.inertia_factor != 1.0 or wrong.object_mass_factor != 1.0:
            mujoco.mj_setConst(m, self.data)
            self.reset()


_PAYLOAD = "unknown_payload"


def _carrying(robot: Robot, build_scene: BuildScene, payload: Payload | None) -> BuildScene:
    def build(spec: mujoco.MjSpec) -> None:
        build_scene(spec)
        if payload is not None:
            add_payload(spec, robot.tools[0], payload, _PAYLOAD)

    return build
