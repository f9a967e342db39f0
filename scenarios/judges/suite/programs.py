"""Programs: what the policy server answers robosuite's client with."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from robo47_qp.errors import InvalidValueError, PlanError
from robo47_qp.run.failure import Cause
from scenarios.judges.suite.blocks import lift, stack
from scenarios.judges.suite.can import can
from scenarios.judges.suite.cell import FINGERTIPS, WIPER, Cell, Failed, Ticks
from scenarios.judges.suite.door import door
from scenarios.judges.suite.nuts import round_nut, square_nut
from scenarios.judges.suite.tool_hang import tool_hang
from scenarios.judges.suite.wipe import wipe

PROGRAMS: dict[str, Callable[[Cell], Ticks]] = {
    "Lift": lift,
    "Stack": stack,
    "PickPlaceCan": can,
    "Door": door,
    "NutAssemblySquare": square_nut,
    "NutAssemblyRound": round_nut,
    "Wipe": wipe,
    "ToolHang": tool_hang,
}
"""Programs by the names of robosuite's tasks."""
FALL = 0.4
"""Time in which things that robosuite lets fall at the beginning come to rest [s]."""


def begun(task: str, cell: Cell) -> Ticks:
    """Do a task, once its things are where they will be."""
    yield from cell.wait(FALL)
    yield from PROGRAMS[task](cell)


class Programs:
    """Answers the observations of one episode with the goals of joints and gripper."""

    metadata: Mapping[str, Any] = {"name": "robo47_qp", "tasks": list(PROGRAMS)}

    def __init__(self) -> None:
        self._cell: Cell | None = None
        self._ended, self._told = True, ""

    def infer(self, observation: Mapping[str, Any]) -> Mapping[str, Any]:
        """See `Served.infer`; the first observation says what the task is."""
        if "reset" in observation:
            task = str(observation["task"])
            if task not in PROGRAMS:
                raise InvalidValueError("task", repr(task), f"one of {', '.join(PROGRAMS)}")
            self._cell = Cell(observation, grip_site=WIPER if task == "Wipe" else FINGERTIPS)
            self._ticks, self._ended, self._told = begun(task, self._cell), False, ""
        if self._cell is None:
            raise InvalidValueError("the first observation", "one without reset", "one with it")
        self._cell.seen = observation
        if not self._ended:
            self._step()
        actions = np.append(self._cell.goal, self._cell.grip)
        return {"actions": actions, "done": self._ended, "told": self._told}

    def _step(self) -> None:
        try:
            next(self._ticks)
        except StopIteration:
            self._ended = True
        except Failed as error:
            self._ended, self._told = True, str(error)
        except PlanError as error:
            self._ended, self._told = True, f"{Cause.PLAN.value}: {error}"
