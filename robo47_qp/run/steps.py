"""Steps: the words that a task's program is written in."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf
from typing import Literal

import numpy as np
from mink import SE3

from robo47_qp.arrays import Vector, frozen_vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.gripper import Grip
from robo47_qp.model.payload import Payload
from robo47_qp.motion.waypoint import Motion, Waypoint
from robo47_qp.run.failure import Cause


@dataclass(frozen=True, kw_only=True)
class Condition:
    """Something that has to be so before, during or after a step."""

    name: str
    """What has to be so: "the cube is held"."""
    cause: Cause
    """Why the run failed, if this was not so."""
    against: Callable[[], str | None]
    """Looks at the world as it is: what speaks against it, with numbers; None where it is so."""


@dataclass(frozen=True, kw_only=True)
class _Conditions:
    before: tuple[Condition, ...] = ()
    """What has to be so, or the step is not begun."""
    after: tuple[Condition, ...] = ()
    """What has to be so at the end, or the step has failed."""


@dataclass(frozen=True, kw_only=True)
class Move(_Conditions):
    """Visit waypoints that are known together: planned as one, whole, before it runs."""

    waypoints: tuple[Waypoint, ...]
    during: tuple[Condition, ...] = ()
    """What has to be so all along: where it is not, the arm stops and the step has failed."""

    @property
    def name(self) -> str:
        """Name of the last waypoint."""
        return self.waypoints[-1].name

    def __post_init__(self) -> None:
        """Check that there is somewhere to go.

        Raises:
            InvalidValueError: There is no waypoint.
        """
        if not self.waypoints:
            raise InvalidValueError("waypoints of a move", "none", "at least one waypoint")


@dataclass(frozen=True, kw_only=True)
class Grasp(_Conditions):
    """Close the fingers and wait until they stand still."""

    force: float
    """Of one finger [N]."""
    width: float = 0.0
    """Opening width to close to, if nothing is in between [m]."""
    speed: float = inf
    """Rate of the opening width at most, beside that of the gripper [m/s]."""
    compliance: "Compliance | None" = None
    """How the tool gives way meanwhile, to fingers that do not meet at once; None is stiff."""
    name: str = "grasp"


@dataclass(frozen=True, kw_only=True)
class Release(_Conditions):
    """Open the fingers and wait until they stand still; the tool carries nothing from then on."""

    width: float | None = None
    """Opening width to open to [m]; None opens them fully."""
    name: str = "release"


@dataclass(frozen=True, kw_only=True)
class Wait(_Conditions):
    """Stand still until something is so."""

    seconds: float
    """How long at most; the whole time where `until` is None [s]."""
    until: Condition | None = None
    """What is waited for; the step fails with its cause if it does not come to be so."""
    name: str = "wait"


@dataclass(frozen=True, kw_only=True)
class Guarded(_Conditions):
    """Go on a straight line until something is touched, and stop there."""

    waypoint: Waypoint
    """Where the line ends; its pace is that of the waypoint, or less: see `speed`."""
    force: float
    """Change of the contact force on the tool that counts as touching [N]."""
    speed: float = 0.02
    """Speed of the tool at most [m/s]."""
    missing: Cause | None = Cause.TIMEOUT
    """Why the run failed if nothing was touched up to the end; None where that is fine."""

    @property
    def name(self) -> str:
        """Name of the waypoint."""
        return self.waypoint.name

    def __post_init__(self) -> None:
        """Check motion and force.

        Raises:
            InvalidValueError: The motion is not LIN, or force or speed are not positive.
        """
        if self.waypoint.motion is not Motion.LIN:
            raise InvalidValueError("guarded motion", self.waypoint.motion.name, "LIN")
        for name in ("force", "speed"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise InvalidValueError(name, getattr(self, name), "positive and finite")


@dataclass(frozen=True, kw_only=True, eq=False)
class Compliance:
    """How the tool gives way while it is in contact, and how hard it presses."""

    stiffness: Vector = field(default_factory=lambda: np.array([800.0] * 3 + [40.0] * 3))
    """Per axis of the frame (6,), linear part first [N/m, N·m/rad]."""
    frame: Literal["world", "tool"] = "world"
    """Whose axes the stiffness has."""
    axis: Vector | None = None
    """Direction to press in, in the world (3,), of length 1; None does not press. With the frame
    "tool" it turns with the tool from the beginning of the step on. Along it the reference is not
    followed: let the waypoints be level."""
    force: float = 0.0
    """Force to press with, along the axis [N]; held whatever the surface does."""
    speed: float = 0.1
    """Speed along the axis at most while nothing is touched [m/s]."""

    def __post_init__(self) -> None:
        """Check and freeze the numbers.

        Raises:
            InvalidValueError: A number is negative, not finite or of the wrong shape.
        """
        stiffness = frozen_vector("stiffness", self.stiffness, 6)
        if (stiffness < 0.0).any():
            raise InvalidValueError("stiffness", stiffness.tolist(), "six numbers, none negative")
        object.__setattr__(self, "stiffness", stiffness)
        if self.axis is not None:
            axis = frozen_vector("axis", self.axis, 3)
            if abs(np.linalg.norm(axis) - 1.0) > 1e-6:
                raise InvalidValueError("axis", axis.tolist(), "of length 1")
            object.__setattr__(self, "axis", axis)
        if self.frame not in ("world", "tool"):
            raise InvalidValueError("frame", repr(self.frame), "'world' or 'tool'")
        for name in ("force", "speed"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= 0.0):
                raise InvalidValueError(name, getattr(self, name), "finite and not negative")
        if (self.axis is None) != (self.force == 0.0):
            raise InvalidValueError(
                "force", f"{self.force} N with axis {self.axis}", "above 0 with an axis, or neither"
            )


@dataclass(frozen=True, kw_only=True)
class Comply(_Conditions):
    """Lead the tool along waypoints on springs, pressing where that is asked for.

    The tool starts from where it is and may end elsewhere than its last waypoint.
    """

    waypoints: tuple[Waypoint, ...]
    """LIN and CIRC waypoints; none where the tool only presses, see `seconds`."""
    compliance: Compliance
    carried: Payload | None = None
    """What the tool holds from now on; None leaves the belief about that as it is."""
    speed: float = inf
    """Speed along the waypoints at most, beside their own pace [m/s]."""
    seconds: float = 0.0
    """How long to stay at the end of the way, at most [s]."""
    until: Condition | None = None
    """What ends the step at once; it fails with the condition's cause if that is not so at the
    end. None goes to the end of the way."""
    during: tuple[Condition, ...] = ()
    """What has to be so all along: where it is not, the arm stops and the step has failed."""
    observe: Callable[[], None] | None = None
    """Called every few periods, to take notes of the world."""
    stay: bool = False
    """True: go on yielding to the next step, if that complies too. It then starts from the
    reference of this one, and with the same compliance nothing changes in between."""
    renew: bool = False
    """After a step that stays: True starts from where the tool has come to, its springs without
    load, instead of from the reference of that step."""
    name: str = "comply"

    def __post_init__(self) -> None:
        """Check that there is something to do.

        Raises:
            InvalidValueError: A waypoint is reached by PTP, a number is out of range, or the
                step is over at once.
        """
        bent = [waypoint.name for waypoint in self.waypoints if waypoint.motion is Motion.PTP]
        if bent:
            raise InvalidValueError("compliant motion", bent, "waypoints reached by LIN or CIRC")
        if not self.speed > 0.0:
            raise InvalidValueError("speed", self.speed, "positive")
        if not (np.isfinite(self.seconds) and self.seconds >= 0.0):
            raise InvalidValueError("seconds", self.seconds, "finite and not negative")
        if not self.waypoints and self.seconds == 0.0:
            raise InvalidValueError(
                self.name, "no waypoint and 0 s", "waypoints, or a time to stay"
            )


@dataclass(frozen=True, kw_only=True)
class Follow(_Conditions):
    """Keep the tool at a pose that moves, by differential inverse kinematics."""

    target: Callable[[float], SE3 | None]
    """T_world_tcp wanted at a time [s]; asked for at every control period, a few of them ahead.
    None brakes."""
    until: Condition
    """What ends the step; it fails with the condition's cause if that is not so in time."""
    seconds: float
    """How long at most [s]."""
    grip: Grip | None = None
    """What the fingers begin to do as the step begins."""
    carried: Payload | None = None
    """What the tool holds meanwhile."""
    name: str = "follow"


Step = Move | Grasp | Release | Wait | Guarded | Comply | Follow
StepLike = Waypoint | tuple[Waypoint, ...] | Step
"""One entry of a program: a waypoint, or several known together, stand for a `Move`."""


def as_step(step: StepLike) -> Step:
    """What a step stands for."""
    if isinstance(step, Waypoint):
        return Move(waypoints=(step,))
    return Move(waypoints=step) if isinstance(step, tuple) else step
