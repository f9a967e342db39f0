"""Stack three cubes at a goal."""

import sys
from dataclasses import dataclass

from rich.console import Console

from robo47_qp.cli import main, run_task
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.stack import RunOptions
from robo47_qp.tasks.stack.stack import Stack


@dataclass(frozen=True, kw_only=True)
class StackOptions(RunOptions):
    """Options of this scenario."""

    goal: tuple[float, float] = Stack.goal
    """Where the tower is to stand without --seed: x and y on the table [m]."""


def run(options: StackOptions, console: Console) -> int:
    """Run the scenario; returns the exit code."""
    return run_task(Stack(goal=options.goal), PANDA, options, console)


if __name__ == "__main__":
    sys.exit(main(StackOptions, run, __doc__))
