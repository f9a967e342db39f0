"""Jobs whose program is that of a test."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from robo47_qp.motion.waypoint import Motion, Waypoint
from robo47_qp.run.failure import Cause, Condition
from robo47_qp.run.scenario import Run
from robo47_qp.run.task import Program
from robo47_qp.sim.sensed import Sensed
from tests.examples import shifted
from tests.runs import Reach, carry_out

Writes = Callable[[Sensed], Program]


@dataclass(frozen=True, kw_only=True, eq=False)
class Written(Reach):
    """A job whose program is that of a test."""

    writes: Writes
    name: str = "written"

    def preview(self, sensed: Sensed) -> Sequence[Waypoint]:
        return []

    def program(self, sensed: Sensed) -> Program:
        return self.writes(sensed)


def run_program(writes: Writes) -> Run:
    return carry_out(Written(writes=writes))


def up(sensed: Sensed, height: float = 0.05, name: str = "up") -> Waypoint:
    target = shifted(sensed.tool_pose(), np.array([0.0, 0.0, height]))
    return Waypoint(name=name, target=target, motion=Motion.LIN)


def names(run: Run) -> list[str]:
    return [phase.name for phase in run.phases]


@dataclass
class Told:
    """A condition that follows a script and counts how often it was looked at."""

    answers: Sequence[str | None] = (None,)
    """What speaks against it at each look; the last answer stays."""
    cause: Cause = Cause.SLIP
    looks: list[int] = field(default_factory=list)

    def condition(self) -> Condition:
        return Condition(name="as told", cause=self.cause, against=self._against)

    def _against(self) -> str | None:
        self.looks.append(len(self.looks))
        return self.answers[min(len(self.looks), len(self.answers)) - 1]
