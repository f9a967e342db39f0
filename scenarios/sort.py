"""Sort boxes and cylinders into two bins by their colour."""

import sys

import numpy as np
from rich.console import Console

from robo47_qp.cli import main, run_task
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.stack import RunOptions
from robo47_qp.tasks.sort.sort import Sort

_SHAPES = 1
"""Tells the draw of the shapes from that of the poses, which has the seed alone."""


def run(options: RunOptions, console: Console) -> int:
    """Run the scenario; returns the exit code."""
    task = Sort()
    if options.seed is not None:
        task = task.variant(np.random.default_rng([options.seed, _SHAPES]))
    return run_task(task, PANDA, options, console)


if __name__ == "__main__":
    sys.exit(main(RunOptions, run, __doc__))
