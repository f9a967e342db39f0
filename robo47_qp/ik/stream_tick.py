"""What a stream of joint commands says of each tick."""

from dataclasses import dataclass
from enum import Enum

from robo47_qp.arrays import Vector


class Event(Enum):
    """What a tick had to put up with."""

    TARGET_REFUSED = "the target is no finite pose: the arm brakes"
    TARGET_JUMPED = "the target moved farther than the tool can: its velocity is not followed"
    TOO_CLOSE = "a pair of geoms is closer than the clearance: it is parted"
    CLEARANCE_RELAXED = "joint limits leave no velocity with room to brake before every clearance"
    RECOVERING = "a joint was outside its limits, or too fast to stop inside: it is brought back"
    NO_ANSWER = "the QP solver found no answer: the arm brakes"


@dataclass(frozen=True, kw_only=True, eq=False)
class StreamTick:
    """The command for the next tick, and how things stood when it was asked for."""

    q: Vector
    """Position at the next tick (n,) [rad]."""
    v: Vector
    """Velocity at the next tick (n,) [rad/s]."""
    a: Vector
    """Acceleration until then, constant (n,) [rad/s²]."""
    position_error: float
    """Distance of the tool from the target, both now; NaN where the target was refused [m]."""
    orientation_error: float
    """Angle between the tool and the target, both now; NaN where it was refused [rad]."""
    clearance: float
    """Smallest distance of the pairs of geoms looked at now; infinite where none was near [m]."""
    rows: int
    """Pairs of geoms that bounded the velocity."""
    events: tuple[Event, ...]
    """What this tick had to put up with, in the order of `Event`."""
