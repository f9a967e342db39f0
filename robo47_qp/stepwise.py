"""Stepwise: an episode that someone else moves on, action by action."""

from robo47_qp.actions import Actions
from robo47_qp.errors import InvalidValueError, PlanError
from robo47_qp.failure import Cause, Failure
from robo47_qp.loop import Aborted
from robo47_qp.policy import Observation
from robo47_qp.policy_cell import PolicyCell
from robo47_qp.policy_runner import Pace
from robo47_qp.run import Scenario
from robo47_qp.runner import Runner
from robo47_qp.scene import TIMESTEP
from robo47_qp.simulation import Simulation


class Stepwise(Runner):
    """A scenario under actions from outside; judged as `PolicyRunner` judges."""

    def __init__(self, scenario: Scenario, simulation: Simulation, pace: Pace) -> None:
        """Put the world at the start of the scenario."""
        super().__init__(scenario, simulation)
        self._pace, self._decisions, self._periods = pace, 0, 0
        self._cell = PolicyCell(self._loop)

    @property
    def over(self) -> bool:
        """True once its time is over."""
        return self._periods >= round(self._pace.seconds / TIMESTEP)

    @property
    def done(self) -> bool:
        """True while the world is as the task wants it at the end."""
        return self.scenario.task.verdict(self._sim) is None

    def observe(self) -> Observation:
        """What can be known now."""
        return self._cell.observe()

    def step(self, action: object) -> Failure | None:
        """Carry out an action until the next one is due; what ended the episode, if anything."""
        self._decisions += 1
        due = self._pace.decision(self._decisions)
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
        return self._carried_out() or self.scenario.task.verdict(self._sim)

    def measures(self) -> dict[str, float]:
        """The task's figures of the world now."""
        return self.scenario.task.measures(self._sim)

    def _programmed(self, actions: Actions) -> Failure | None:
        """What is left of the program: coming to rest."""
        try:
            self._cell.rest()
        except PlanError as error:
            raise Aborted(Failure(cause=Cause.LIMIT, evidence=str(error))) from error
        return None
