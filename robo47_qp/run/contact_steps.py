"""Steps that seek contact or keep it."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from math import e, inf
from typing import Annotated, ClassVar

import numpy as np
from mink import SE3
from scipy.interpolate import CubicHermiteSpline

from robo47_qp.arrays import Matrix, NotNegative, Positive, Range, Size, Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.gripper import Grip
from robo47_qp.model.payload import Payload
from robo47_qp.motion.planner import Leg
from robo47_qp.motion.trajectory import Trajectory, along, hold
from robo47_qp.motion.waypoint import PRESCRIBED, Waypoint
from robo47_qp.run.compliance import Compliance
from robo47_qp.run.control_loop import ControlLoop
from robo47_qp.run.failure import Cause, Condition, Failure, StepFailed, StepMonitor
from robo47_qp.run.steps import Step, StepExecutor, place_of

_RELIEF = 0.4
"""Time in which an arm that no longer presses comes to rest [s]."""
_TICK_ROWS = 2
"""Control periods between two checks of the world while contact is expected."""

_PRESS_ROWS = 10
"""The same while a stiff tool presses: often enough for an admittance of a few hertz."""

_PACE = 100.0
"""Largest rate at which a path that waits slows down and goes on [1/s]."""
_STOPPING = 0.5
"""Share of the accelerations that it may use for that."""
_BACK = 0.1
"""Time constant by which a tool that presses gets back to its path [s]."""
_SHARE = 0.3
"""Share of the accelerations allowed for the joints that a stiff tool that presses may use."""


@dataclass(frozen=True, kw_only=True)
class Guarded(Step):
    """Move on a straight line until contact, and stop there."""

    waypoint: Waypoint
    """End of the line; its pace and `speed` both limit the tool."""
    force: Positive
    """Change of the contact force on the tool that counts as contact [N]."""
    speed: Positive = 0.02
    """Largest speed of the tool [m/s]."""
    missing: Cause | None = Cause.TIMEOUT
    """Cause of the failure without contact up to the end; None if that is allowed."""
    after: tuple[Condition, ...] = ()
    """Conditions that must hold where it has stopped; else it no longer presses."""
    tool: str | None = None
    """Name of the tool that is to touch something; None is the main one."""

    def __post_init__(self) -> None:
        """Check motion and numbers.

        Raises:
            InvalidValueError: The motion is not LIN, or a number is out of range.
        """
        if not self.waypoint.motion.type.straight:
            raise InvalidValueError("guarded motion", self.waypoint.motion.name, "LIN")
        super().__post_init__()

    @property
    def name(self) -> str:
        """Name of the waypoint."""
        return self.waypoint.name

    @property
    def path(self) -> tuple[Waypoint, ...]:
        """See `Step.path`."""
        return (self.waypoint,)

    def carry_out(self, executor: StepExecutor) -> None:
        """See `Step.carry_out`."""
        loop = executor.loop
        (leg,) = executor.plan([self.waypoint], self.speed)
        loop.set_payload(self.waypoint.carried)
        place = place_of(executor, self.tool)
        before = loop.sim.felt_force(place)

        def touched() -> bool:
            change = loop.sim.felt_force(place) - before
            return float(np.sqrt(change.dot(change))) >= self.force

        loop.begin(self.name, leg)
        if loop.track(leg.trajectory, touched, block=_TICK_ROWS):
            # Contact pushes the tool off its line.
            loop.halt(compliant=True)
            if any(condition.against() is not None for condition in self.after):
                # What follows would begin with a leap of an arm that presses.
                loop.begin("unload", compliant=True)
                executor.compliance.unload_stiff()
                loop.hold(_RELIEF)
        elif self.missing is not None:
            evidence = f"nothing was touched on the way; {self.force:.1f} N were expected"
            raise StepFailed(Failure(cause=self.missing, evidence=evidence, step=self.name))


@dataclass(frozen=True, kw_only=True, eq=False)
class ContactMotion(Step):
    """Move the tool along waypoints while it is in contact, then stay, and watch what happens."""

    waypoints: tuple[Waypoint, ...] = ()
    """LIN and CIRC waypoints; none to stay in place for `seconds`."""
    speed: Annotated[float, Range(above=0.0, infinite=True)] = inf
    """Speed limit along the waypoints, besides their own pace [m/s]."""
    seconds: NotNegative = 0.0
    """Longest time at the last waypoint [s]."""
    until: Condition | None = None
    """Ends the step once it holds. None: the step runs to its end."""
    needed: bool = True
    """Whether the step fails with the cause of `until` if that never holds."""
    during: tuple[Condition, ...] = ()
    """Conditions that must hold all the time: on a violation the arm stops and the step fails."""
    observe: Callable[[], None] | None = None
    """Called every few control periods to observe the world."""
    name: str = "contact"

    def __post_init__(self) -> None:
        """Check waypoints and numbers.

        Raises:
            InvalidValueError: A waypoint is reached by PTP, a number is out of range, or there is
                neither a waypoint nor a time.
        """
        super().__post_init__()
        ptp = [waypoint.name for waypoint in self.waypoints if not waypoint.prescribes_path]
        if ptp:
            raise InvalidValueError("compliant motion", ptp, f"waypoints reached by {PRESCRIBED}")
        if not self.waypoints and self.seconds == 0.0:
            expected = "waypoints, or a time to stay"
            raise InvalidValueError(self.name, "no waypoint and 0 s", expected)

    @property
    def path(self) -> tuple[Waypoint, ...]:
        """See `Step.path`."""
        return self.waypoints

    def _monitor(self) -> StepMonitor:
        return StepMonitor(self.name, self.during, self.until, self.observe, needed=self.needed)

    def _legs(self, executor: StepExecutor) -> list[Leg]:
        return executor.plan(self.waypoints, self.speed) if self.waypoints else []

    def _follow(self, loop: ControlLoop, legs: Sequence[Leg], tracker: "_Tracker") -> None:
        """Track the legs and stay after them, until the tracker has ended."""
        begin = partial(
            loop.begin,
            compliant=tracker.axis is None,
            streamed=tracker.axis is not None,
            axis=tracker.axis,
        )
        for leg in legs:
            begin(leg.waypoint.name, leg)
            if tracker.track(leg.trajectory):
                return
        if self.seconds:
            begin(self.name)
            q = loop.reference.q - tracker.q
            tracker.track(hold(q, round(self.seconds / TIMESTEP), TIMESTEP))


@dataclass(frozen=True, kw_only=True)
class Comply(ContactMotion):
    """Move the compliant tool along waypoints, pressing if the compliance has a force.

    The tool need not end at its last waypoint.
    """

    compliance: Compliance
    carried: Payload | None = None
    """Payload of the tool from now on; None keeps the one that was set before."""
    stay: bool = False
    """True: stay compliant if the next step is a `Comply`; it then starts from the reference of
    this one."""
    renew: bool = False
    """True, after a step that stays compliant: start from the measured pose, with unloaded springs,
    instead of from the reference of that step."""
    name: str = "comply"
    starts_stiff: ClassVar[bool] = False

    def carry_out(self, executor: StepExecutor) -> None:
        """See `Step.carry_out`."""
        loop, monitor = executor.loop, self._monitor()
        try:
            if self.renew:
                executor.compliance.unload()
            legs = self._legs(executor)
            if self.carried is not None:
                loop.set_payload(self.carried)
            executor.compliance.soften(self.compliance)
            self._follow(loop, legs, _Tracker(loop, monitor))
            monitor.judge()
        except StepFailed:
            executor.compliance.stiffen()
            raise
        if not self.stay:
            executor.compliance.stiffen()


@dataclass(frozen=True, kw_only=True, eq=False)
class Press(ContactMotion):
    """Move the stiff tool along waypoints, and press it along an axis by moving it there.

        m δ̈ + d δ̇ = F - f,   |δ⃛| ≤ j

    is the admittance by which the tool leaves its path along the axis by δ, with f the force that
    is felt and F the one that is asked for (Villani and De Schutter, Force control, in: Springer
    Handbook of Robotics, 2nd ed. 2016, ch. 9). Without contact it moves at F / d. Disturbances
    are compensated in contact, too: friction and heavier links, which a compliant arm would pass
    on to the surface, stay in the joints. So the surface, or what is held, has to be softer than
    the arm: with a stiffness k, the damping ratio is d / (2 √(k m)).
    """

    axis: Annotated[Vector, Size(3, unit=True)]
    """Direction to press in, a unit vector in the world (3,)."""
    force: NotNegative
    """F [N]; 0 stays on the path."""
    felt: Callable[[], float]
    """Returns f, as the program estimates it [N]; called every few control periods."""
    mass: Positive = 10.0
    """m [kg]."""
    damping: Positive = 200.0
    """d [N·s/m]."""
    jerk: Positive = 30.0
    """j [m/s³]."""
    pace: Callable[[], float] | None = None
    """Returns the part of its speed at which the tool goes along the waypoints [-], 0 where it
    waits; called every few control periods. None: it always goes at its speed. A tool that has left
    the surface so comes down where it is, and may do so slowly."""
    insists: Callable[[], bool] | None = None
    """Returns whether disturbances are compensated further, not held as they are; called every few
    control periods. An arm that insists against a wall loads itself ever more, and leaps where it
    comes past it. None: it always insists."""
    meanwhile: Grip | None = None
    """What the main gripper does; it is not waited for."""
    name: str = "press"

    def carry_out(self, executor: StepExecutor) -> None:
        """See `Step.carry_out`."""
        loop, yielding = executor.loop, executor.loop.yielding
        monitor, legs = self._monitor(), self._legs(executor)
        loop.compensate(on=True, in_contact=True)
        if self.meanwhile is not None:
            loop.sim.command_grip(self.meanwhile)
        try:
            self._follow(loop, legs, _Depth(self, loop, monitor))
            loop.halt()
        finally:
            loop.compensate(on=not yielding)
        monitor.judge()


class _Tracker:
    """Tracks what a step in contact plans, as it is planned."""

    axis: Vector | None = None
    """See `Phase.axis`."""

    def __init__(self, loop: ControlLoop, monitor: StepMonitor) -> None:
        """Start where the loop is."""
        self._loop, self._monitor = loop, monitor
        self.q: Vector = np.zeros(loop.arm.n)
        """Displacement of the joints from what is planned (n,) [rad]."""

    def track(self, path: Trajectory) -> bool:
        """Track a path; return True if the monitor ended it."""
        if not self._loop.track(path, self._monitor, block=_TICK_ROWS):
            return False
        # A violation stiffens the arm at once: while it presses, it would slide on.
        if self._monitor.error is None:
            self._loop.halt()
        return True


class _Depth(_Tracker):
    """Tracks it with the tool's displacement δ along the axis of a `Press`."""

    def __init__(self, step: Press, loop: ControlLoop, monitor: StepMonitor) -> None:
        """Start at rest on the path."""
        super().__init__(loop, monitor)
        self.axis = step.axis
        self._step, self._arm, self._a_max = step, loop.arm, loop.profile.a_max
        self._depth = self._speed = self._acceleration = 0.0
        self._ways: Matrix | None = None
        """Speeds of the joints for a unit of δ̇, and those that bring the tool back to where it
        should be (2, n)."""

    def track(self, path: Trajectory) -> bool:
        """See `_Tracker.track`."""
        loop, insists = self._loop, self._step.insists
        pace = self._step.pace
        for part in self._parts(path) if pace is None else self._paced(path, pace):
            if insists is not None:
                loop.compensate(on=insists(), in_contact=True)
            if loop.track(self._moved(part, loop.reference.q), self._monitor, block=_PRESS_ROWS):
                return True
        return False

    def _parts(self, path: Trajectory) -> Iterator[Trajectory]:
        for first in range(0, path.steps, _PRESS_ROWS):
            yield path.part(first, min(first + _PRESS_ROWS, path.steps))

    def _paced(self, path: Trajectory, pace: Callable[[], float]) -> Iterator[Trajectory]:
        if path.steps == 0:
            return
        times = np.linspace(0.0, path.duration, path.steps + 1)
        curve, row = CubicHermiteSpline(times, path.q, path.v), (0.0, 1.0, 0.0)
        # A step of the pace by 1 changes it by up to PACE / e in a second.
        fastest = float((np.abs(path.v) / self._a_max).max())
        quick = min(_PACE, _STOPPING * e / max(fastest, 1e-9))
        while row[0] < path.duration:
            goal, rows = pace(), [row]
            for _ in range(_PRESS_ROWS):
                time, rate, change = row
                bend = quick * (quick * (goal - rate) - 2.0 * change)
                time += TIMESTEP * (rate + 0.5 * TIMESTEP * change)
                rate += TIMESTEP * (change + 0.5 * TIMESTEP * bend)
                row = (min(time, path.duration), rate, change + TIMESTEP * bend)
                rows.append(row)
            yield along(curve, np.array(rows), path.dt)

    def _moved(self, part: Trajectory, q_now: Vector) -> Trajectory:
        """Return a part of a path with the displacement, that in q_now (n,) its first."""
        step = self._step
        goal = self._wanted_ways(part.q[0], q_now)
        ways = goal if self._ways is None else self._ways
        # Not at once: the speed of the joints would jump with them.
        turn = (goal - ways) / (part.steps * TIMESTEP)
        asked = step.force - step.felt() if step.force else 0.0
        largest = _SHARE * float((self._a_max / np.maximum(np.abs(goal[0]), 1e-9)).min())
        states = [(self._speed, self._acceleration)]
        for _ in range(part.steps):
            self._advance(asked, largest)
            states.append((self._speed, self._acceleration))
        speed, acceleration = np.array(states).T[:, :, None]
        times = TIMESTEP * np.arange(part.steps + 1.0)[:, None]
        along, back = ways[:, None] + times * turn[:, None]
        v = speed * along + back
        a = acceleration * along + speed * turn[0] + turn[1]
        q = np.empty_like(v)
        q[0] = self.q
        q[1:] = self.q + np.cumsum(0.5 * TIMESTEP * (v[1:] + v[:-1]), axis=0)
        self._ways, self.q = goal, q[-1]
        return Trajectory(dt=part.dt, q=part.q + q, v=part.v + v, a=part.a + a)

    def _wanted_ways(self, q_path: Vector, q: Vector) -> Matrix:
        """Return what `_ways` should be where the path is at q_path (n,), and the tool at q (n,).

        The joints' way along the axis on one part of a path is not quite that on another.
        """
        T, on_path, axis = self._arm.pose(q), self._arm.pose(q_path), self._step.axis
        goal = SE3.from_rotation_and_translation(
            on_path.rotation(), on_path.translation() + self._depth * axis
        )
        along = np.concatenate([T.rotation().as_matrix().T @ axis, np.zeros(3)])
        back = (T.inverse() @ goal).log() / _BACK
        ways: Matrix = np.linalg.lstsq(self._arm.jacobian(q), np.column_stack([along, back]))[0].T
        return ways

    def _advance(self, asked: float, largest: float) -> None:
        """Advance δ by a period, with F - f [N] and the largest acceleration [m/s²]."""
        step, before = self._step, (self._speed, self._acceleration)
        wanted = (asked - step.damping * self._speed) / step.mass if step.force else 0.0
        wanted = min(max(wanted, -largest), largest)
        most = step.jerk * TIMESTEP
        self._acceleration += min(max(wanted - before[1], -most), most)
        self._speed += 0.5 * TIMESTEP * (before[1] + self._acceleration)
        self._depth += 0.5 * TIMESTEP * (before[0] + self._speed)


@dataclass(frozen=True, kw_only=True)
class Unload(Step):
    """Take the arm's position as its reference, so that its springs carry no load.

    Two hands that hold one body stiffly press and pull at it by what their positions lack to fit:
    that goes, and until the hands move it together or one opens, disturbances are compensated no
    further than they were, as hands that insist on their positions would press ever harder. The
    body should stand on something, as its weight would be let go as well.
    """

    seconds: NotNegative = 0.2
    """Time in which the forces fade [s]."""
    name: str = "unload"

    def carry_out(self, executor: StepExecutor) -> None:
        """See `Step.carry_out`."""
        executor.loop.compensate(on=False)
        executor.compliance.unload_stiff()
        executor.loop.begin(self.name, compliant=True)
        executor.loop.hold(self.seconds)
