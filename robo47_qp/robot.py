"""Robot: the frozen description of an arm, its limits and its gripper."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robo47_qp.arrays import Vector, frozen_vector
from robo47_qp.errors import InvalidValueError, ModelError


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionProfile:
    """Bounds on a joint-space reference; each a vector of shape (n,)."""

    v_max: Vector
    """Largest joint speed [rad/s]."""
    a_max: Vector
    """Largest joint acceleration [rad/s²]."""
    j_max: Vector
    """Largest joint jerk [rad/s³]."""

    def __post_init__(self) -> None:
        """Freeze the arrays.

        Raises:
            InvalidValueError: A bound is not positive and finite, or the lengths differ.
        """
        n = np.size(self.v_max)
        for name in ("v_max", "a_max", "j_max"):
            bound = frozen_vector(name, getattr(self, name), n)
            if (bound <= 0.0).any():
                raise InvalidValueError(name, bound.tolist(), "positive in every joint")
            object.__setattr__(self, name, bound)

    @classmethod
    def uniform(cls, n: int, *, v: float, a: float, j: float) -> "MotionProfile":
        """The same bounds for each of n joints [rad/s, rad/s², rad/s³]."""
        return cls(v_max=np.full(n, v), a_max=np.full(n, a), j_max=np.full(n, j))

    def slowed(self, speed: float) -> "MotionProfile":
        """The profile of the same paths run at `speed` times the pace.

        Stretching time by 1/s scales velocity by s, acceleration by s² and jerk by s³.

        Args:
            speed: Pace in (0, 1].

        Raises:
            InvalidValueError: `speed` is outside (0, 1].
        """
        if not 0.0 < speed <= 1.0:
            raise InvalidValueError("speed", speed, "above 0 and at most 1")
        return MotionProfile(
            v_max=self.v_max * speed, a_max=self.a_max * speed**2, j_max=self.j_max * speed**3
        )


@dataclass(frozen=True, kw_only=True)
class Gripper:
    """A parallel gripper with two mirrored sliding fingers."""

    joints: tuple[str, str]
    """Finger joints; the opening width is the sum of their positions."""
    fingers: tuple[str, str]
    """Bodies of the two fingers, in the order of `joints`."""
    actuator: str
    """Position servo on the opening width [m], with a force limit."""
    width_max: float
    """Opening width when fully open [m]."""
    speed_max: float
    """Largest speed of the opening width [m/s]."""
    force_max: float
    """Largest force of one finger on the object [N]."""
    force_gain: float
    """Force limit of the actuator per newton of finger force [-]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Robot:
    """An arm with n joints: where its model is, what it may do. No state."""

    name: str
    mjcf: Path
    """MJCF file with one torque motor per joint, named in `motors`."""
    joints: tuple[str, ...]
    """The n arm joints, base to tip."""
    motors: tuple[str, ...]
    """Torque motors, in the order of `joints`."""
    tcp: str
    """Site that is the tool frame: z points out of the tool."""
    home: Vector
    """Rest configuration (n,) [rad]."""
    rated: MotionProfile
    """What the manufacturer allows."""
    profile: MotionProfile
    """What is used unless something else is asked for."""
    tau_max: Vector
    """Torque limits (n,) [N·m]."""
    tau_rate_max: Vector
    """Torque-rate limits (n,) [N·m/s]."""
    stiffness: Vector
    """Joint impedance stiffness used by default (n,) [N·m/rad]."""
    gripper: Gripper
    menagerie: str | None = None
    """Directory and file of the same robot in MuJoCo Menagerie, for its meshes."""

    def __post_init__(self) -> None:
        """Freeze the arrays.

        Raises:
            InvalidValueError: A field has the wrong length or is not finite.
            ModelError: The MJCF file does not exist.
        """
        n = len(self.joints)
        for name in ("home", "tau_max", "tau_rate_max", "stiffness"):
            object.__setattr__(self, name, frozen_vector(name, getattr(self, name), n))
        for name in ("rated", "profile"):
            profile: MotionProfile = getattr(self, name)
            frozen_vector(f"{name}.v_max", profile.v_max, n)
        if len(self.motors) != n:
            raise InvalidValueError("motors", self.motors, f"{n} names, one per joint")
        if not self.mjcf.is_file():
            raise ModelError(f"Robot {self.name!r} needs the model {self.mjcf}: no such file.")
