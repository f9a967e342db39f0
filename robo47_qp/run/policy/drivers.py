"""Drivers that move the arm by a policy, or by one action at a time, instead of a program."""

from dataclasses import dataclass
from typing import Annotated, TypeAlias

from robo47_qp.arrays import Checked, Range
from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import InvalidValueError, PlanError, Robo47Error
from robo47_qp.run.control_loop import Aborted, ControlLoop
from robo47_qp.run.failure import Cause, Failure
from robo47_qp.run.foreign_code import Guard
from robo47_qp.run.policy.action_check import checked_action
from robo47_qp.run.policy.cell import PolicyCell
from robo47_qp.run.policy.child import shortened, told
from robo47_qp.run.policy.policy import Action, Observation, Policy
from robo47_qp.run.policy.process import PolicyFault, PolicyProcess
from robo47_qp.run.runner import Runner
from robo47_qp.run.scenario import Run, Scenario
from robo47_qp.run.task import Task
from robo47_qp.sim.simulation import Simulation

DecisionRate: TypeAlias = Annotated[float, Range(at_least=1e-3, at_most=1.0 / TIMESTEP)]
EpisodeTime: TypeAlias = Annotated[float, Range(above=0.0, at_most=86_400.0)]


@dataclass(frozen=True, kw_only=True)
class PolicyTiming(Checked):
    """Rate of a policy's decisions, and length of an episode."""

    rate: DecisionRate = 30.0
    """Decisions per second, at most one per control period [1/s]."""
    seconds: EpisodeTime | None = None
    """Longest simulated time of an episode, in place of `Scenario.time_limit` [s]."""

    def decision(self, k: int, end: int) -> int:
        """Return the control period of decision k (from 0), at most that of the end."""
        return min(round(k / (self.rate * TIMESTEP)), end)

    def end(self, scenario: Scenario) -> int:
        """Return the control period that ends an episode."""
        return round((self.seconds or scenario.time_limit) / TIMESTEP)


def check_judged(task: Task, simulation: Simulation) -> None:
    """Reset the world, and check that the task is not already done at its start.

    Raises:
        InvalidValueError: The verdict is success before anything has moved. Conditions of the
            task's own program that a policy must meet, too, belong in `Task.monitor`.
    """
    simulation.reset()
    task.reset(simulation, None)
    if task.verdict(simulation) is None:
        expected = "one whose verdict is no success before anything has moved"
        raise InvalidValueError("task", repr(task.name), expected)


def check_one_tool(task: Task) -> None:
    """Check that a policy can do the task: it sees and moves the main tool.

    Raises:
        InvalidValueError: The task needs more tools.
    """
    if task.tools_needed > 1:
        expected = "one that a single tool does: observations and actions are of the main tool"
        raise InvalidValueError("task", repr(task.name), expected)


class PolicyDriver:
    """Lets a policy move the arm during a run.

    The episode ends when the policy returns None, when its time is over, when the policy raises
    or returns an invalid action, or when the watchdog ends it. Then the arm comes to rest and the
    task's own verdict judges the world, including its demands on arm and gripper at the end.
    """

    def __init__(self, policy: Policy, timing: PolicyTiming | None = None) -> None:
        """Use a policy; the scenario's planner gives the limits of all motions."""
        self._policy, self._timing = policy, PolicyTiming() if timing is None else timing

    def drive(self, runner: Runner) -> Failure | None:
        """See `Driver.drive`."""
        loop, cell = runner.loop, PolicyCell(runner.loop)
        failure = self._answered(runner, cell)
        runner.acting = False
        try:
            cell.rest()
        except PlanError as error:
            raise Aborted(failure or _fault(loop, str(error))) from error
        return failure

    def _answered(self, runner: Runner, cell: PolicyCell) -> Failure | None:
        """Let the policy act; a process of its own lives as long as the episode.

        Whatever goes wrong with that process is a failure of the policy: only it can see to that.
        """
        policy, loop = self._policy, runner.loop
        if not isinstance(policy, PolicyProcess):
            return self._episode(runner, cell)
        failure, started, looked, closed = None, Guard(), Guard(), Guard()
        try:
            with started:
                policy.start(runner.scenario.seed)
            if started.error is None:
                failure = self._episode(runner, cell)
            if started.error is None and failure is None:
                with looked:
                    policy.look(loop.sim.time)
        finally:
            with closed:
                policy.close()
            runner.beyond = policy.beyond
        errors = [guard.error for guard in (started, looked, closed) if guard.error is not None]
        return failure or (_broken(loop, errors[0]) if errors else None)

    def _episode(self, runner: Runner, cell: PolicyCell) -> Failure | None:
        loop, timing = runner.loop, self._timing
        with Guard() as guard:
            self._policy.reset(cell.observe())
        if guard.error is not None:
            return _raised(loop, "reset", guard.error)
        k, now, end = 0, 0, timing.end(runner.scenario)
        while now < end:
            answer = self._answer(loop, cell)
            if answer is None:
                loop.note("the policy ended the episode")
                return None
            if isinstance(answer, Failure):
                return answer
            k += 1
            due = timing.decision(k, end)
            try:
                cell.carry_out(answer, due - now)
            except (PlanError, InvalidValueError) as error:
                return _fault(loop, str(error))
            now = due
        loop.note(f"the episode's {end * TIMESTEP:g} s are over")
        return None

    def _answer(self, loop: ControlLoop, cell: PolicyCell) -> Action | Failure | None:
        """Return the policy's checked action, or why it is invalid; None ends the episode."""
        observation = cell.observe()
        with Guard() as guard:
            answer = self._policy.act(observation)
            # Converting an object of a foreign type to numbers may raise anything.
            return None if answer is None else checked_action(answer, loop.arm)
        error = guard.error
        if isinstance(error, InvalidValueError):
            return _fault(loop, str(error))
        return _raised(loop, "act", error)


class StepwiseDriver:
    """Carries out a caller's actions one at a time, as in a Gymnasium environment."""

    def __init__(self, scenario: Scenario, simulation: Simulation, timing: PolicyTiming) -> None:
        """Reset the world to the start of the scenario."""
        self._runner = Runner(scenario, simulation, self)
        self._runner.record()
        self._cell = PolicyCell(self._runner.loop)
        self._task, self._sim = scenario.task, simulation
        self._timing, self._decisions, self._periods = timing, 0, 0
        self._end = timing.end(scenario)
        self._invalid: Failure | None = None
        self._stopped: Failure | None = None

    @property
    def over(self) -> bool:
        """True once the time limit is reached."""
        return self._periods >= self._end

    @property
    def done(self) -> bool:
        """True if the task's verdict is success now."""
        return self._task.verdict(self._sim) is None

    def observe(self) -> Observation:
        """Return the current observation."""
        return self._cell.observe()

    def step(self, action: object) -> Failure | None:
        """Carry out an action until the next one is due; a failure ends the episode."""
        self._decisions += 1
        due = self._timing.decision(self._decisions, self._end)
        try:
            action = checked_action(action, self._runner.loop.arm)
            self._cell.carry_out(action, due - self._periods)
        except (PlanError, InvalidValueError) as error:
            self._invalid = Failure(cause=Cause.LIMIT, evidence=str(error), time=self._sim.time)
            return self._invalid
        except Aborted as aborted:
            self._stopped = aborted.failure
            return self._stopped
        self._periods = due
        return None

    def end(self) -> Run:
        """Come to rest, judge the world and return what happened; the episode is then over."""
        self._runner.acting = False
        return self._runner.ended(self._stopped or self._runner.finish())

    def drive(self, runner: Runner) -> Failure | None:
        """Come to rest; see `Driver.drive`."""
        try:
            self._cell.rest()
        except PlanError as error:
            failure = self._invalid or Failure(cause=Cause.LIMIT, evidence=str(error))
            raise Aborted(failure) from error
        return self._invalid


def _raised(loop: ControlLoop, method: str, error: Exception | SystemExit | None) -> Failure:
    if isinstance(error, PolicyFault):
        return _fault(loop, str(error))
    words = "nothing" if error is None else told(error)
    return _fault(loop, f"it raised {type(error).__name__} in {method}: {words}")


def _broken(loop: ControlLoop, error: Exception | SystemExit) -> Failure:
    """Return the failure of a policy whose process could not be started, asked or ended."""
    if isinstance(error, Robo47Error):
        return _fault(loop, str(error))
    return _fault(loop, f"its process could not be run: {type(error).__name__}: {told(error)}")


def _fault(loop: ControlLoop, what: str) -> Failure:
    time, what = loop.sim.time, shortened(what)
    return Failure(cause=Cause.LIMIT, evidence=f"the policy at {time:.3f} s: {what}", time=time)
