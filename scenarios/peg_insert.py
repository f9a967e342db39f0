"""Put a peg into a hole that is known to 2 mm and 2 degrees: search, give way, insert."""

import sys

from rich.console import Console

from robo47_qp.cli import main, run_task
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.stack import RunOptions
from robo47_qp.tasks.peg_insert.peg_insert import PegInsert


def run(options: RunOptions, console: Console) -> int:
    """Run the scenario; returns the exit code."""
    return run_task(PegInsert(), PANDA, options, console)


if __name__ == "__main__":
    sys.exit(main(RunOptions, run, __doc__))
