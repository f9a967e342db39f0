"""Payload: a rigid body held by the tool, as the controller believes it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from mink import SE3

from robo47_qp.arrays import Checked, Positive
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.robot import Robot
from robo47_qp.model.tool_poses import check_se3


@dataclass(frozen=True, kw_only=True, eq=False)
class Payload(Checked):
    """A rigid body held by the tool, as the controller believes it."""

    mass: Positive
    """[kg]"""
    inertia: tuple[float, float, float]
    """Principal moments about the centre of mass, along the axes of T_tcp_com [kg·m²]."""
    T_tcp_com: SE3
    """Pose of the principal axes, at the centre of mass, in the tool frame."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: The mass is not positive, the inertia not that of a body, or the
                pose none.
        """
        super().__post_init__()
        check_se3("payload T_tcp_com", self.T_tcp_com)
        moments = np.array(self.inertia)
        if (moments <= 0.0).any() or 2 * moments.max() > moments.sum() * (1 + 1e-9):
            raise InvalidValueError(
                "payload inertia",
                moments.tolist(),
                "three positive moments, none above the sum of the others",
            )

    def _label(self, field: str) -> str:
        return f"payload {field}"


Load = Payload | Mapping[str, Payload] | None
"""What the main tool holds, or what each of several tools holds, by their names."""


def loads(robot: Robot, load: Load, factor: float = 1.0) -> dict[str, Payload]:
    """Return what the tools of a robot hold, by their names, with mass and moments by a factor."""
    held = {robot.tools[0].name: load} if isinstance(load, Payload) else dict(load or {})
    if factor == 1.0:
        return held
    for name, one in held.items():
        x, y, z = one.inertia
        moments = (factor * x, factor * y, factor * z)
        held[name] = replace(one, mass=factor * one.mass, inertia=moments)
    return held
