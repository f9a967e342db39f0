"""What every task is: a job for the robot that ends in success or in a named failure."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import mujoco
import numpy as np

from robo47_qp.obstacle import Obstacle
from robo47_qp.simulation import Simulation
from robo47_qp.waypoint import Waypoint


class Cause(Enum):
    """Why a run failed."""

    PLAN = "plan"
    """A waypoint could not be reached or planned to while the robot was under way."""
    GRASP = "grasp"
    """The fingers closed and did not hold the object."""
    DROP = "drop"
    """The object was held and got lost."""
    PLACE = "place"
    """The object is not where it should be at the end."""
    HOME = "home"
    """The robot did not end at home with an open gripper."""


@dataclass(frozen=True, kw_only=True)
class Failure:
    """How a run failed."""

    cause: Cause
    evidence: str
    """What was seen, with numbers."""


Step = Waypoint | tuple[Waypoint, ...]
"""A waypoint, or several that are known together: planned as one, without a stop where they are
blended or passed."""
Program = Generator[Step, None, Failure | None]
"""Yields steps, each when the one before is done, and returns why it gave up, if so."""


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

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        """Add the bodies of the task to a spec that holds the robot at the origin."""
        ...

    def reset(self, simulation: Simulation, rng: np.random.Generator | None) -> None:
        """Put the objects at their start; the defaults where rng is None."""
        ...

    def outlook(self, simulation: Simulation) -> Sequence[Step]:
        """The waypoints foreseen from here, so that they can be checked before moving."""
        ...

    def program(self, simulation: Simulation) -> Program:
        """What to do, looking at the world as it is whenever the next waypoint is due."""
        ...

    def verdict(self, simulation: Simulation) -> Failure | None:
        """Judge the world as it is at the end; None is success."""
        ...

    def measures(self, simulation: Simulation) -> dict[str, float]:
        """Figures of the task's own at the end, by name with unit."""
        ...
