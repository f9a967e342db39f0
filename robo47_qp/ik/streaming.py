"""Differential inverse kinematics at a fixed rate: a command for every tick, whatever is asked."""

from collections import Counter
from dataclasses import dataclass
from math import inf, sqrt

import numpy as np
from mink import SE3
from numpy.typing import ArrayLike

from robo47_qp.arm import Arm
from robo47_qp.arrays import Matrix, Vector, checked_vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.ik.approach import TargetMotion, approach_rate, pose_or_none, shortened
from robo47_qp.ik.braking import JointBrakes
from robo47_qp.ik.clearance import clearance_of
from robo47_qp.ik.damped_inverse import DampedInverse
from robo47_qp.ik.separation import Separation
from robo47_qp.ik.speed_qp import SpeedQp
from robo47_qp.ik.stream_tick import Event, StreamTick
from robo47_qp.ik.tool_error import ToolError
from robo47_qp.robot import MotionProfile


@dataclass(frozen=True, kw_only=True)
class StreamIk:
    """Settings of differential IK for a target that moves.

    Each tick asks for the joint velocity v_ref = J⁺ V + φ J⁺ e + (I - J⁺ J) v_home: the
    target's own velocity V, the way e to it at a pace φ at which every joint can stop in time
    (`approach_rate`), and in what is left of the arm's freedom a slow return home. The next
    velocity v' is then

        min over v' of ½ ‖J (v' - v_ref)‖² + ½ μ ‖v' - v_ref‖²   subject to v' in the box

    of `JointBrakes`: limits of position, velocity and acceleration, with the room to brake.
    The box is hard and never empty, so there is always an answer. What gives way is, in
    this order: the null-space motion, the tool's way to the target, and never a joint limit.

    It descends along the way to the target and does not plan. An arm that meets a joint limit
    or an obstacle on that way can stop there though another configuration would reach the
    target: for far targets find the configuration first, by `MultiStart`.
    """

    dt: float = 1e-3
    """Length of a tick [s]."""
    gain: float = 50.0
    """Part of a short remaining way that is gone per second; lower is softer [1/s]."""
    reserve: float = 0.6
    """Part of v_max and a_max that the way to a target is planned with; the rest is left for
    curved motion and for what the target itself does."""
    lever: float = 0.3
    """Distance that weighs as much as a radian [m]."""
    longest_way: float = 0.5
    """Distance ahead that is looked at in one tick [m]."""
    joint_weight: float = 1e-3
    """μ: weight of joint velocities beside those of the tool [m²]."""
    singular: float = 0.02
    """Directions of the tool with less than this part of the largest singular value are
    damped."""
    homing: float = 1.0
    """Pace of the return home in the null space; 0 for none [1/s]."""
    margin: float = 1e-6
    """Part of every joint limit that is left unused, against rounding."""
    clearance: float | None = None
    """Distance to keep between links and from obstacles [m]; None to look at no collisions."""
    buffer: float = 0.002
    """More than the clearance is aimed at, by this, against curved motion [m]."""
    share: float = 0.5
    """Part of the deceleration of all joints together that is counted on to keep pairs apart."""
    budget: int = 24
    """Most pairs of geoms whose distance is measured in a tick."""
    max_rows: int = 24
    """Most pairs of geoms that bound the velocity in a tick."""
    backend: str = "daqp"
    """QP solver."""
    profile: MotionProfile | None = None
    """Velocity and acceleration limits; None for the robot's own profile."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: A setting is out of range.
        """
        for name in ("dt", "gain", "reserve", "lever", "longest_way", "joint_weight", "singular"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise InvalidValueError(name, value, "positive and finite")
        if not (np.isfinite(self.homing) and self.homing >= 0.0):
            raise InvalidValueError("homing", self.homing, "0 or more")
        if self.reserve > 1.0:
            raise InvalidValueError("reserve", self.reserve, "at most 1")
        if self.gain * self.dt > 0.3:
            most = f"at most {0.3 / self.dt:g} at a tick of {self.dt:g} s, or it oscillates"
            raise InvalidValueError("gain", self.gain, most)

    def build(self, arm: Arm) -> "IkStream":
        """A stream for one arm, at rest at its home.

        Raises:
            UnknownNameError: No QP solver is called `backend`.
        """
        return IkStream(self, arm)


class IkStream:
    """The commanded state of one arm and what moves it on. Same targets, same commands."""

    def __init__(self, settings: StreamIk, arm: Arm) -> None:
        """See `StreamIk.build`."""
        self.settings = settings
        self.arm = arm
        profile = arm.robot.profile if settings.profile is None else settings.profile
        self.brakes = JointBrakes(arm.q_min, arm.q_max, profile, settings.dt, settings.margin)
        self._qp = SpeedQp(settings.backend, arm.n)
        self._separation = _separation(settings, arm, self.brakes.a_max)
        self._tool = ToolError(arm)
        self._target = TargetMotion(settings.dt)
        self._units = np.array([1.0, 1.0, 1.0, *[settings.lever] * 3])
        self._columns = np.repeat(self._units[:, None], arm.n, axis=1)
        self._J = np.zeros((6, arm.n))
        self._plain = np.eye(arm.n)
        self._regular = settings.joint_weight * np.eye(arm.n)
        self._v_use, self._a_use = (settings.reserve * b for b in (profile.v_max, profile.a_max))
        self._least = -inf if settings.clearance is None else settings.clearance
        self._home = arm.home.copy()
        self._v_home = 0.1 * profile.v_max
        self._counts: Counter[Event] = Counter()
        self.reset(arm.home)

    @property
    def counts(self) -> dict[Event, int]:
        """How many ticks had to put up with what, since the last reset."""
        return {event: self._counts[event] for event in Event}

    @property
    def q(self) -> Vector:
        """Commanded position now (n,) [rad]."""
        return self._q.copy()

    @property
    def v(self) -> Vector:
        """Commanded velocity now (n,) [rad/s]."""
        return self._v.copy()

    def reset(self, q: ArrayLike, v: ArrayLike | None = None) -> None:
        """Start from a state of the arm, inside its limits or not; at rest where v is None.

        Raises:
            InvalidValueError: q or v is not a finite vector of shape (n,).
        """
        n = self.arm.n
        self._q = checked_vector("q", q, n)
        self._v = np.zeros(n) if v is None else checked_vector("v", v, n)
        self._target.forget()
        self._counts.clear()
        if self._separation is not None:
            self._separation.reset(self._q)

    def tick(self, T_world_target: object) -> StreamTick:
        """Move the command on by one tick, towards where the target is now.

        Args:
            T_world_target: Wanted T_world_tcp (SE3). Anything else brakes the arm.
        """
        events: set[Event] = set()
        target = pose_or_none(T_world_target)
        if target is None:
            events.add(Event.TARGET_REFUSED)
            self._target.forget()
            self._tool.move(self._q)
            errors = (float("nan"), float("nan"))
            H, v_ref = self._plain, np.zeros(self.arm.n)
        else:
            self._tool.aim(target)
            squares = self._tool.move(self._q)
            errors = (sqrt(squares[0]), sqrt(squares[1]))
            H, v_ref = self._wanted(target, events)
        box = self.brakes.box(self._q, self._v)
        if box.recovering:
            events.add(Event.RECOVERING)
        rows, clearance = None, inf
        if self._separation is not None:
            rows = self._separation.rows(self._q, self._v)
            clearance = self._separation.measured
            if clearance < self._least:
                events.add(Event.TOO_CLOSE)
        v_next, told = self._qp.nearest(H, v_ref, box, rows)
        if told is not None:
            events.add(told)
        q_next = self.brakes.moved(self._q, self._v, v_next)
        a = (v_next - self._v) / self.settings.dt
        self._q, self._v = q_next, v_next
        if events:
            self._counts.update(events)
        return StreamTick(
            q=q_next.copy(),
            v=v_next.copy(),
            a=a,
            position_error=errors[0],
            orientation_error=errors[1],
            clearance=clearance,
            rows=0 if rows is None else len(rows.upper),
            events=tuple(e for e in Event if e in events) if events else (),
        )

    def _wanted(self, target: SE3, events: set[Event]) -> tuple[Matrix, Vector]:
        """Weight of joint velocities in the QP (n, n), and the velocity to come close to (n,)."""
        tool, units = self._tool, self._units
        tool.differentiate()
        np.multiply(tool.J, self._columns, out=self._J)
        way = units * tool.e
        way[:3] = shortened(way[:3], self.settings.longest_way)
        inverse = DampedInverse(self._J, self.settings.singular)
        twist, jumped = self._target.twist(target.wxyz_xyz, np.abs(tool.J).dot(self.brakes.v_max))
        if jumped:
            events.add(Event.TARGET_JUMPED)
        X = inverse.velocities(way)
        v_ref = approach_rate(X, self._v_use, self._a_use, self.settings.gain) * X
        v_ref += inverse.velocities(units * twist)
        if self.settings.homing > 0.0:
            home = self.settings.homing * (self._home - self._q)
            np.minimum(home, self._v_home, out=home)
            np.maximum(home, -self._v_home, out=home)
            v_ref += inverse.null(home)
        H = self._J.T @ self._J
        H += self._regular
        return H, v_ref


def _separation(settings: StreamIk, arm: Arm, a_max: Vector) -> Separation | None:
    if settings.clearance is None:
        return None
    return Separation(
        clearance_of(arm, settings.clearance),
        a_max,
        settings.dt,
        d_min=settings.clearance + settings.buffer,
        share=settings.share,
        budget=settings.budget,
        max_rows=settings.max_rows,
    )
