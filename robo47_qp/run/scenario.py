"""Scenario and Run: what is to be done, and what happened."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from robo47_qp.arrays import Vector
from robo47_qp.control.controller import Controller
from robo47_qp.control.observer import DisturbanceObserver
from robo47_qp.model.obstacle import Obstacle
from robo47_qp.model.robot import Robot
from robo47_qp.motion.planner import Leg, Planner
from robo47_qp.run.failure import Failure
from robo47_qp.run.phase import Phase
from robo47_qp.run.recording import Rows
from robo47_qp.run.task import Task
from robo47_qp.run.watchdog import Watchdog
from robo47_qp.sim.objects import Inertia


@dataclass(frozen=True, kw_only=True, eq=False)
class Scenario:
    """One task under one set of choices."""

    robot: Robot
    task: Task
    planner: Planner
    controller: Controller
    observer: DisturbanceObserver | None = None
    """What estimates the joints' state and what disturbs them; None for neither."""
    seed: int | None = None
    """Seed of the task's random start; None for its default start."""
    watchdog: Watchdog = Watchdog()

    @property
    def time_limit(self) -> float:
        """Simulated time for the arm to do the task in [s]."""
        limit = self.watchdog.time_limit
        return self.task.time_limit if limit is None else limit


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """What happened in a run of a scenario."""

    scenario: Scenario
    rows: Rows
    phases: Sequence[Phase]
    failure: Failure | None
    measures: dict[str, float]
    """The task's figures of the final state, by name with unit."""
    loop_seconds: float
    """Wall time of the control loop with its recording, without planning and observers [s]."""
    objects: Mapping[str, Inertia]
    """Bodies that move freely."""
    begun: Mapping[str, Vector]
    """Their poses and twists as the task put them: position [m], quaternion (w, x, y, z), linear
    and angular velocity [m/s, rad/s] (13,)."""
    fixed: Sequence[Obstacle]
    """What stands fixed around the robot and can be touched, at the end of the run."""
    retaken: Sequence[int] = ()
    """Rows with a reference that does not continue the one before them: it was taken anew from the
    state of the arm, which contact or a policy's torques had moved."""
    failed_steps: int | None = None
    """Steps that failed, which a program may have tried again; None without a program."""
    beyond: Sequence[tuple[float, str]] = ()
    """What a policy's process has done beyond its own, by name, and when that was told [s]."""

    @property
    def legs(self) -> list[Leg]:
        """The motions that were started, in order."""
        return [phase.leg for phase in self.phases if phase.leg is not None]

    def spans(self) -> list[tuple[Phase, slice]]:
        """Return every phase with its rows."""
        starts = [*(phase.start for phase in self.phases), len(self.rows)]
        return [(p, slice(p.start, end)) for p, end in zip(self.phases, starts[1:], strict=True)]
