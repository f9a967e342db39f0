"""Wipe a board of unknown height, pressing with a constant force while the sponge slides."""

import sys
from dataclasses import dataclass

from rich.console import Console

from robo47_qp.cli import main, run_task
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.stack import RunOptions
from robo47_qp.tasks.wipe.board import WipeSettings
from robo47_qp.tasks.wipe.wipe import Wipe


@dataclass(frozen=True, kw_only=True)
class WipeOptions(RunOptions):
    """Options of this scenario."""

    force: float = WipeSettings.force
    """What the sponge is pressed with [N]."""


def run(options: WipeOptions, console: Console) -> int:
    """Run the scenario; returns the exit code."""
    task = Wipe(settings=WipeSettings(force=options.force), force_max=3.0 * options.force)
    return run_task(task, PANDA, options, console)


if __name__ == "__main__":
    sys.exit(main(WipeOptions, run, __doc__))
