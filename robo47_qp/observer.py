"""Observer: looks on while a run goes on."""

from robo47_qp.arrays import Matrix
from robo47_qp.motion.planner import Leg
from robo47_qp.simulation import Simulation


class Observer:
    """Base of observers: each method does nothing until it is overridden."""

    def planned(self, time: float, leg: Leg, tool_path: Matrix) -> None:
        """A leg starts; its reference tool positions are (N, 3) [m]."""

    def phase(self, time: float, name: str) -> None:
        """A phase starts."""

    def note(self, time: float, text: str, level: str) -> None:
        """Something worth telling happened; level is INFO, WARN or ERROR."""

    def tick(self, simulation: Simulation) -> None:
        """Called every few periods of the control loop; may wait to keep a pace."""

    def close(self) -> None:
        """The run is over, however it ended."""
