"""Exceptions of the package, one class per kind of failure.

Every message says what was asked, what was found and what would work.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum


class Robo47Error(Exception):
    """Base of every error this package raises on purpose."""


class InvalidValueError(Robo47Error):
    """An argument is NaN, out of range, or of the wrong shape."""

    def __init__(self, name: str, found: object, expected: str) -> None:
        """Name the argument, what it was, and what would have been accepted."""
        super().__init__(f"{name} must be {expected}; found {found}.")
        self.name = name
        self.found = found
        self.expected = expected


class UnknownNameError(Robo47Error):
    """A name that the model or the package does not know."""

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        """Name what was looked for and list what exists."""
        self.kind = kind
        self.name = name
        self.known = tuple(known)
        listed = ", ".join(self.known) if self.known else "none"
        super().__init__(f"No {kind} is called {name!r}; known: {listed}.")


class ModelError(Robo47Error):
    """A robot description that cannot be compiled into the model it promises."""


class CoreError(Robo47Error):
    """The compiled core is asked for and cannot be used."""

    def __init__(self, why: str) -> None:
        """Say why, and what would work."""
        super().__init__(
            f"The compiled core cannot be used: {why.rstrip('.')}. Install a wheel of the package, "
            "or build the core with `make core` (needs the packages ziglang and cffi); "
            "ROBO47_BACKEND=numpy chooses the slower numpy reference instead."
        )
        self.why = why


class MenagerieError(ModelError):
    """A model of MuJoCo Menagerie that cannot be loaded.

    Attributes:
        model: Directory and file that were asked for.
        looked_in: Where it was looked for.
    """

    def __init__(self, model: str, looked_in: str, why: str) -> None:
        """Tell what was asked, where it was looked for, and why that failed."""
        super().__init__(
            f"Menagerie's {model} cannot be loaded from {looked_in}: {why}. Set MENAGERIE_ROOT "
            "to a checkout of MuJoCo Menagerie (github.com/google-deepmind/mujoco_menagerie); "
            "without it the package mujoco-menagerie fetches the model at first use."
        )
        self.model = model
        self.looked_in = looked_in


class NoGripperError(Robo47Error):
    """A gripper was asked for and the robot has none."""

    def __init__(self, robot: str, wanted: str) -> None:
        """Name the robot and what needs a gripper."""
        super().__init__(
            f"Robot {robot!r} has no gripper, and {wanted} needs one. Choose a robot with a "
            "gripper, or a task without grips."
        )
        self.robot = robot


class RefusalReason(Enum):
    """Why a motion is refused."""

    REACH = "out of reach"
    """No configuration inside the joint limits puts the tool there."""
    JOINT_LIMIT = "joint limit"
    """In the branch of the start, a joint would leave its limits."""
    SINGULARITY = "singularity"
    """The joints would have to run without bound for the tool to go on."""
    BRANCH = "branch change"
    """The pose can be reached, but not from the configuration before it."""
    COLLISION = "collision"
    """The arm comes too close to itself or to something else."""
    PACE = "pace"
    """The bounds on speed, acceleration or jerk leave next to no motion."""
    PRECISION = "precision"
    """The path can be followed, but not as closely as is asked for."""
    SHAPE = "shape"
    """What was asked for is no path: a blend that does not fit, an arc without a plane."""


@dataclass(frozen=True, kw_only=True)
class Rejection:
    """Why a motion was refused, in terms that a second check can confirm."""

    reason: RefusalReason
    fraction: float = 0.0
    """Where on the motion to the waypoint, 0 at its start and 1 at its end."""
    time: float | None = None
    """When [s]: by the tool's bounds alone where the joints' way is not known; None for what
    has no time."""
    joint: str | None = None
    """The joint at its limit, or the one that would move most."""
    q: tuple[float, ...] | None = None
    """The last configuration that is possible, or the first that is not."""
    pose: tuple[float, ...] | None = None
    """T_world_tcp that is not reached from there: wxyz, then xyz [m]."""


NO_PATH = Rejection(reason=RefusalReason.SHAPE)
"""Waypoints, blends or points on the way that make no path."""


class PlanError(Robo47Error):
    """A waypoint that cannot be reached, or a motion that cannot be planned to it.

    Attributes:
        waypoint: Name of the waypoint.
        explanation: Why it cannot be planned.
        rejection: The same for programs; None where the waypoint itself is not reached.
    """

    def __init__(self, waypoint: str, explanation: str, rejection: Rejection | None = None) -> None:
        """Tell which waypoint is out and why."""
        super().__init__(f"Waypoint {waypoint!r} cannot be planned: {explanation}")
        self.waypoint = waypoint
        self.explanation = explanation
        self.rejection = rejection


class RecordingError(Robo47Error):
    """A recording that cannot be opened, or that could not be written to its end."""


class RenderingError(Robo47Error):
    """Pictures were asked for and the machine cannot draw them."""


class MissingExtraError(Robo47Error):
    """An optional package is needed and not installed."""

    def __init__(self, wanted: str, package: str, extra: str) -> None:
        """Say what needs the package and which extra brings it."""
        super().__init__(
            f"{wanted} needs the package {package}, which is not installed; "
            f"install it where the project's files are: pip install '.[{extra}]'."
        )
        self.package = package
        self.extra = extra


class ArmStopped(Robo47Error):  # noqa: N818  # read as a sentence in `except ArmStopped`
    """A real arm cannot be reached, takes no motion, or has stopped.

    Attributes:
        names: libfranka's names of the errors, separated by commas; empty where it names none.
    """

    def __init__(self, evidence: str, names: str = "") -> None:
        """Say what happened, in the words of the arm where it has some."""
        super().__init__(evidence)
        self.names = names
