"""Pick a cube from a moving belt and put it beside the belt."""

import sys

import numpy as np
from rich.console import Console

from robo47_qp.cli import main, run_task
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.stack import RunOptions
from robo47_qp.tasks.conveyor_pick.conveyor_pick import ConveyorPick

_VARIANT = 2
"""Draws of the scene come from another stream than those of the start."""


def run(options: RunOptions, console: Console) -> int:
    """Run the scenario, with --seed on a scene drawn at random; returns the exit code."""
    task = ConveyorPick()
    if options.seed is not None:
        task = task.variant(np.random.default_rng([options.seed, _VARIANT]))
    return run_task(task, PANDA, options, console)


if __name__ == "__main__":
    sys.exit(main(RunOptions, run, __doc__))
