"""Drivers of a run in place of the task's program: a policy, or one action at a time."""

from dataclasses import dataclass
from typing import Annotated

from robo47_qp.arrays import Checked, Positive, Range
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import InvalidValueError, PlanError
from robo47_qp.run.control_loop import Aborted, ControlLoop
from robo47_qp.run.failure import Cause, Failure
from robo47_qp.run.foreign_code import Guard
from robo47_qp.run.policy.cell import PolicyCell
from robo47_qp.run.policy.policy import Action, Observation, Policy
from robo47_qp.run.runner import Runner
from robo47_qp.run.scenario import Scenario
from robo47_qp.run.task import Task
from robo47_qp.sim.simulation import Simulation


@dataclass(frozen=True, kw_only=True)
class PolicyTiming(Checked):
    """How often a policy decides, and for how long."""

    rate: Annotated[float, Range(above=0.0, at_most=1.0 / TIMESTEP)] = 30.0
    """Decisions per second, at most one in every control period [1/s]."""
    seconds: Positive = 30.0
    """Simulated time of an episode, if the policy does not end it before [s]."""

    def decision(self, k: int) -> int:
        """Control period at which decision k (from 0) is due; at most that of the end."""
        return min(round(k / (self.rate * TIMESTEP)), round(self.seconds / TIMESTEP))


def check_judged(task: Task, simulation: Simulation) -> None:
    """Check that a task is to be done: not all is well at its start, where this puts the world.

    Raises:
        InvalidValueError: The verdict is success before anything has moved. What counts may be a
            condition of the task's own program: `Task.monitor` is where to judge it for everybody.
    """
    simulation.reset()
    task.reset(simulation, None)
    if task.verdict(simulation) is None:
        expected = "one whose verdict is no success before anything has moved"
        raise InvalidValueError("task", repr(task.name), expected)


class PolicyDriver:
    """Lets a policy move the arm. What comes of it is a run like any other.

    The episode ends when the policy says so, when its time is over, when the policy does what no
    policy may (it raises, or its answer is not a valid action), or when the watchdog ends it. Then
    the arm comes to rest, and the task's own verdict judges the world: what the task asks for at
    the end, an arm at home or an open gripper, it asks of a policy, too.
    """

    def __init__(self, policy: Policy, timing: PolicyTiming | None = None) -> None:
        """Keep what decides.

        Args:
            policy: Chooses the actions; the scenario's planner gives the limits of all motions.
            timing: How often and for how long; by default `PolicyTiming()`.
        """
        self._policy, self._timing = policy, PolicyTiming() if timing is None else timing

    def drive(self, runner: Runner) -> Failure | None:
        """See `Driver.drive`."""
        loop, cell = runner.loop, PolicyCell(runner.loop)
        failure = self._episode(loop, cell)
        try:
            cell.rest()
        except PlanError as error:
            raise Aborted(failure or _fault(loop, str(error))) from error
        return failure

    def _episode(self, loop: ControlLoop, cell: PolicyCell) -> Failure | None:
        timing = self._timing
        with Guard() as guard:
            self._policy.reset(cell.observe())
        if guard.error is not None:
            return _raised(loop, "reset", guard.error)
        k, now, end = 0, 0, round(timing.seconds / TIMESTEP)
        while now < end:
            answer = self._answer(loop, cell)
            if answer is None:
                loop.note("the policy says that all is done")
                return None
            if isinstance(answer, Failure):
                return answer
            k += 1
            due = timing.decision(k)
            try:
                cell.carry_out(answer, due - now)
            except (PlanError, InvalidValueError) as error:
                return _fault(loop, str(error))
            now = due
        loop.note(f"the episode's {timing.seconds:g} s are over")
        return None

    def _answer(self, loop: ControlLoop, cell: PolicyCell) -> Action | Failure | None:
        """Return the policy's answer, checked; a failure where it cannot be carried out."""
        observation = cell.observe()
        with Guard() as guard:
            answer = self._policy.act(observation)
            # What is no number may raise anything when it is taken for one.
            return None if answer is None else cell.checked(answer)
        error = guard.error
        if isinstance(error, InvalidValueError):
            return _fault(loop, str(error))
        return _raised(loop, "act", error)


class StepwiseDriver:
    """A scenario under actions from outside, one at a time; judged as every run is."""

    def __init__(self, scenario: Scenario, simulation: Simulation, timing: PolicyTiming) -> None:
        """Put the world at the start of the scenario."""
        self._runner = Runner(scenario, simulation, self)
        self._cell = PolicyCell(self._runner.loop)
        self._task, self._sim = scenario.task, simulation
        self._timing, self._decisions, self._periods = timing, 0, 0

    @property
    def over(self) -> bool:
        """True once its time is over."""
        return self._periods >= round(self._timing.seconds / TIMESTEP)

    @property
    def done(self) -> bool:
        """True while the world is as the task wants it at the end."""
        return self._task.verdict(self._sim) is None

    def observe(self) -> Observation:
        """Return what can be known now."""
        return self._cell.observe()

    def step(self, action: object) -> Failure | None:
        """Carry out an action until the next one is due; return what ended the episode, if so."""
        self._decisions += 1
        due = self._timing.decision(self._decisions)
        try:
            self._cell.carry_out(self._cell.checked(action), due - self._periods)
        except (PlanError, InvalidValueError) as error:
            return Failure(cause=Cause.LIMIT, evidence=str(error), time=self._sim.time)
        except Aborted as aborted:
            return aborted.failure
        self._periods = due
        return None

    def end(self) -> Failure | None:
        """Come to rest and judge the world."""
        return self._runner.finish()

    def measures(self) -> dict[str, float]:
        """Return the task's figures of the world now."""
        return self._task.measures(self._sim)

    def drive(self, runner: Runner) -> Failure | None:
        """Come to rest; see `Driver.drive`."""
        try:
            self._cell.rest()
        except PlanError as error:
            raise Aborted(Failure(cause=Cause.LIMIT, evidence=str(error))) from error
        return None


def _raised(loop: ControlLoop, where: str, error: Exception | SystemExit | None) -> Failure:
    return _fault(loop, f"it raised {type(error).__name__} in {where}: {error}")


def _fault(loop: ControlLoop, what: str) -> Failure:
    time = loop.sim.time
    return Failure(cause=Cause.LIMIT, evidence=f"the policy at {time:.3f} s: {what}", time=time)
