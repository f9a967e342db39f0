"""The main job: pick a cube from the table, place it elsewhere, record everything."""

import sys
from dataclasses import dataclass

from rich.console import Console

from robo47_qp.cli import main, run_task
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.stack import RunOptions
from robo47_qp.tasks.pick_place.pick_place import PickPlace


@dataclass(frozen=True, kw_only=True)
class PickPlaceOptions(RunOptions):
    """Options of this scenario."""

    pick: tuple[float, float] = PickPlace.pick
    """Where the cube is picked without --seed: x and y on the table [m]."""
    place: tuple[float, float] = PickPlace.place
    """Where the cube is placed without --seed: x and y on the table [m]."""


def run(options: PickPlaceOptions, console: Console) -> int:
    """Run the scenario; returns the exit code."""
    task = PickPlace(pick=options.pick, place=options.place)
    return run_task(task, PANDA, options, console)


if __name__ == "__main__":
    sys.exit(main(PickPlaceOptions, run, __doc__))
