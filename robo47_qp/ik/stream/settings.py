"""Settings of differential inverse kinematics at a fixed rate, and what a tick returns."""

from dataclasses import dataclass
from enum import Enum
from typing import Annotated

from robo47_qp.arrays import (
    Checked,
    Count,
    NotNegative,
    Positive,
    Range,
    Ratio,
    Vector,
    frozen_list,
)
from robo47_qp.errors import InvalidValueError
from robo47_qp.ik.objectives import ConstraintSource, LimitSource, Objective, TaskSource
from robo47_qp.ik.tool_demand import FULL, ToolDemand, check_demand
from robo47_qp.model.robot import MotionProfile


@dataclass(frozen=True, kw_only=True)
class StreamSettings(Checked):
    """How a target is followed, and what is kept on the way."""

    dt: Positive = 1e-3
    """Length of a tick [s]."""
    gain: Positive = 50.0
    """Part of a short remaining way that is gone per second; lower is softer [1/s]."""
    reserve: Ratio = 0.6
    """Part of v_max and a_max that the way to a target is planned with; the rest is left for
    curved motion and for what the target itself does."""
    radian_length: Positive = 0.3
    """Distance that weighs as much as a radian [m]."""
    max_distance: Positive = 0.5
    """Distance ahead that is looked at in one tick [m]."""
    joint_weight: Positive = 1e-3
    """μ: weight of joint velocities beside those of the tool [m²]."""
    singular_threshold: Positive = 0.02
    """Directions of the tool with less than this part of the largest singular value are
    damped."""
    home_gain: NotNegative = 1.0
    """Pace of the return home in the null space; 0 for none [1/s]."""
    margin: Annotated[float, Range(at_least=0.0, below=0.5)] = 1e-6
    """Part of every joint limit that is left unused, against rounding."""
    clearance: NotNegative | None = None
    """Distance to keep between links and from obstacles [m]; None to look at no collisions."""
    buffer: NotNegative = 0.002
    """More than the clearance is aimed at, by this, against curved motion [m]."""
    braking_share: Ratio = 0.5
    """Part of the deceleration of all joints together that is counted on to keep pairs apart."""
    max_pairs: Count = 20
    """Most pairs of geoms whose distance is measured, and that bound the velocity, in a tick; for a
    robot of two tools four times as many, for three nine times."""
    backend: str = "daqp"
    """QP solver."""
    demand: ToolDemand = FULL
    """What of the tool's pose is asked for; of several tools, of each."""
    objectives: tuple[Objective | TaskSource, ...] = ()
    """What is asked for besides: tasks of mink or of the user's own, or functions of an arm that
    make them. A bare task has priority 1: it moves the arm in the freedom that the tool leaves."""
    limits: tuple[LimitSource, ...] = ()
    """What is kept besides: limits of mink or of the user's own, or functions of an arm that make
    them."""
    constraints: tuple[ConstraintSource, ...] = ()
    """Tasks whose errors are kept at zero, or brought there: closed chains, coupled joints."""
    frozen: tuple[str, ...] = ()
    """Names of the joints that stand still."""
    profile: MotionProfile | None = None
    """Velocity and acceleration limits; None for the robot's own profile."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: A setting is out of range.
        """
        super().__post_init__()
        check_demand(self.demand)
        for name in ("objectives", "limits", "constraints", "frozen"):
            object.__setattr__(self, name, frozen_list(name, getattr(self, name)))
        if self.gain * self.dt > 0.3:
            most = f"at most {0.3 / self.dt:g} at a tick of {self.dt:g} s, or it oscillates"
            raise InvalidValueError("gain", self.gain, most)


class Event(Enum):
    """Conditions that a tick reports."""

    TARGET_REFUSED = "the target is no finite pose: the arm brakes, or that tool holds still"
    TARGET_JUMPED = "the target moved farther than the tool can: its velocity is not followed"
    TOO_CLOSE = "a pair of geoms is closer than the clearance: it is parted"
    CLEARANCE_RELAXED = "joint limits leave no velocity with room to brake before every clearance"
    STOPPING = "after the step asked for no stop would keep every clearance: the arm brakes"
    LIMIT_RELAXED = "no velocity keeps joint limits, clearances and a user's limit: that gives way"
    CONSTRAINT_RELAXED = "nor does any keep a user's constraint beside them: it gives way, too"
    OBJECTIVE_RELAXED = "an objective of the user is not met at the pace it asks for"
    OBJECTIVE_LEFT_OUT = "an objective of the user raised or was not finite: it is left out"
    LIMIT_LEFT_OUT = "a limit of the user raised or was not finite: it is left out"
    CONSTRAINT_LEFT_OUT = "a constraint of the user raised or was not finite: it is left out"
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
    """Conditions of this tick, in the order of `Event`."""
