"""Perturbation: how far the world of an episode may be from what the controller believes."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import InvalidValueError
from robo47_qp.sim.disturbance import Disturbance, Push

PUSHES = 3
"""Pushes that are drawn for every episode, whether or not it uses them."""


@dataclass(frozen=True, kw_only=True)
class Perturbation:
    """Ranges that the disturbance of an episode is drawn from; by default nothing is wrong."""

    pose_noise: float = 0.0
    """Standard deviation of each coordinate of an object, in every frame of the camera [m]."""
    heading_noise: float = 0.0
    """Standard deviation of an object's turn about the vertical, in every frame [rad]."""
    pose_bias: float = 0.0
    """Standard deviation of an error of each coordinate that lasts for the episode [m]."""
    camera_rate: float = 30.0
    """Frames per second [1/s]."""
    object_mass: float = 0.0
    """Mass of the free objects: at most this part more or less, below 1 [-]."""
    friction: float = 0.0
    """Friction of all contacts: at most this part more or less, below 1 [-]."""
    latency: float = 0.0
    """Time from a command to the motors, in whole control periods [s]."""
    noise_q: float = 0.0
    """Standard deviation of the measured joint positions [rad]."""
    noise_v: float = 0.0
    """Standard deviation of the measured joint velocities [rad/s]."""
    pushes: int = 0
    """Pushes on the tool in an episode."""
    push_force: float = 0.0
    """Size of a push at most; its direction is any [N]."""
    push_time: float = 10.0
    """When a push begins at the latest [s]."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: One is out of range.
        """
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value >= 0.0):
                raise InvalidValueError(name, value, "finite and not negative")
        for name in ("object_mass", "friction"):
            if getattr(self, name) >= 1.0:
                raise InvalidValueError(name, getattr(self, name), "below 1")
        if self.camera_rate == 0.0:
            raise InvalidValueError("camera_rate", 0.0, "above 0")
        if self.pushes > PUSHES:
            raise InvalidValueError("pushes", self.pushes, f"{PUSHES} at most")

    def draw(self, rng: np.random.Generator) -> Disturbance:
        """The disturbance of one episode.

        The same numbers are drawn whatever the ranges are: episodes with the same seed differ
        in nothing but what was asked for.
        """
        mass, friction = rng.uniform(-1.0, 1.0, 2)
        directions, sizes = rng.standard_normal((PUSHES, 3)), rng.uniform(0.0, 1.0, PUSHES)
        starts = rng.uniform(0.0, 1.0, PUSHES)
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        return Disturbance(
            object_mass_factor=float(1.0 + self.object_mass * mass),
            friction_factor=float(1.0 + self.friction * friction),
            pushes=tuple(
                Push(force=self.push_force * sizes[i] * directions[i], start=float(start))
                for i, start in enumerate(self.push_time * starts[: self.pushes])
            ),
            delay=round(self.latency / TIMESTEP),
            noise_q=self.noise_q,
            noise_v=self.noise_v,
            pose_noise=self.pose_noise,
            heading_noise=self.heading_noise,
            pose_bias=self.pose_bias,
            camera_rate=self.camera_rate,
        )


PRESETS: Mapping[str, Perturbation] = {
    "none": Perturbation(),
    "moderate": Perturbation(pose_noise=5e-3, object_mass=0.3, friction=0.3, latency=2e-3),
    "severe": Perturbation(
        pose_noise=10e-3,
        heading_noise=0.1,
        pose_bias=2e-3,
        object_mass=0.6,
        friction=0.5,
        latency=3e-3,
        noise_q=1e-4,
        noise_v=1e-2,
        pushes=2,
        push_force=10.0,
    ),
}
"""Named levels. Moderate is what a calibrated cell with a depth camera has to live with; severe
ends short of what alone ends every run: at a latency of 5 ms, stiff joints cannot be held."""
