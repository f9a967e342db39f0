"""Runner: the one place that sees the whole path from task to recording."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from robo47_qp.errors import NoGripperError
from robo47_qp.motion.planner import Leg
from robo47_qp.motion.waypoint import Waypoint
from robo47_qp.run import signals
from robo47_qp.run.conditions import plan_through
from robo47_qp.run.control_loop import Aborted, ControlLoop
from robo47_qp.run.failure import Failure, StepFailed
from robo47_qp.run.observers import Observer
from robo47_qp.run.recording import Recording, Rows, Sink
from robo47_qp.run.scenario import Run, Scenario
from robo47_qp.run.step_executor import StepExecutor
from robo47_qp.run.steps import (
    Comply,
    Grasp,
    Guarded,
    Move,
    Release,
    StepLike,
)
from robo47_qp.sim.simulation import Simulation

_LAST_HOLD = 0.3
"""Time at rest before the end is judged [s]."""


class Runner:
    """Runs a scenario, once."""

    def __init__(self, scenario: Scenario, simulation: Simulation) -> None:
        """Put the world at the start of the scenario.

        Args:
            scenario: What to run.
            simulation: The world, built from the scenario's robot and task.
        """
        self.scenario = scenario
        self.signals = signals.all_signals(scenario.robot, simulation.objects)
        self._sim = simulation
        self._loop = ControlLoop(scenario, simulation, Recording(self.signals))
        simulation.reset()
        seed = scenario.seed
        scenario.task.reset(simulation, None if seed is None else np.random.default_rng(seed))

    def rehearse(self) -> list[Leg]:
        """Plan the way through the waypoints that the task foresees; nothing moves.

        Raises:
            PlanError: One of them cannot be reached.
            NoGripperError: One of them asks for a grip and the robot has no gripper.
        """
        legs: list[Leg] = []
        q, robot = self._loop.reference.q, self.scenario.robot
        for step in self.scenario.task.preview(self._sim):
            waypoints = tuple(_waypoints(step))
            grips = [w.name for w in waypoints if w.grip is not None]
            if isinstance(step, Grasp | Release):
                grips.append(step.name)
            if robot.gripper is None and grips:
                raise NoGripperError(robot.name, f"waypoint {grips[0]!r}")
            if waypoints:
                legs += plan_through(
                    self.scenario.planner, self._loop.planning_arm(q), waypoints, q
                )
                q = legs[-1].trajectory.end.q
        return legs

    def run(self, sinks: Sequence[Sink] = (), observers: Sequence[Observer] = ()) -> Run:
        """Carry out the task, from the start of the scenario; call it once.

        Args:
            sinks: Who gets the rows of the recording.
            observers: Who looks on.

        Raises:
            RecordingError: A sink could not keep the recording.
        """
        gripper = self.scenario.robot.gripper
        derive = _Derive(() if gripper is None else gripper.fingers)
        loop, task = self._loop, self.scenario.task
        loop.recording = Recording(self.signals, sinks=(derive, *sinks))
        loop.observers = tuple(observers)
        failure = self._carried_out()
        failure = failure or task.verdict(self._sim)
        if failure is not None and failure.time is None:
            failure = replace(failure, time=self._sim.time)
        loop.note(
            f"failed ({failure.cause.value}): {failure.evidence}" if failure else "success", failure
        )
        loop.recording.flush()
        return Run(
            scenario=self.scenario,
            rows=loop.recording.rows(),
            phases=loop.phases,
            failure=failure,
            measures=task.measures(self._sim),
            loop_seconds=loop.seconds,
            objects=self._sim.objects,
        )

    def _carried_out(self) -> Failure | None:
        """Run the program, come to rest, and tell why it gave up, if so."""
        loop = self._loop
        try:
            executor = StepExecutor(loop)
            failure = self._programmed(executor)
            executor.finish()
            loop.note(f"gave up: {failure.evidence}" if failure else "program done", failure)
            loop.halt()
            loop.begin("end")
            loop.hold(_LAST_HOLD)
        except Aborted as aborted:
            failure = replace(aborted.failure, time=self._sim.time)
            loop.note(f"stopped: {failure.evidence}", failure)
        return failure

    def _programmed(self, executor: StepExecutor) -> Failure | None:
        program = self.scenario.task.program(self._sim)
        failed: StepFailed | None = None
        try:
            while True:
                step = next(program) if failed is None else program.throw(failed)
                failed = None
                try:
                    executor.perform(step)
                except StepFailed as error:
                    failed = StepFailed(replace(error.failure, time=self._sim.time))
                    self._loop.note(f"step failed: {failed}", failed.failure)
        except StopIteration as end:
            failure: Failure | None = end.value
            return failure
        except StepFailed as error:
            return error.failure


def _waypoints(step: StepLike) -> Iterator[Waypoint]:
    """The waypoints that a step visits, as far as they are known."""
    match step:
        case Waypoint():
            yield step
        case tuple():
            yield from step
        case Move() | Comply():
            yield from step.waypoints
        case Guarded():
            yield step.waypoint
        case _:
            pass


class _Derive:
    """Sink that completes the rows for those after it; in chunks it costs a tenth."""

    def __init__(self, fingers: Sequence[str]) -> None:
        self._fingers = fingers

    def write(self, rows: Rows) -> None:
        signals.derive(rows, self._fingers)
