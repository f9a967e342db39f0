"""ControlLoop: reference, controller, simulation and recording, period by period."""

from collections.abc import Callable, Sequence
from time import perf_counter

import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.constants import TIMESTEP
from robo47_qp.control.active import ActiveController
from robo47_qp.model.arm import MARGIN, Arm, JointReference
from robo47_qp.model.payload import Payload
from robo47_qp.model.robot import Robot
from robo47_qp.motion.planner import Leg
from robo47_qp.motion.timing.stopping import stop
from robo47_qp.motion.trajectory import Trajectory, hold
from robo47_qp.run import signals
from robo47_qp.run.failure import Failure
from robo47_qp.run.observers import Observer
from robo47_qp.run.recording import Recording, Signal, slices
from robo47_qp.run.scenario import Phase, Scenario
from robo47_qp.sim.simulation import Simulation

TICK_ROWS = 20
"""Control periods between two looks at the world while a motion runs."""

LOAD_CHANGES = 0.02
"""How long the torque takes to change with what the tool holds [s]: at once, a heavy load would
ask for more than the motors' rate."""


class Aborted(Exception):  # noqa: N818  # it is caught by the runner and never shown
    """The watch ended the run."""

    def __init__(self, failure: Failure) -> None:
        super().__init__(failure.evidence)
        self.failure = failure


class ControlLoop:
    """Moves one scenario on in time; every period fills one row of the recording."""

    def __init__(self, scenario: Scenario, simulation: Simulation, recording: Recording) -> None:
        """Stand still where the simulation is."""
        self.scenario, self.sim = scenario, simulation
        self.arm = Arm(scenario.robot, obstacles=scenario.task.obstacles)
        """The belief while nothing is held."""
        inner = Arm(scenario.robot, obstacles=scenario.task.obstacles, margin=MARGIN)
        self._inner = self.arm if inner.limit_margin(inner.home) < 0.0 else inner
        self.control = ActiveController(scenario.controller, self.arm, dt=TIMESTEP)
        self.recording = recording
        self.observers: tuple[Observer, ...] = ()
        self.phases: list[Phase] = []
        self.seconds = 0.0
        """Wall time spent in the loop [s]."""
        self._columns = _Columns(scenario.robot, simulation.objects)
        self.rest(np.array(scenario.robot.home))

    def rest(self, q: Vector) -> None:
        """Take q, at rest, as the reference from now on."""
        still = np.zeros(self.arm.n)
        self.reference = JointReference(q, still, still)
        """What the joints should do at this instant."""

    def planning_arm(self, q: Vector) -> Arm:
        """The belief that motions from q are planned with, its limits drawn in.

        Where q itself or home is beyond those, it is the one with the whole range.
        """
        return self.arm if self._inner.limit_margin(q) < 0.0 else self._inner

    @property
    def resting(self) -> bool:
        """True where the reference does not move."""
        return not (self.reference.v.any() or self.reference.a.any())

    def begin(
        self,
        name: str,
        leg: Leg | None = None,
        *,
        compliant: bool = False,
        streamed: bool = False,
        afresh: bool = True,
    ) -> None:
        """Start a phase; with `afresh` False go on with the last one, if it has this name."""
        if not afresh and self.phases and self.phases[-1].name == name:
            return
        start = len(self.recording)
        self.phases.append(
            Phase(name=name, start=start, leg=leg, compliant=compliant, streamed=streamed)
        )
        for observer in self.observers:
            observer.phase(self.sim.time, name)
        if leg is not None and self.observers:
            path = np.array([self.arm.pose(q).translation() for q in leg.trajectory.q])
            for observer in self.observers:
                observer.planned(self.sim.time, leg, path)

    def track(
        self,
        trajectory: Trajectory,
        until: Callable[[], bool] | None = None,
        *,
        block: int = TICK_ROWS,
    ) -> bool:
        """Track a trajectory from its first to before its last sample.

        Args:
            trajectory: Starts with the reference of now.
            until: Looked at after every block; ends the tracking where it is True.
            block: Control periods in a block.

        Returns:
            True where `until` ended it, with the reference still in motion.

        Raises:
            Aborted: The watch saw something that ends the run.
        """
        references = self._references(trajectory)
        done, ended = 0, False
        while done < trajectory.steps and not ended:
            count = min(trajectory.steps - done, self.recording.room, block)
            self._advance(trajectory, references, done, count)
            done += count
            self.reference = JointReference(
                trajectory.q[done].copy(), trajectory.v[done].copy(), trajectory.a[done].copy()
            )
            for observer in self.observers:
                observer.tick(self.sim)
            self.scenario.task.monitor(self.sim)
            self._look()
            ended = until is not None and until()
        return ended

    def hold(self, seconds: float) -> None:
        """Stay at the reference, which rests."""
        self.track(hold(self.reference.q, round(seconds / TIMESTEP), TIMESTEP))

    def halt(self) -> None:
        """Bring a moving reference to rest, as fast as the profile allows."""
        if not self.resting:
            planner = self.scenario.planner
            profile = planner.profile.slowed(planner.pace)
            way = stop(self.arm, self.reference, profile, TIMESTEP)
            self.begin("stop", compliant=self.phases[-1].compliant)
            self.track(way)

    def believe(self, payload: Payload | None) -> None:
        """Take something to be held by the tool, or nothing."""
        if payload is not self.control.arm.payload:
            arm = self.arm if payload is None else self.arm.carrying(payload)
            self.control.believe(arm, seconds=LOAD_CHANGES)

    def note(self, text: str, failure: Failure | None = None) -> None:
        """Tell the observers."""
        for observer in self.observers:
            observer.note(self.sim.time, text, "INFO" if failure is None else "ERROR")

    def _look(self) -> None:
        stiff = not self.phases[-1].compliant
        seen = self.scenario.watchdog.seen(
            self.sim,
            self.arm,
            self.reference,
            stiff=stiff,
            force_max=self.scenario.task.force_max,
        )
        if seen is not None:
            raise Aborted(seen)

    def _advance(self, trajectory: Trajectory, references: Matrix, first: int, count: int) -> None:
        """The control loop: `count` periods, one row of the recording each."""
        started = perf_counter()
        sim, control = self.sim, self.control
        now, command, last = self._columns.now, self._columns.command, self._columns.last
        rows = self.recording.open_rows(count)
        rows[:, 0] = (len(self.recording) + np.arange(count)) * TIMESTEP
        rows[:, 1] = len(self.phases) - 1
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
        self.recording.close_rows(count)
        self.seconds += perf_counter() - started

    def _references(self, trajectory: Trajectory) -> Matrix:
        """Columns `signals.reference` for every sample."""
        arm = self.control.arm
        if trajectory.still and trajectory.steps:
            return np.repeat(self._references(trajectory.part(0, 0)), trajectory.steps + 1, axis=0)
        samples = zip(trajectory.q, trajectory.v, trajectory.a, strict=True)
        tau = np.array([arm.inverse_dynamics(q, v, a) for q, v, a in samples])
        poses = np.array([arm.pose(q).wxyz_xyz for q in trajectory.q])
        return np.hstack(
            [trajectory.q, trajectory.v, trajectory.a, tau, poses[:, 4:], poses[:, :4]]
        )


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
