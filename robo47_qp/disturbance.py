"""Disturbance: what goes wrong in the world without the controller being told."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from robo47_qp.arm import JointState
from robo47_qp.arrays import Vector, frozen_vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.robot import Robot
from robo47_qp.robot_model import add_payload
from robo47_qp.scene import TIMESTEP, BuildScene
from robo47_qp.simulation import Simulation
from robo47_qp.waypoint import Payload


@dataclass(frozen=True, kw_only=True, eq=False)
class Push:
    """A constant force on the tool point for a while."""

    force: Vector
    """(3,), in the world [N]."""
    start: float
    """When it begins [s]."""
    duration: float = 0.2
    """How long it lasts [s]."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: The force is not three finite numbers, or a time is negative.
        """
        object.__setattr__(self, "force", frozen_vector("force", self.force, 3))
        for name in ("start", "duration"):
            _check_finite(name, getattr(self, name))


@dataclass(frozen=True, kw_only=True, eq=False)
class Disturbance:
    """All that is wrong in one world; by default nothing."""

    payload: Payload | None = None
    """A body fixed to the tool that no one told the controller of."""
    inertia_factor: float = 1.0
    """Mass and inertia of every link of the robot, relative to its model [-]."""
    pushes: Sequence[Push] = ()
    delay: int = 0
    """Control periods from a command to the motors."""
    noise_q: float = 0.0
    """Standard deviation of the measured joint positions [rad]."""
    noise_v: float = 0.0
    """Standard deviation of the measured joint velocities [rad/s]."""
    noise_force: float = 0.0
    """Standard deviation of each component of the tool force that controllers feel [N]."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: A number is negative or not finite, or the factor 0.
        """
        for name in ("inertia_factor", "noise_q", "noise_v", "noise_force", "delay"):
            _check_finite(name, getattr(self, name))
        if self.inertia_factor == 0.0:
            raise InvalidValueError("inertia_factor", 0.0, "above 0")


class DisturbedSimulation(Simulation):
    """A simulation with a disturbance, which what it records shows and what it measures hides.

    Motors, inertias, the state and the tool force that controllers see are disturbed;
    `write_now`, `write_last` and `last_tool_force` tell the truth.
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
            disturbance: What is wrong.
            rng: Source of the sensor noise.

        Raises:
            InvalidValueError: There is noise and no generator.
            UnknownNameError, ModelError: See `Simulation`.
        """
        noises = (disturbance.noise_q, disturbance.noise_v, disturbance.noise_force)
        if rng is None and any(noises):
            raise InvalidValueError("rng", None, "a numpy Generator where there is sensor noise")
        self.disturbance = disturbance
        self._rng = rng
        self._on_the_way: deque[Vector] = deque()
        super().__init__(robot, _carrying(robot, build_scene, disturbance.payload))
        if disturbance.inertia_factor != 1.0:
            self._scale_links(disturbance.inertia_factor)
            self.reset()

    def reset(self) -> None:
        """As `Simulation.reset`; commands on the way are those that hold the arm."""
        super().reset()
        held = self.motor_torque()
        self._on_the_way = deque(held.copy() for _ in range(self.disturbance.delay))

    def step(self, tau: Vector) -> None:
        """As `Simulation.step`, with the command of `delay` periods ago and the pushes of now."""
        self._on_the_way.append(tau.copy())
        if self.disturbance.pushes:
            self._push()
        super().step(self._on_the_way.popleft())

    def state(self) -> JointState:
        """What the sensors say."""
        state, noise = super().state(), self.disturbance
        if self._rng is None:
            return state
        n = len(state.q)
        return JointState(
            state.q + noise.noise_q * self._rng.standard_normal(n),
            state.v + noise.noise_v * self._rng.standard_normal(n),
        )

    def felt_force(self) -> Vector:
        """What the sensor at the wrist says of `last_tool_force` (3,) [N]."""
        force = super().felt_force()
        if self._rng is None or not self.disturbance.noise_force:
            return force
        return force + self.disturbance.noise_force * self._rng.standard_normal(3)

    def true_state(self) -> JointState:
        """What the joints do."""
        return super().state()

    def _push(self) -> None:
        m, d, zero = self.model, self.data, np.zeros(3)
        d.qfrc_applied[:] = 0.0
        for push in self.disturbance.pushes:
            # Half a period of slack: sums of the timestep are not exact.
            if -0.5 * TIMESTEP <= self.time - push.start < push.duration - 0.5 * TIMESTEP:
                tcp = m.site(self.robot.tcp).id
                point, body = d.site_xpos[tcp], int(m.site_bodyid[tcp])
                mujoco.mj_applyFT(m, d, push.force, zero, point, body, d.qfrc_applied)

    def _scale_links(self, factor: float) -> None:
        m = self.model
        tool = int(m.site_bodyid[m.site(self.robot.tcp).id])
        links = m.body_rootid == m.body_rootid[tool]
        for i in np.flatnonzero(links):
            links[i] = m.body(i).name != _PAYLOAD
        m.body_mass[links] *= factor
        m.body_inertia[links] *= factor
        mujoco.mj_setConst(m, self.data)


_PAYLOAD = "unknown_payload"


def _carrying(robot: Robot, build_scene: BuildScene, payload: Payload | None) -> BuildScene:
    def build(spec: mujoco.MjSpec) -> None:
        build_scene(spec)
        if payload is not None:
            add_payload(spec, robot, payload, _PAYLOAD)

    return build


def _check_finite(name: str, value: float) -> None:
    if not (np.isfinite(value) and value >= 0.0):
        raise InvalidValueError(name, value, "finite and not negative")
