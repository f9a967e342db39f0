"""Runner: the one place that sees the whole path from task to recording."""

from collections.abc import Sequence
from time import perf_counter

import numpy as np

from robo47_qp import signals
from robo47_qp.arm import Arm, JointReference
from robo47_qp.arrays import Matrix, Vector
from robo47_qp.controllers.active import ActiveController
from robo47_qp.errors import NoGripperError, PlanError
from robo47_qp.motion.planner import Leg
from robo47_qp.motion.trajectory import Trajectory, hold
from robo47_qp.observer import Observer
from robo47_qp.recording import Recording, Rows, Signal, Sink, slices
from robo47_qp.robot import Robot
from robo47_qp.run import Phase, Run, Scenario
from robo47_qp.scene import TIMESTEP
from robo47_qp.simulation import Simulation
from robo47_qp.task import Cause, Failure, Step
from robo47_qp.waypoint import Grip, Payload

TICK_ROWS = 20
"""Control periods between two looks of the observers."""
_GRIP_STILL = 0.05
"""How long the fingers must stand still for a grip to count as done [s]."""
_GRIP_TIMEOUT = 3.0
"""When a grip is over whether or not the fingers stand still [s]."""
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
        self._arm = Arm(scenario.robot)
        self._control = ActiveController(scenario.controller, self._arm, dt=TIMESTEP)
        self._columns = _Columns(scenario.robot, simulation.objects)
        self._recording = Recording(self.signals)
        self._observers: tuple[Observer, ...] = ()
        self._phases: list[Phase] = []
        self._reference = np.array(scenario.robot.home)
        self._loop_seconds = 0.0
        simulation.reset()
        seed = scenario.seed
        scenario.task.reset(simulation, None if seed is None else np.random.default_rng(seed))

    def rehearse(self) -> list[Leg]:
        """Plan the way through the waypoints that the task foresees; nothing moves.

        Raises:
            PlanError: One of them cannot be reached.
            NoGripperError: One of them asks for a grip and the robot has no gripper.
        """
        legs, q = [], self._reference
        robot = self.scenario.robot
        for step in self.scenario.task.outlook(self._sim):
            for waypoint in step if isinstance(step, tuple) else (step,):
                if waypoint.grip is not None and robot.gripper is None:
                    raise NoGripperError(robot.name, f"waypoint {waypoint.name!r}")
            legs += self._planned(step, q)
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
        self._recording = Recording(self.signals, sinks=(derive, *sinks))
        self._observers = tuple(observers)
        task = self.scenario.task
        failure = self._carry_out()
        self._note(f"gave up: {failure.evidence}" if failure else "program done", failure)
        self._hold("end", _LAST_HOLD)
        failure = failure or task.verdict(self._sim)
        self._note(
            f"failed ({failure.cause.value}): {failure.evidence}" if failure else "success", failure
        )
        self._recording.flush()
        return Run(
            scenario=self.scenario,
            rows=self._recording.rows(),
            phases=self._phases,
            failure=failure,
            measures=task.measures(self._sim),
            loop_seconds=self._loop_seconds,
            objects=self._sim.objects,
        )

    def _carry_out(self) -> Failure | None:
        program = self.scenario.task.program(self._sim)
        try:
            while True:
                for leg in self._planned(next(program), self._reference):
                    waypoint = leg.waypoint
                    self._believe(waypoint.carried)
                    if leg.trajectory.steps:
                        self._follow(waypoint.name, leg.trajectory, leg)
                    if waypoint.grip is not None:
                        self._take_grip(waypoint.grip)
        except StopIteration as end:
            failure: Failure | None = end.value
            return failure
        except PlanError as error:
            return Failure(cause=Cause.PLAN, evidence=str(error))

    def _planned(self, step: Step, q_start: Vector) -> list[Leg]:
        planner = self.scenario.planner
        if isinstance(step, tuple):
            return planner.plan_chain(self._arm, step, q_start, TIMESTEP)
        return [planner.plan(self._arm, step, q_start, TIMESTEP)]

    def _believe(self, payload: Payload | None) -> None:
        if payload is not self._control.arm.payload:
            arm = self._arm if payload is None else self._arm.carrying(payload)
            # What the tool holds changes in an instant, and so does the torque for it.
            self._control.believe(arm, seconds=0.0)

    def _take_grip(self, grip: Grip) -> None:
        opening = grip.width > self._sim.width()
        if opening:
            self._believe(None)
        self._sim.command_grip(grip)
        name = "open gripper" if opening else "close gripper"
        still, waited = 0.0, 0.0
        while still < _GRIP_STILL and waited < _GRIP_TIMEOUT:
            self._hold(name, TICK_ROWS * TIMESTEP)
            waited += TICK_ROWS * TIMESTEP
            still = still + TICK_ROWS * TIMESTEP if self._sim.grip_settled() else 0.0
        force = self._sim.last_finger_forces()
        self._note(
            f"{name}: {1e3 * self._sim.width():.1f} mm, fingers {force[0]:.1f} N, {force[1]:.1f} N"
        )

    def _hold(self, name: str, seconds: float) -> None:
        self._follow(name, hold(self._reference, round(seconds / TIMESTEP), TIMESTEP), None)

    def _follow(self, name: str, trajectory: Trajectory, leg: Leg | None) -> None:
        """Track a trajectory from its first to before its last sample."""
        if not self._phases or leg is not None or self._phases[-1].name != name:
            self._phases.append(Phase(name=name, start=len(self._recording), leg=leg))
            for observer in self._observers:
                observer.phase(self._sim.time, name)
        references = self._references(trajectory)
        if leg is not None:
            for observer in self._observers:
                observer.planned(self._sim.time, leg, references[:, self._columns.tool_position])
        done = 0
        while done < trajectory.steps:
            count = min(trajectory.steps - done, self._recording.room, TICK_ROWS)
            self._advance(trajectory, references, done, count)
            done += count
            for observer in self._observers:
                observer.tick(self._sim)
        self._reference = trajectory.end.q

    def _advance(self, trajectory: Trajectory, references: Matrix, first: int, count: int) -> None:
        """The control loop: `count` periods, one row of the recording each."""
        started = perf_counter()
        sim, control = self._sim, self._control
        now, command, last = self._columns.now, self._columns.command, self._columns.last
        rows = self._recording.open_rows(count)
        rows[:, 0] = (len(self._recording) + np.arange(count)) * TIMESTEP
        rows[:, 1] = len(self._phases) - 1
        rows[:, self._columns.reference] = references[first : first + count]
        for row, q, v, a in zip(
            rows,
            trajectory.q[first : first + count],
            trajectory.v[first : first + count],
            trajectory.a[first : first + count],
            strict=True,
        ):
            sim.write_now(row[now])
            tau = control.torque(JointReference(q, v, a), sim.state())
            row[command] = control.asked
            sim.step(tau)
            sim.write_last(row[last])
        self._recording.close_rows(count)
        self._loop_seconds += perf_counter() - started

    def _references(self, trajectory: Trajectory) -> Matrix:
        """Columns `signals.reference` for every sample."""
        arm = self._control.arm
        samples = zip(trajectory.q, trajectory.v, trajectory.a, strict=True)
        tau = np.array([arm.inverse_dynamics(q, v, a) for q, v, a in samples])
        poses = np.array([arm.pose(q).wxyz_xyz for q in trajectory.q])
        return np.hstack(
            [trajectory.q, trajectory.v, trajectory.a, tau, poses[:, 4:], poses[:, :4]]
        )

    def _note(self, text: str, failure: Failure | None = None) -> None:
        for observer in self._observers:
            observer.note(self._sim.time, text, "INFO" if failure is None else "ERROR")


class _Derive:
    """Sink that completes the rows for those after it; in chunks it costs a tenth."""

    def __init__(self, fingers: Sequence[str]) -> None:
        self._fingers = fingers

    def write(self, rows: Rows) -> None:
        signals.derive(rows, self._fingers)


class _Columns:
    """Where groups of signals stand in a row."""

    def __init__(self, robot: Robot, objects: Sequence[str]) -> None:
        found = slices(signals.all_signals(robot, objects))

        def span(group: Sequence[Signal]) -> slice:
            return slice(found[group[0].name].start, found[group[-1].name].stop)

        self.reference = span(signals.reference(robot))
        self.now = span(signals.now(robot, objects))
        self.command = span(signals.command(robot))
        self.last = span(signals.last(robot))
        n = len(robot.joints)
        self.tool_position = slice(4 * n, 4 * n + 3)
