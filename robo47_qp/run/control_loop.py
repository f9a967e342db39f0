"""ControlLoop: reference, controller, simulation and recording, period by period."""

from collections.abc import Callable, Sequence
from functools import partial
from math import inf
from time import perf_counter

import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.control.active import ActiveController
from robo47_qp.control.compiled import CompiledControl
from robo47_qp.control.controller import Controller
from robo47_qp.control.observer import DisturbanceObserver
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm, JointReference, JointState
from robo47_qp.model.payload import Load, Payload, loads
from robo47_qp.model.robot import MotionProfile
from robo47_qp.motion.planner import Leg
from robo47_qp.motion.timing.stopping import stop
from robo47_qp.motion.trajectory import Trajectory, hold
from robo47_qp.run import signals
from robo47_qp.run.failure import Cause, Failure
from robo47_qp.run.observers import Observer
from robo47_qp.run.phase import Phase
from robo47_qp.run.recording import Recording
from robo47_qp.run.touch_sense import TouchSense
from robo47_qp.sim.compiled import CompiledWorld
from robo47_qp.sim.sensed import Senses
from robo47_qp.sim.signal import Signal
from robo47_qp.sim.simulation import Simulation

TICK_ROWS = 20
"""Control periods between two checks of the world while a motion runs."""

BLOCK_END = 400
"""Rows after which a block ends, too: the size of the recording's chunks is a multiple of it, so
that a run does not depend on that."""

PAYLOAD_RAMP = 0.02
"""Time over which the torque changes with the payload [s]: a step of a heavy load would exceed
the torque rate of the motors."""

SETTLING = 0.3
"""Time after contact in which dry friction is not learned: the disturbance is that of the contact
until the observer has followed [s]."""


class Aborted(Exception):  # noqa: N818  # it is caught by the runner and never shown
    """The run cannot continue."""

    def __init__(self, failure: Failure) -> None:
        super().__init__(failure.evidence)
        self.failure = failure


class ControlLoop:
    """Tracks references with a controller in a simulation; every period fills one row."""

    def __init__(
        self,
        arm: Arm,
        controller: Controller,
        simulation: Simulation,
        *,
        observer: DisturbanceObserver | None = None,
        profile: MotionProfile | None = None,
        check: Callable[["ControlLoop"], None] | None = None,
        extra: Sequence[Signal] = (),
    ) -> None:
        """Start at rest where the world starts, which is home in a simulation.

        Args:
            arm: The controller's model while nothing is held.
            controller: The control law to start with.
            simulation: The world, with the same robot.
            observer: What estimates state and disturbance; None takes the state as measured.
            profile: Limits of the joints' motion when the arm brakes; by default the robot's.
            check: Called every few periods, after a block of rows; may raise `Aborted`.
            extra: Signals that `track` is given besides; see `signals.all_signals`.
        """
        self.arm, self.sim = arm, simulation
        self.senses = Senses(simulation)
        """What programs and policies know of the world, read anew whenever they may look."""
        self.profile = arm.robot.profile if profile is None else profile
        self._load: dict[str, Payload] = {}
        self._payload_factor = simulation.payload_factor
        if observer is not None:
            observer = observer.in_cell(*simulation.joint_data_sheet, TIMESTEP)
        start = simulation.start
        self.control = ActiveController(
            controller, arm, dt=TIMESTEP, observer=observer, start=start
        )
        self.recording = Recording(signals.all_signals(simulation, extra))
        self.observers: tuple[Observer, ...] = ()
        self.phases: list[Phase] = []
        self.retaken: list[int] = []
        """See `Run.retaken`."""
        self.seconds = 0.0
        """Wall time spent in the loop [s]."""
        self._check, self._yielding, self._insisting = check, False, False
        self._together: tuple[int, ...] = ()
        self._touched = -inf
        self._touch = TouchSense(simulation)
        self.untouched = False
        """True while it is known that the tools touch nothing."""
        self._columns = signals.Columns(simulation, extra)
        self._extra = np.zeros((1, self._columns.extra.stop - self._columns.extra.start))
        self.rest(start)

    @property
    def reference(self) -> JointReference:
        """Joint reference of this instant."""
        return self._reference

    def take_over(self, reference: JointReference) -> None:
        """Continue from a reference other than the last one that was tracked."""
        self._reference = reference
        self.retaken.append(len(self.recording))

    def rest(self, q: Vector) -> None:
        """Continue at rest from joint positions q (n,) [rad], which the joints have."""
        still = np.zeros(self.arm.n)
        self.take_over(JointReference(q, still, still))
        self.control.jump(q)

    def state(self) -> JointState:
        """Return the joints' state now: as the controller estimates it, if it does."""
        return self.control.state(self.sim.state())

    def compensate(self, *, on: bool, in_contact: bool = False) -> None:
        """Let the controller compensate disturbances, or hold that while the arm has to yield.

        Args:
            on: Whether it compensates while the tool is free.
            in_contact: Whether it does so in contact, too: for what is softer than the arm. Dry
                friction is then not learned.
        """
        if self._insisting or self._yielding:
            self._touched = self.sim.time
        self._yielding, self._insisting, self._together = not on, in_contact, ()
        self.control.compensate(on, learn=self._learns, touching=in_contact)

    def hold_together(self, tools: Sequence[str]) -> None:
        """Let tools that hold one body compensate what does not press them at each other.

        That lasts until `compensate` is called; see `ClosedChain`.
        """
        places = tuple(self.arm.robot.tool_index(name) for name in tools)
        if places != self._together:
            self.compensate(on=False)
            self._together = places

    @property
    def resting(self) -> bool:
        """True if the reference does not move."""
        return not (self._reference.v.any() or self._reference.a.any())

    def begin(
        self,
        name: str,
        leg: Leg | None = None,
        *,
        compliant: bool = False,
        streamed: bool = False,
        axis: Vector | None = None,
        afresh: bool = True,
    ) -> None:
        """Start a phase; if `afresh` is False and the last one is the same, continue that one.

        The other arguments are those of `Phase`.
        """
        phase = Phase(
            name=name,
            start=len(self.recording),
            leg=leg,
            compliant=compliant,
            streamed=streamed,
            axis=axis,
        )
        if not afresh and self.phases and phase.continues(self.phases[-1]):
            return
        self.phases.append(phase)
        for observer in self.observers:
            observer.phase(self.sim.time, name)
        if leg is not None and self.observers:
            paths = leg.tool_paths(self.arm)
            for observer in self.observers:
                observer.planned(self.sim.time, leg, paths)

    def track(
        self,
        trajectory: Trajectory,
        until: Callable[[], bool] | None = None,
        *,
        block: int = TICK_ROWS,
        extra: Matrix | None = None,
    ) -> bool:
        """Track a trajectory from its first to before its last sample.

        Args:
            trajectory: Starts at the current reference.
            until: Called after every block; True ends the tracking.
            block: Control periods in a block.
            extra: Columns of the extra signals in each period; None keeps the last ones.

        Returns:
            True if `until` ended it, with the reference still in motion.

        Raises:
            Aborted: The run cannot continue, or the torque is not finite.
        """
        references = self._references(trajectory)
        if extra is None:
            extra = np.repeat(self._extra[-1:], trajectory.steps, axis=0)
        else:
            self._extra = extra
        done, ended = 0, False
        while done < trajectory.steps and not ended:
            whole = BLOCK_END - len(self.recording) % BLOCK_END
            count = min(trajectory.steps - done, self.recording.room, whole, block)
            self._advance(trajectory, references, extra, done, count)
            done += count
            self._reference = JointReference(
                trajectory.q[done].copy(), trajectory.v[done].copy(), trajectory.a[done].copy()
            )
            if not self._yielding and self.control.observed is not None:
                touching = self._touch.touching(
                    self.control.arm,
                    count * TIMESTEP,
                    free=not self._insisting,
                    untouched=self.untouched,
                )
                if touching:
                    self._touched = self.sim.time
                self.control.compensate(
                    self._insisting or not touching, learn=self._learns, touching=self._insisting
                )
            self.control.tune(self._reference, count)
            if self._together:
                self.control.close(self._together, self._reference.q)
            for observer in self.observers:
                observer.tick(self.sim)
            if self._check is not None:
                self._check(self)
            if until is not None:
                self.senses.read()
                ended = until()
        if until is None:
            self.senses.read()
        return ended

    def hold(self, seconds: float) -> None:
        """Hold the joint positions of the reference, which is at rest."""
        self.track(self.at_rest(round(seconds / TIMESTEP)))

    def at_rest(self, steps: int) -> Trajectory:
        """Return what holds the joint positions of the reference for some control periods."""
        return hold(self.reference.q, steps, TIMESTEP)

    def halt(self, *, compliant: bool = False) -> None:
        """Bring a moving reference to rest as fast as the profile allows.

        Args:
            compliant: Whether the arm gives way meanwhile, also if it was stiff before.
        """
        if not self.resting:
            braking = stop(self.arm, self.reference, self.profile, TIMESTEP)
            self.begin("stop", compliant=compliant or self.phases[-1].compliant)
            self.track(braking)

    def pause(self) -> None:
        """Let a real arm be held by its robot while nothing is to move, and read all anew."""
        if self.resting and self.sim.stand_by():
            self.senses.read()

    def set_payload(self, load: Load) -> None:
        """Set what the controller assumes the tools to hold; None is nothing in any of them."""
        before, self._load = self._load, loads(self.arm.robot, load)
        if before.keys() != self._load.keys() or any(
            held is not before[name] for name, held in self._load.items()
        ):
            told = loads(self.arm.robot, self._load, self._payload_factor)
            arm = self.arm.with_payload(told) if told else self.arm
            self.control.set_arm(arm, seconds=PAYLOAD_RAMP)

    def carried_weight(self, tool: int) -> float:
        """Return the weight of what the controller assumes a tool to hold [N]."""
        held = self._load.get(self.arm.robot.tools[tool].name)
        return (
            0.0 if held is None else held.mass * float(np.linalg.norm(self.arm.model.opt.gravity))
        )

    def let_go(self, tool: int) -> None:
        """Set that a tool holds nothing; what others hold stays."""
        name = self.arm.robot.tools[tool].name
        self.set_payload({other: it for other, it in self._load.items() if other != name})

    def note(self, text: str, failure: Failure | None = None) -> None:
        """Report an event to the observers, as an error if there is a failure."""
        for observer in self.observers:
            observer.note(self.sim.time, text, "INFO" if failure is None else "ERROR")

    def _advance(
        self, trajectory: Trajectory, references: Matrix, extra: Matrix, first: int, count: int
    ) -> None:
        """Run `count` control periods, one row of the recording each."""
        started = perf_counter()
        sim, control = self.sim, self.control
        sim.look_at_friction()
        rows = self.recording.open_rows(count)
        rows[:, 0] = (len(self.recording) + np.arange(count)) * TIMESTEP
        rows[:, 1] = len(self.phases) - 1
        part = slice(first, first + count)
        rows[:, self._columns.references] = references[part]
        rows[:, self._columns.extra] = extra[part]
        samples = trajectory.q[part], trajectory.v[part], trajectory.a[part]
        world, done = sim.compiled, 0
        try:
            while done < count:
                compiled = control.compiled
                left = JointReference(*(values[done:] for values in samples))
                ahead = 0 if world is None or compiled is None else sim.ahead()
                if world is None or compiled is None or not ahead:
                    self._period(left, rows[done])
                    done += 1
                else:
                    done += self._run(compiled, world, left, rows[done : done + ahead])
        except InvalidValueError as error:
            # Whoever asked for the motion is not to blame for the torque that control makes of it.
            evidence = f"the arm cannot be controlled: {error}".removesuffix(".")
            raise Aborted(Failure(cause=Cause.LIMIT, evidence=evidence)) from error
        finally:
            self.recording.close_rows()
        sim.lately = partial(self._columns.of, rows)
        self.seconds += perf_counter() - started

    def _period(self, references: JointReference, row: Vector) -> None:
        """Run the first of the control periods with references q, v, a (N, n) each."""
        columns, control, sim = self._columns, self.control, self.sim
        sim.write_now(row[columns.now])
        q, v, a = references
        tau = control.torque(JointReference(q[0], v[0], a[0]), sim.state())
        row[columns.command] = control.commanded
        sim.step(tau)
        sim.write_last(row[columns.last])
        count = self.recording.count
        count += 1

    def _run(
        self,
        compiled: CompiledControl,
        world: CompiledWorld,
        references: JointReference,
        rows: Matrix,
    ) -> int:
        """Run some of the periods with references q, v, a (N, n) in the compiled core.

        Returns:
            How many; at least one.
        """
        columns, count = self._columns, self.recording.count
        world.prepare(columns.now.start, columns.last.start)
        periods = min(self.control.enter(compiled, self.sim.state().q), len(rows))
        done, complete = compiled.run(
            world.structure,
            periods,
            self.control.sampled(references),
            rows,
            columns.command.start,
            count,
        )
        self.control.leave(compiled, done)
        self.sim.look()
        if not complete:
            # Either the torque is refused, or something touches what the core does not sum up.
            if not np.isfinite(compiled.last).all():
                self.sim.step(compiled.last)
            self.sim.write_last(rows[done - 1, columns.last])
            count += 1
        return done

    @property
    def yielding(self) -> bool:
        """True while the compensation of disturbances is held; see `compensate`."""
        return self._yielding

    @property
    def _learns(self) -> bool:
        """Whether dry friction may be learned: nothing is touched, and nothing was just before."""
        return not self._insisting and self.sim.time - self._touched >= SETTLING

    def _references(self, trajectory: Trajectory) -> Matrix:
        """Return the columns `signals.references` of every sample."""
        count = len(trajectory.q)
        rows = slice(1 if trajectory.still else count)
        samples = trajectory.q[rows], trajectory.v[rows], trajectory.a[rows]
        columns = signals.reference_rows(self.control.arm, samples)
        return np.broadcast_to(columns, (count, columns.shape[1]))
