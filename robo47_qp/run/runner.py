"""Runner: connects task, planner, control loop and recording in one run."""

from collections.abc import Generator, Sequence
from dataclasses import replace
from math import inf
from typing import Protocol

import numpy as np

from robo47_qp.arrays import Vector
from robo47_qp.errors import (
    ArmStopped,
    InvalidValueError,
    NoGripperError,
    PlanError,
    RecordingError,
    Robo47Error,
    UnknownNameError,
)
from robo47_qp.files import plain
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import Robot
from robo47_qp.motion.planner import Leg
from robo47_qp.run import signals
from robo47_qp.run.control_loop import Aborted, ControlLoop
from robo47_qp.run.failure import Cause, Failure, StepFailed
from robo47_qp.run.foreign_code import Blamed, TaskError
from robo47_qp.run.observers import Observer
from robo47_qp.run.recording import CHUNK_ROWS, Rows, Sink, Store
from robo47_qp.run.scenario import Run, Scenario
from robo47_qp.run.steps import StepExecutor, as_step
from robo47_qp.sim.cell_sheet import CellSheet
from robo47_qp.sim.objects import Inertia
from robo47_qp.sim.sensed import Senses
from robo47_qp.sim.signal import Signal
from robo47_qp.sim.simulation import Simulation

_LAST_HOLD = 0.3
"""Time at rest before the task judges the world [s]."""


class Driver(Protocol):
    """Decides what the arm does in a run: a program, a policy, or the caller."""

    def drive(self, runner: "Runner") -> Failure | None:
        """Move the arm until the run is over; return why it gave up, or None.

        Raises:
            Aborted: The run cannot continue.
            PlanError: The arm is too fast to stop inside its limits.
        """
        ...


class ProgramDriver:
    """Carries out the program of the task."""

    def drive(self, runner: "Runner") -> Failure | None:
        """See `Driver.drive`."""
        failure = None
        try:
            failure = self._run_program(runner)
            runner.acting = False
            runner.executor.compliance.stiffen()
        except PlanError as error:
            raise Aborted(failure or _unstoppable(error)) from error
        return failure

    def _run_program(self, runner: "Runner") -> Failure | None:
        loop, task = runner.loop, runner.scenario.task
        program = task.program(loop.senses.read())
        if not isinstance(program, Generator):
            raise TaskError(f"The program of {task.name} must yield its steps; found {program!r}.")
        failed: Robo47Error | None = None
        runner.failed = []
        try:
            runner.executor.go_home()
            while True:
                with Blamed(type(task), passed=(StopIteration, StepFailed, PlanError)):
                    step = next(program) if failed is None else program.throw(failed)
                failed = None
                try:
                    runner.executor.perform(as_step(step))
                except (InvalidValueError, UnknownNameError) as error:
                    failed = error
                except StepFailed as error:
                    failed = StepFailed(replace(error.failure, time=loop.sim.time))
                    runner.failed.append(failed.failure)
                    loop.note(f"step failed: {failed}", failed.failure)
        except StopIteration as end:
            return _told(f"What the program of {task.name} returns", end.value)
        except StepFailed as error:
            return error.failure


class Runner:
    """Runs a scenario once: a driver moves the arm, then the task judges the world."""

    def __init__(
        self,
        scenario: Scenario,
        simulation: Simulation,
        driver: Driver | None = None,
        *,
        extra: Sequence[Signal] = (),
    ) -> None:
        """Reset the world to the start of the scenario.

        Args:
            scenario: What to run.
            simulation: The world, built from the scenario's robot and task.
            driver: What moves the arm; by default the task's program.
            extra: Signals that the driver adds to the recording; see `signals.all_signals`.
        """
        self.scenario = scenario
        self._driver = ProgramDriver() if driver is None else driver
        self._sim, planner = simulation, scenario.planner
        arm = Arm(scenario.robot, obstacles=scenario.task.obstacles)
        self.loop = ControlLoop(
            arm,
            scenario.controller,
            simulation,
            observer=scenario.observer,
            profile=planner.unplanned(arm),
            check=self._check,
            extra=extra,
        )
        self.loop.senses = Senses(simulation, _sheet(scenario, simulation), scenario.task.as_seen)
        self.executor = StepExecutor(self.loop, planner)
        self.acting = True
        """Whether time counts: until the driver has nothing more to do but to come to rest."""
        self.failed: list[Failure] | None = None
        """How steps of the program failed so far; None where no program moves the arm."""
        self.beyond: Sequence[tuple[float, str]] = ()
        """See `Run.beyond`."""
        self.signals = self.loop.recording.signals
        simulation.reset()
        seed = scenario.seed
        scenario.task.reset(simulation, None if seed is None else np.random.default_rng(seed))
        self._begun = {name: _state(simulation, name) for name in simulation.objects}
        self.loop.senses.read()

    def rehearse(self) -> list[Leg]:
        """Plan the task's preview without moving, and return its legs.

        Raises:
            PlanError: A waypoint cannot be reached.
            NoGripperError: A step needs a gripper and the robot has none.
        """
        legs, robot = self.executor.way_home(), self.scenario.robot
        q = legs[-1].trajectory.end.q if legs else self.loop.reference.q
        for step in map(as_step, self.scenario.task.preview(self.loop.senses.read())):
            grips = [w.name for w in step.path if w.grip is not None]
            if robot.gripper is None and (grips or step.grips):
                raise NoGripperError(robot.name, f"waypoint {[*grips, step.name][0]!r}")
            if step.path:
                legs += self.executor.rehearse(step.path, q)
                q = legs[-1].trajectory.end.q
        return legs

    def run(
        self,
        sinks: Sequence[Sink] = (),
        observers: Sequence[Observer] = (),
        *,
        store: Store | None = None,
        chunk_rows: int = CHUNK_ROWS,
    ) -> Run:
        """Run to the end; call it once.

        Args:
            sinks: Get the rows, also those of a run that is interrupted.
            observers: Get the events.
            store: Keeps the rows, by default in memory.
            chunk_rows: Rows that the sinks get at once.

        Raises:
            RecordingError: A sink or the store could not write the recording.
            TaskError: Code of the task raised something.
        """
        self.record(sinks, observers, store=store, chunk_rows=chunk_rows)
        try:
            with Blamed(type(self.scenario.task)):
                failure = self.finish()
        except (KeyboardInterrupt, TaskError):
            self._sim.stand_by()
            self.loop.recording.flush()
            raise
        except Robo47Error as error:
            self._sim.stand_by()
            if not isinstance(error, RecordingError):
                self.loop.recording.flush()
            raise
        return self.ended(failure)

    def record(
        self,
        sinks: Sequence[Sink] = (),
        observers: Sequence[Observer] = (),
        *,
        store: Store | None = None,
        chunk_rows: int = CHUNK_ROWS,
    ) -> None:
        """Say what gets the rows and events, as in `run`, before anything has moved."""
        recording = self.loop.recording
        recording.sinks = (_Derive(self.scenario.robot), *sinks)
        recording.chunk_rows = chunk_rows
        if store is not None:
            recording.store = store
        self.loop.observers = tuple(observers)

    def ended(self, failure: Failure | None) -> Run:
        """Return what happened, and how it ended: with a failure, or None; call it once.

        Raises:
            RecordingError, TaskError: See `run`.
        """
        loop, task = self.loop, self.scenario.task
        if failure is not None:
            failure = self._with_earlier(failure)
        loop.note(
            f"failed ({failure.cause.value}): {failure.evidence}" if failure else "success", failure
        )
        loop.recording.flush()
        with Blamed(type(task)):
            measures = task.measures(self._sim)
        # It would keep the rows, see `hand_over`.
        self._sim.lately = None
        return Run(
            scenario=self.scenario,
            rows=loop.recording.hand_over(),
            phases=loop.phases,
            failure=failure,
            measures=measures,
            loop_seconds=loop.seconds,
            objects={name: Inertia.of(self._sim.model, name) for name in self._sim.objects},
            begun=self._begun,
            fixed=self._sim.fixed(),
            retaken=loop.retaken,
            failed_steps=None if self.failed is None else len(self.failed),
            beyond=self.beyond,
        )

    def finish(self) -> Failure | None:
        """Let the driver finish, come to rest and judge the world; call it once."""
        loop, failure = self.loop, None
        try:
            failure = self._driver.drive(self)
            loop.note(f"gave up: {failure.evidence}" if failure else "program done", failure)
            self._rest(failure)
            loop.begin("end")
            loop.hold(_LAST_HOLD)
            loop.pause()
        except (Aborted, ArmStopped) as stopped:
            failure = replace(self._why(stopped), time=self._sim.time)
            loop.note(f"stopped: {failure.evidence}", failure)
        task = self.scenario.task
        return failure or _told(f"The verdict of {task.name}", task.verdict(self._sim))

    def _with_earlier(self, failure: Failure) -> Failure:
        """Return a failure with its time, and with the steps that had failed before in words."""
        earlier = ", ".join(
            f"{one.step} ({one.cause.value}) at {one.time:.1f} s"
            for one in self.failed or ()
            if one is not failure
        )
        evidence = f"{failure.evidence}; failed before: {earlier}" if earlier else failure.evidence
        time = self._sim.time if failure.time is None else failure.time
        return replace(failure, evidence=evidence, time=time)

    def _why(self, stopped: Aborted | ArmStopped) -> Failure:
        """Return the failure of a run that was stopped; an arm that still moves is stopped, too."""
        if isinstance(stopped, ArmStopped):
            evidence = f"{stopped.names}: {stopped}" if stopped.names else str(stopped)
            return Failure(cause=Cause.ARM, evidence=evidence)
        self._sim.stand_by()
        return stopped.failure

    def _rest(self, failure: Failure | None) -> None:
        try:
            self.loop.halt()
        except PlanError as error:
            raise Aborted(failure or _unstoppable(error)) from error

    def _check(self, loop: ControlLoop) -> None:
        """Call the task's monitor, and abort the run if the watchdog finds a failure."""
        scenario = self.scenario
        scenario.task.monitor(loop.sim)
        failure = scenario.watchdog.check(
            loop.sim,
            loop.arm,
            loop.reference,
            stiff=not loop.phases[-1].compliant,
            force_max=scenario.task.force_max,
            fixed_force_max=scenario.task.fixed_force_max,
            time_limit=scenario.time_limit if self.acting else inf,
        )
        if failure is not None:
            raise Aborted(failure)


def _told(what: str, failure: object) -> Failure | None:
    """Return what a task tells of its end.

    Raises:
        TaskError: It is no failure and not None.
    """
    if failure is None or isinstance(failure, Failure):
        return failure
    raise TaskError(f"{what} must be a Failure, or None for a success; found {failure!r}.")


def _state(simulation: Simulation, name: str) -> Vector:
    """Return an entry of `Run.begun`."""
    pose = simulation.object_pose(name)
    return np.concatenate([pose.translation(), pose.rotation().wxyz, simulation.object_twist(name)])


def _unstoppable(error: PlanError) -> Failure:
    return Failure(cause=Cause.LIMIT, evidence=f"the arm cannot stop: {error.explanation}")


def _sheet(scenario: Scenario, simulation: Simulation) -> CellSheet:
    return CellSheet(
        task=plain(scenario.task),
        obstacles=[plain(obstacle) for obstacle in scenario.task.obstacles],
        noise=simulation.noise_figures,
        time_limit=scenario.time_limit,
        acceleration=_acceleration(scenario),
    )


def _acceleration(scenario: Scenario) -> float:
    """Return the sum of what the joints give the tool that is given most, at home [m/s²]."""
    arm, a_max = Arm(scenario.robot), scenario.planner.profile.a_max
    tools = range(len(scenario.robot.tools))
    levers = [np.linalg.norm(arm.jacobian(arm.home, tool)[:3], axis=0) for tool in tools]
    return max(float(lever @ a_max) for lever in levers)


class _Derive:
    """Fills the derived columns for the sinks after it: per chunk at a tenth of the cost."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot

    def write(self, rows: Rows) -> None:
        signals.derive(rows, self._robot)
