"""Arms that something carries: a rail, a mobile base."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.robot import MotionProfile, Robot

_BESIDE_FILE = (
    *("hand", "T_world_base", "mounts", "tool", "more_tools"),
    *("armature", "damping", "dry_friction"),
)
"""Fields of a robot that are not of its file."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Carrier:
    """The joints between the world and the base of an arm, with their ratings.

    For a sliding joint read m for rad and N for N·m.
    """

    name: str
    """Name of the robot that the carrier makes of an arm."""
    mjcf: Path
    """MJCF file of the carrier, which attaches the file of the arm to it."""
    prefix: str
    """What the file puts before every name of the arm."""
    joints: tuple[str, ...]
    """The k joints of the carrier, from the world to the arm."""
    slides: tuple[str, ...]
    """The sliding joints among them."""
    rated: MotionProfile
    """Limits of the manufacturer."""
    profile: MotionProfile
    """Limits of motions by default."""
    tau_max: Vector
    """Torque limits (k,) [N·m]."""
    tau_rate_max: Vector
    """Torque-rate limits (k,) [N·m/s]."""
    stiffness: Vector
    """Joint impedance stiffness used by default (k,) [N·m/rad]."""

    def carrying(self, arm: Robot) -> Robot:
        """Return an arm on this carrier; its joints come after those of the carrier, at zero.

        Args:
            arm: An arm with one tool, whose file `mjcf` attaches and which is all in that file.

        Raises:
            InvalidValueError: The arm has more than its file; see `Robot`.
        """
        beside = {name: getattr(arm, name) for name in _BESIDE_FILE}
        more = [name for name, value in beside.items() if value is not None and np.size(value)]
        if more:
            raise InvalidValueError(
                "arm on a carrier",
                f"{arm.name!r} with {', '.join(more)} beside its file",
                "one that is all in its file: write them there, and attach that",
            )
        before = self.prefix
        return replace(
            arm,
            name=self.name,
            mjcf=self.mjcf,
            joints=(*self.joints, *(before + joint for joint in arm.joints)),
            slides=(*self.slides, *(before + joint for joint in arm.slides)),
            motors=(
                *(f"{joint}_drive" for joint in self.joints),
                *(before + m for m in arm.motors),
            ),
            # The file has the arm's motors before those of the carrier, or none for the carrier.
            has_motors=False,
            tcp=before + arm.tcp,
            home=np.concatenate([np.zeros(len(self.joints)), arm.home]),
            rated=self.rated.followed_by(arm.rated),
            profile=self.profile.followed_by(arm.profile),
            tau_max=np.concatenate([self.tau_max, arm.tau_max]),
            tau_rate_max=np.concatenate([self.tau_rate_max, arm.tau_rate_max]),
            stiffness=np.concatenate([self.stiffness, arm.stiffness]),
            gripper=None if arm.gripper is None else arm.gripper.prefixed(before),
            menagerie=None,
        )
