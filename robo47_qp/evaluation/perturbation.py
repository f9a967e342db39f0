"""Perturbation: how much the world of an episode may differ from the controller's models."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any, get_type_hints

import numpy as np

from robo47_qp.arrays import Checked, NotNegative, Positive, Range
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import InvalidValueError, UnknownNameError
from robo47_qp.sim.disturbance import Disturbance, Push

PUSHES = 3
"""Pushes that are drawn for every episode, used or not."""
_Share = Annotated[float, Range(at_least=0.0, below=1.0)]


@dataclass(frozen=True)
class About:
    """Meaning of a perturbation, and its option on the command line."""

    text: str
    unit: str
    """Unit of the option."""
    option: str | None = None
    """By default the name of the field."""
    scale: float = 1
    """Value of the field if the option is 1."""


@dataclass(frozen=True, kw_only=True)
class Perturbation(Checked):
    """Ranges that the disturbance of an episode is drawn from; by default nothing is perturbed.

    Each field states its range and meaning; units are SI.
    """

    pose_noise: Annotated[
        NotNegative, About("Standard deviation of seen coordinates of an object, per frame", "m")
    ] = 0.0
    heading_noise: Annotated[
        NotNegative, About("Standard deviation of the seen heading of an object, per frame", "rad")
    ] = 0.0
    pose_bias: Annotated[
        NotNegative,
        About("Standard deviation of seen coordinates of an object, constant in an episode", "m"),
    ] = 0.0
    camera_rate: Annotated[Positive, About("Frames of the camera per second", "1/s")] = 30.0
    object_mass: Annotated[
        _Share, About("Mass of the free objects, more or less by at most this share", "-", "mass")
    ] = 0.0
    friction: Annotated[
        _Share, About("Friction of all contacts, more or less by at most this share", "-")
    ] = 0.0
    latency: Annotated[
        NotNegative,
        About("Time from a command to the motors, in whole control periods", "ms", scale=1e-3),
    ] = 0.0
    noise_q: Annotated[
        NotNegative, About("Standard deviation of measured joint positions", "rad")
    ] = 0.0
    noise_v: Annotated[
        NotNegative, About("Standard deviation of measured joint velocities", "rad/s")
    ] = 0.0
    pushes: Annotated[
        int,
        Range(at_least=0, at_most=PUSHES, whole=True),
        About("Pushes on the tool in an episode", "count"),
    ] = 0
    push_force: Annotated[NotNegative, About("Force of a push at most, in any direction", "N")] = (
        0.0
    )
    push_time: Annotated[NotNegative, About("Latest start of a push", "s")] = 10.0

    def draw(self, rng: np.random.Generator) -> Disturbance:
        """Return the disturbance of one episode.

        The same random numbers are drawn for any ranges, so that episodes with the same seed
        differ in the chosen perturbations only. Fields with the name of one of `Disturbance` are
        passed on.
        """
        mass, friction = rng.uniform(-1.0, 1.0, 2)
        directions, sizes = rng.standard_normal((PUSHES, 3)), rng.uniform(0.0, 1.0, PUSHES)
        starts = rng.uniform(0.0, 1.0, PUSHES)
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        passed_on = {f.name for f in fields(self)} & {f.name for f in fields(Disturbance)}
        return Disturbance(
            **{name: getattr(self, name) for name in passed_on - {"pushes"}},
            object_mass_factor=float(1.0 + self.object_mass * mass),
            friction_factor=float(1.0 + self.friction * friction),
            pushes=tuple(
                Push(force=self.push_force * sizes[i] * directions[i], start=float(start))
                for i, start in enumerate(self.push_time * starts[: self.pushes])
            ),
            delay=round(self.latency / TIMESTEP),
        )

    def with_options(self, chosen: Mapping[str, float]) -> "Perturbation":
        """Return the perturbation with some values replaced, by the names of their options.

        Raises:
            InvalidValueError: A number is out of range.
            UnknownNameError: There is no such option.
        """
        known = options()
        for option in chosen:
            if option not in known:
                raise UnknownNameError("perturbation", option, known)
        values: dict[str, Any] = {
            known[name][0]: value * known[name][2].scale for name, value in chosen.items()
        }
        try:
            return replace(self, **values)
        except InvalidValueError as error:
            option = next(name for name in chosen if known[name][0] == error.name)
            label = f"--{option.replace('_', '-')}"
            raise InvalidValueError(label, chosen[option], error.expected) from error


def options() -> dict[str, tuple[str, type, About]]:
    """Return field, type and meaning of every perturbation by the name of its option."""
    found = {}
    for name, hint in get_type_hints(Perturbation, include_extras=True).items():
        about = next(one for one in hint.__metadata__ if isinstance(one, About))
        found[about.option or name] = (name, hint.__origin__, about)
    return found


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
"""Named levels. Moderate is a calibrated cell with a depth camera; severe is below what
makes every run fail, such as a latency of 5 ms, with which stiff joints are unstable."""
