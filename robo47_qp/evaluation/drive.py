"""Drive: what brings an episode from its start to its end."""

from collections.abc import Sequence
from typing import Protocol

from robo47_qp.observer import Observer
from robo47_qp.recording import Sink
from robo47_qp.run import Run, Scenario
from robo47_qp.runner import Runner
from robo47_qp.simulation import Simulation


class Drive(Protocol):
    """Brings a scenario from its start to its end; goes to worker processes by pickle."""

    def __call__(
        self,
        scenario: Scenario,
        simulation: Simulation,
        *,
        sinks: Sequence[Sink],
        observers: Sequence[Observer],
    ) -> Run:
        """Reset simulation and task from the scenario's seed, and run.

        Raises:
            PolicyFailed: The policy raised something.
            InvalidValueError: A command is none that can be carried out.
        """
        ...


def classical(
    scenario: Scenario,
    simulation: Simulation,
    *,
    sinks: Sequence[Sink],
    observers: Sequence[Observer],
) -> Run:
    """The classical stack; see `Drive`."""
    return Runner(scenario, simulation).run(sinks=sinks, observers=observers)
