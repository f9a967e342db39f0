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
"""Yields steps, each when the previous one is done; returns why it gave up, or None. A step that
fails raises `StepFailed` at its yield, which ends a program that does not catch it."""


def option(default: Any, help: str) -> Any:
    """Declare a field of a task that is an option of the command line; `help` states its unit."""
    return field(default=default, metadata={"help": help})


class Task(Checked, ABC):
    """A job for the robot. It knows objects and poses, but no solver, no gain and no robot.

    A task is a frozen dataclass with a name, a scene, a program and a verdict; everything else
    has a default. The rules in the annotations of its fields are checked, see `Checked`.
    """

    scene_stream: ClassVar[int | None] = None
    """Random stream from which a single run with a seed draws the `variant`; None draws none."""
    goals_asked_for: ClassVar[bool] = False
    """True where markers are poses that the tool is asked for, and not things that are seen."""

    tools_needed: ClassVar[int] = 1
    """How many tools the robot must have."""

    @property
    @abstractmethod
    def name(self) -> str:
        """Short name for recordings and messages."""

    @property
    def obstacles(self) -> Sequence[Obstacle]:
        """Static obstacles of the scene, which the robot must not touch."""
        return ()

    @property
    def force_max(self) -> float:
        """Largest allowed net contact force on the tool and what it holds [N]."""
        return 60.0

    def variant(self, rng: np.random.Generator) -> Self:
        """Return the task with randomly drawn properties of its scene, which is not yet built."""
        return self

    @abstractmethod
    def build_scene(self, spec: mujoco.MjSpec) -> None:
        """Add the bodies of the task to a spec that holds the robot at the origin."""

    def reset(self, simulation: Simulation, rng: np.random.Generator | None) -> None:
        """Place the objects at random start poses, or at the default ones if rng is None."""

    def preview(self, simulation: Simulation) -> Sequence[StepLike]:
        """Return the steps known in advance; they are planned as a check before the arm moves."""
        return ()

    @abstractmethod
    def program(self, simulation: Simulation) -> Program:
        """Yield the steps one by one; each may depend on the state of the world at that moment."""

    def monitor(self, simulation: Simulation) -> None:
        """Observe the world every few control periods, under a program and under a policy.

        A task has no state: what the verdict needs from the run is kept in the simulation, in its
        markers or MuJoCo's user data. The robot and free bodies must not be changed.
        """

    @abstractmethod
    def verdict(self, simulation: Simulation) -> Failure | None:
        """Judge the final state of the world; None is success."""

    def measures(self, simulation: Simulation) -> dict[str, float]:
        """Return figures of the final state, by name with unit."""
        return {}
