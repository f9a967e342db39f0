"""Task: a job for the robot that ends in success or in a named failure."""

from abc import ABC, abstractmethod
from collections.abc import Generator, Sequence
from dataclasses import field
from typing import Any, ClassVar, Self

import mujoco
import numpy as np

from robo47_qp.arrays import Checked
from robo47_qp.model.obstacle import Obstacle
from robo47_qp.run.failure import Failure
from robo47_qp.run.steps import StepLike
from robo47_qp.sim.simulation import Simulation

Program = Generator[StepLike, None, Failure | None]
"""Yields steps, each when the previous one is done, and returns why it gave up, if it did. A step
that fails raises `StepFailed` at its yield; a program that does not catch it ends with it."""


def option(default: Any, help: str) -> Any:
    """Declare a field of a task that the command line offers as an option.

    Args:
        default: Its default.
        help: What it is, with its unit.
    """
    return field(default=default, metadata={"help": help})


class Task(Checked, ABC):
    """A job for the robot. It knows objects and poses, but no solver, no gain and no robot.

    A task is a frozen dataclass with a name, a scene, a program and a verdict. Everything else
    has a default. What the annotations of its fields demand is checked: see `Checked`.
    """

    scene_stream: ClassVar[int | None] = None
    """Random stream from which a single run with a seed draws the `variant`; None draws none."""

    @property
    @abstractmethod
    def name(self) -> str:
        """Short name for recordings and messages."""

    @property
    def obstacles(self) -> Sequence[Obstacle]:
        """Static obstacles in the scene that must not be touched."""
        return ()

    @property
    def force_max(self) -> float:
        """Largest permitted net contact force on the tool and what it holds [N]."""
        return 60.0

    def variant(self, rng: np.random.Generator) -> Self:
        """Return the task with randomly drawn properties of its scene, before it is built."""
        return self

    @abstractmethod
    def build_scene(self, spec: mujoco.MjSpec) -> None:
        """Add the bodies of the task to a spec that holds the robot at the origin."""

    def reset(self, simulation: Simulation, rng: np.random.Generator | None) -> None:
        """Place the objects at random start poses; at the default ones if rng is None."""

    def preview(self, simulation: Simulation) -> Sequence[StepLike]:
        """Return the motions known in advance, so that they are checked before the arm moves."""
        return ()

    @abstractmethod
    def program(self, simulation: Simulation) -> Program:
        """Yield the steps one by one, each decided on the state of the world at that moment."""

    def monitor(self, simulation: Simulation) -> None:
        """Observe the world every few control periods, whether a program or a policy runs.

        What must hold during the run and cannot be seen at its end is recorded here, in the
        simulation: by its markers or MuJoCo's user data. A task itself has no state. The robot
        and free bodies must not be changed.
        """

    @abstractmethod
    def verdict(self, simulation: Simulation) -> Failure | None:
        """Judge the final state of the world and what was recorded; None is success."""

    def measures(self, simulation: Simulation) -> dict[str, float]:
        """Return further figures of the final state, by name with unit."""
        return {}
