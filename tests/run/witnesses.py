"""A run, and those who saw it."""

from dataclasses import dataclass, field

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.run.observers import Observer
from robo47_qp.run.recording import Rows
from robo47_qp.run.scenario import Run
from robo47_qp.sim.simulation import Simulation


@dataclass
class Eyewitness(Observer):
    """Reads the world at every tick."""

    seen: list[tuple[float, Vector, Vector, Vector, Vector, Vector]] = field(default_factory=list)

    def tick(self, simulation: Simulation) -> None:
        state = simulation.state()
        cube = simulation.object_pose("cube").wxyz_xyz
        tau, a = simulation.last_torque(), simulation.last_acceleration()
        self.seen.append((simulation.time, state.q, state.v, cube, tau, a))


@dataclass
class Keeper:
    blocks: list[Matrix] = field(default_factory=list)

    def write(self, rows: Rows) -> None:
        self.blocks.append(rows.values.copy())


def ends(run: Run) -> list[int]:
    """Row after the last one of each phase."""
    return [phase.start for phase in run.phases[1:]] + [len(run.rows)]
