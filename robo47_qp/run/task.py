"""What every task is: a job for the robot that ends in success or in a named failure."""

from collections.abc import Generator, Sequence
from dataclasses import field
from typing import Any, Protocol

import mujoco
import numpy as np

from robo47_qp.model.obstacle import Obstacle
from robo47_qp.run.failure import Failure
from robo47_qp.run.steps import StepLike
from robo47_qp.sim.simulation import Simulation

Program = Generator[StepLike, None, Failure | None]
"""Yields steps, each when the one before is done, and returns why it gave up, if so. A step that
fails raises `StepFailed` where it was yielded; a program that does not catch it ends with it."""


def option(default: Any, help: str) -> Any:
    """Declare a field of a task that the command line offers as an option.

    Args:
        default: Its default.
        help: What it is, with its unit.
    """
    return field(default=default, metadata={"help": help})


class Task(Protocol):
    """A job. It knows objects and places, but no solver, no gain and no robot."""

    @property
    def name(self) -> str:
        """Short name for recordings and messages."""
        ...

    @property
    def obstacles(self) -> Sequence[Obstacle]:
        """What stands still in the scene and must not be touched."""
        ...

    @property
    def force_max(self) -> float:
        """Net contact force on the tool, and what it holds, that no run may exceed [N]."""
        ...

    def variant(self, rng: np.random.Generator) -> "Task":
        """The same job with what its scene is made of drawn at random, before it is built."""
        ...

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        """Add the bodies of the task to a spec that holds the robot at the origin."""
        ...

    def reset(self, simulation: Simulation, rng: np.random.Generator | None) -> None:
        """Put the objects at their start; the defaults where rng is None."""
        ...

    def preview(self, simulation: Simulation) -> Sequence[StepLike]:
        """The motions foreseen from here, so that they can be checked before moving."""
        ...

    def program(self, simulation: Simulation) -> Program:
        """What to do, looking at the world as it is whenever the next step is due."""
        ...

    def monitor(self, simulation: Simulation) -> None:
        """Look at the world, every few control periods, whoever moves the arm.

        What has to be so on the way and cannot be seen at the end is noted here, in the
        simulation: its markers, or MuJoCo's user data. A task keeps no notes itself. What moves
        freely, and the robot, are left alone.
        """
        ...

    def verdict(self, simulation: Simulation) -> Failure | None:
        """Judge the world as it is at the end, with what was noted on the way; None is success."""
        ...

    def measures(self, simulation: Simulation) -> dict[str, float]:
        """Figures of the task's own at the end, by name with unit."""
        ...
