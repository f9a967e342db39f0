"""Reach tool poses spread over the workspace and hold each of them."""

import sys
from dataclasses import dataclass

from rich.console import Console

from robo47_qp.cli import main, run_task
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.stack import RunOptions
from robo47_qp.tasks.reach.reach import Reach


@dataclass(frozen=True, kw_only=True)
class ReachOptions(RunOptions):
    """Options of this scenario."""

    count: int = Reach.count
    """Poses to visit, 1 to 5."""


def run(options: ReachOptions, console: Console) -> int:
    """Run the scenario; returns the exit code."""
    return run_task(Reach(count=options.count), PANDA, options, console)


if __name__ == "__main__":
    sys.exit(main(ReachOptions, run, __doc__))
