"""Programs: what the policy server answers robosuite's client with."""

from collections.abc import Callable, Mapping
from typing import Any

from robo47_qp.errors import InvalidValueError, PlanError
from robo47_qp.run.failure import Cause
from scenarios.judges.suite.blocks import lift, stack
from scenarios.judges.suite.can import can
from scenarios.judges.suite.cell import FINGERTIPS, WIPER, Cell, Failed, Station, Ticks
from scenarios.judges.suite.door import door
from scenarios.judges.suite.nuts import round_nut, square_nut
from scenarios.judges.suite.pair import Pair
from scenarios.judges.suite.tool_hang import tool_hang
from scenarios.judges.suite.two_arms import peg_in_hole, two_arm_lift
from scenarios.judges.suite.wipe import wipe

ONE_ARM: dict[str, Callable[[Cell], Ticks]] = {
    "Lift": lift,
    "Stack": stack,
    "PickPlaceCan": can,
    "Door": door,
    "NutAssemblySquare": square_nut,
    "NutAssemblyRound": round_nut,
    "Wipe": wipe,
    "ToolHang": tool_hang,
}
"""Programs of one arm by the names of robosuite's tasks."""
TWO_ARMS: dict[str, Callable[[Pair], Ticks]] = {
    "TwoArmLift": two_arm_lift,
    "TwoArmPegInHole": peg_in_hole,
}
"""Programs of two arms."""
PROGRAMS = (*ONE_ARM, *TWO_ARMS)
"""Names of all tasks that there are programs for."""
GRIP_SITES = {"Wipe": WIPER, "TwoArmPegInHole": 0.0}
"""Distance of what programs name poses of from robosuite's hand, where it is not the grip site of
its gripper [m]; peg and plate are fixed to the hands."""
FALL = 0.4
"""Time in which things that robosuite lets fall at the beginning come to rest [s]."""


def begun(task: str, observation: Mapping[str, Any]) -> tuple[Station, Ticks]:
    """The arms of a task, and its program, which begins once its things are where they will be."""
    grip_site = GRIP_SITES.get(task, FINGERTIPS)
    if task in TWO_ARMS:
        pair = Pair(observation, grip_site)
        return pair, settled(pair, TWO_ARMS[task](pair))
    cell = Cell(observation, grip_site)
    return cell, settled(cell, ONE_ARM[task](cell))


def settled(station: Station, program: Ticks) -> Ticks:
    """A program after things have come to rest."""
    yield from station.wait(FALL)
    yield from program


class Programs:
    """Answers the observations of one episode with the goals of joints and gripper."""

    metadata: Mapping[str, Any] = {"name": "robo47_qp", "tasks": list(PROGRAMS)}

    def __init__(self) -> None:
        self._station: Station | None = None
        self._ended, self._told = True, ""

    def infer(self, observation: Mapping[str, Any]) -> Mapping[str, Any]:
        """See `Served.infer`; the first observation says what the task is."""
        if "reset" in observation:
            task = str(observation["task"])
            if task not in PROGRAMS:
                raise InvalidValueError("task", repr(task), f"one of {', '.join(PROGRAMS)}")
            self._station, self._ticks = begun(task, observation)
            self._ended, self._told = False, ""
        if self._station is None:
            raise InvalidValueError("the first observation", "one without reset", "one with it")
        self._station.seen = observation
        if not self._ended:
            self._step()
        return {"actions": self._station.actions, "done": self._ended, "told": self._told}

    def _step(self) -> None:
        try:
            next(self._ticks)
        except StopIteration:
            self._ended = True
        except Failed as error:
            self._ended, self._told = True, str(error)
        except PlanError as error:
            self._ended, self._told = True, f"{Cause.PLAN.value}: {error}"
