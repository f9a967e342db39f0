"""What a hand feels, for tests of those that pick and insert a peg by feel."""

from collections.abc import Generator, Iterator
from dataclasses import replace

import numpy as np
from mink import SE3

from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run.contact_steps import Press
from robo47_qp.run.failure import Condition, StepFailed, require
from robo47_qp.run.scenario import Run
from robo47_qp.run.steps import StepLike, Wait
from robo47_qp.sim.sensed import Sensed, Senses
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.peg_insert.feeling_inserter import FeelingInserter
from robo47_qp.tasks.peg_insert.peg_insert import PegInsert
from tests.runs import no_objects


def rows_of(run: Run, name: str, signal: str) -> np.ndarray:
    """Rows of a signal in the first phase of a name."""
    i = next(i for i, phase in enumerate(run.phases) if phase.name == name)
    return run.rows[signal][run.phases[i].start : run.phases[i + 1].start]


class Tool(Sensed):
    """A tool at a height, and what its wrist feels, in a cell whose sheet tells errors."""

    def __init__(self, **noise: float) -> None:
        simulation = Simulation(PANDA, no_objects)
        sheet = Senses(simulation).sensed.sheet
        erring = replace(sheet, noise={**sheet.noise, **noise})
        super().__init__(PANDA, erring, simulation.objects)
        self.at, self.felt = np.zeros(3), np.zeros(3)
        self.now = self.taken = 0.0

    @property
    def time(self) -> float:
        return self.now

    def tool_pose(self, tool: int = 0) -> SE3:
        return SE3.from_translation(self.at)

    def felt_force(self, tool: int = 0) -> np.ndarray:
        return self.felt

    def seen_time(self, name: str) -> float:
        return self.taken

    def seen_pose(self, name: str) -> SE3:
        return SE3.from_translation(self.at - np.array([0.0, 0.0, 0.03]))


def feeling(tool: Tool) -> FeelingInserter:
    """Return who inserts a peg into a hole; with the tool in the origin, the peg stands on it."""
    hand = FeelingInserter(
        sensed=tool,
        item=PegInsert().peg,
        above=0.2,
        search_force=2.0,
        insert_force=5.0,
        T_world_hole=SE3.identity(),
    )
    top = hand._tool_on_top(np.zeros(2)).translation()
    return replace(hand, T_world_hole=SE3.from_translation(-top))


def performed(steps: Generator[StepLike, None, None]) -> Iterator[StepLike]:
    """Yield the steps of a program, which fails as in a run where it gives up.

    So does a search in vain.
    """
    failed: StepFailed | None = None
    while True:
        try:
            step = next(steps) if failed is None else steps.throw(failed)
        except StopIteration:
            return
        failed = None
        if isinstance(step, Wait) and step.until is not None:
            failed = _failure(step.name, step.until)
            continue
        yield step
        if isinstance(step, Press) and step.name == "search" and step.needed:
            assert step.until is not None
            failed = _failure(step.name, step.until)


def _failure(name: str, condition: Condition) -> StepFailed | None:
    try:
        require(name, (condition,))
    except StepFailed as error:
        return error
    return None


def lanes_of(step: Press) -> np.ndarray:
    """Return the ends of the lanes of a search (n, 3)."""
    targets = [waypoint.target for waypoint in step.waypoints]
    return np.array([one.translation() for one in targets if isinstance(one, SE3)])


def meet_edge(tool: Tool, search: Press) -> None:
    """Let an edge stop the peg where the tool is; then nothing pushes it any more."""
    assert search.until is not None
    tool.felt = np.array([0.0, -6.0, 3.0])
    for _ in range(4):
        search.until.against()
    tool.felt = np.zeros(3)
