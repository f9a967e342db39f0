"""Task: a job for the robot that ends in success or in a named failure."""

from abc import ABC, abstractmethod
from collections.abc import Generator, Mapping, Sequence
from dataclasses import Field, field, fields, replace
from typing import Any, ClassVar, Self

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.arrays import Checked
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.cell import places_in_cell
from robo47_qp.model.obstacle import Obstacle
from robo47_qp.model.robot import Robot
from robo47_qp.run.failure import Failure
from robo47_qp.run.steps import StepLike
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation

Program = Generator[StepLike, None, Failure | None]
"""Yields steps, each when the previous one is done; returns why it gave up, or None. A step that
fails raises `StepFailed` at its yield, which ends a program that does not catch it."""


def option(default: Any, help: str, *, drawn: bool = False) -> Any:
    """Declare a field of a task that is an option of the command line.

    Args:
        default: Its default.
        help: What it is, with its unit.
        drawn: A seed draws it, so that it is left out beside one.
    """
    return field(default=default, metadata={"help": help, "drawn": drawn})


class Task(Checked, ABC):
    """A job for the robot. It knows objects and poses, but no solver, no gain and no robot.

    A task is a frozen dataclass with a name, a scene, a program and a verdict; everything else
    has a default. The rules in the annotations of its fields are checked, see `Checked`.
    """

    scene_stream: ClassVar[int | None] = None
    """Random stream from which a single run with a seed draws the `variant`; None draws none."""
    goals_asked_for: ClassVar[bool] = False
    """True where markers are poses that the tool is asked for, and not things that are seen."""

    default_robot: ClassVar[str] = "panda"
    """Robot that does it where none is named; see `load_robot`."""
    tools_needed: ClassVar[int] = 1
    """How many tools the robot must have."""
    opening_needed: ClassVar[float | None] = None
    """How wide the gripper of each of those tools must open at least [m]; None where none is
    needed."""

    @property
    def opening(self) -> float | None:
        """How wide it must open for what this task handles [m]; None where none is needed."""
        return self.opening_needed

    def check_robot(self, robot: Robot) -> None:
        """Check that a robot has the tools and grippers that the task needs.

        Raises:
            InvalidValueError: It has not; the message says what is missing.
        """
        have, needed = len(robot.tools), self.tools_needed
        if have < needed:
            expected = f"one with {needed} tools for {self.name}, such as {self.default_robot}"
            raise InvalidValueError("robot", f"{robot.name} with {have}", expected)
        if self.opening is None:
            return
        force = getattr(self, "grip_force", 0.0)
        for tool in robot.tools[:needed]:
            found = "without a gripper"
            if tool.gripper is not None:
                found = f"whose gripper opens {1e3 * tool.gripper.width_max:.0f} mm"
                if tool.gripper.width_max >= self.opening:
                    if tool.gripper.force_max >= force:
                        continue
                    found = f"whose fingers press with {tool.gripper.force_max:.0f} N"
                    expected = f"one whose fingers press with {force:.0f} N for {self.name}"
                    raise InvalidValueError("robot", f"{robot.name}, {found}", expected)
            expected = (
                f"one whose gripper opens at least {1e3 * self.opening:.0f} mm for "
                f"{self.name}, such as {self.default_robot}"
            )
            raise InvalidValueError("robot", f"{robot.name}, {found}", expected)

    def laid_out(self, robot: Robot) -> Self:
        """Return the task with its places where the cell of a robot has them.

        Fields that have other values than their defaults were chosen, and stay.
        """
        places = places_in_cell(robot, self.name)
        own: list[Field[Any]] = list(fields(self))  # type: ignore[arg-type]
        moved = {
            one.name: places[one.name]
            for one in own
            if one.name in places and getattr(self, one.name) == one.default
        }
        return replace(self, **moved) if moved else self  # type: ignore[type-var]

    @property
    @abstractmethod
    def name(self) -> str:
        """Short name for recordings and messages."""

    @property
    def obstacles(self) -> Sequence[Obstacle]:
        """Static obstacles of the scene, which the robot must not touch."""
        return ()

    @property
    def judged(self) -> Sequence[str]:
        """What the verdict and the limits of the run demand, in words with their numbers."""
        return ()

    @property
    def force_max(self) -> float:
        """Largest allowed net contact force on the tool and what it holds [N]."""
        return 60.0

    @property
    def fixed_force_max(self) -> float:
        """Largest allowed contact force of a hand with the table and what else stands fixed [N].

        What the hand holds may be pressed on them harder, up to `force_max`.
        """
        return 10.0

    @property
    def time_limit(self) -> float:
        """Simulated time after which programs and policies alike have failed [s]."""
        return 60.0

    @property
    def usual_time(self) -> float:
        """About how long the task takes where much is wrong [s]: pushes come within it."""
        return 0.7 * self.time_limit

    def variant(self, rng: np.random.Generator) -> Self:
        """Return the task with randomly drawn properties of its scene, which is not yet built."""
        return self

    @abstractmethod
    def build_scene(self, spec: mujoco.MjSpec) -> None:
        """Add the bodies of the task to a spec that holds the robot at the origin."""

    def reset(self, simulation: Simulation, rng: np.random.Generator | None) -> None:
        """Place the objects at random start poses, or at the default ones if rng is None."""

    def as_seen(self, name: str, T_world_thing: SE3) -> SE3 | None:
        """Return what the cell's camera tells of an object or a marker.

        For things that a camera cannot measure as well as the others: programs and policies get
        no other pose of them, with an exact camera, too.

        Args:
            name: Name of the object or the marker.
            T_world_thing: Its pose as the camera measures things.

        Returns:
            The pose that is told; None if nothing is.
        """
        return T_world_thing

    def preview(self, sensed: Sensed) -> Sequence[StepLike]:
        """Return the steps known in advance; they are planned as a check before the arm moves."""
        return ()

    @abstractmethod
    def program(self, sensed: Sensed) -> Program:
        """Yield the steps one by one; each may depend on what is sensed at that moment.

        `sensed` is brought up to date while steps run: read it again after every one.
        """

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


def own_options(kind: type[Task]) -> list[Field[Any]]:
    """Return the fields of a task that it declares with `option`."""
    return [one for one in fields(kind) if "help" in one.metadata]  # type: ignore[arg-type]


def task_of_options(
    kind: type[Task], given: Mapping[str, Any], seed: int | None, robot: Robot
) -> Task:
    """Return a task by its options, as it is in a single run, in the cell of a robot.

    Args:
        kind: Its class.
        given: Values of all of its options, by name.
        seed: Draws its `variant`; None leaves it as the options say.
        robot: The robot, as it stands in its cell.

    Raises:
        InvalidValueError: An option has no sense, or the seed draws it in place of what is given.
    """
    own = own_options(kind)
    try:
        task = kind(**{one.name: given[one.name] for one in own}).laid_out(robot)
    except InvalidValueError as error:
        if error.name in (one.name for one in own):
            raise InvalidValueError(f"--{error.name}", error.found, error.expected) from error
        raise
    if seed is None:
        return task
    for one in own:
        # An option that is left out has this very object; one that is given may be equal to it.
        if one.metadata.get("drawn") and given[one.name] is not one.default:
            expected = "left out with --seed, which draws it"
            raise InvalidValueError(f"--{one.name}", given[one.name], expected)
    stream = getattr(kind, "scene_stream", None)
    return task if stream is None else task.variant(np.random.default_rng([seed, stream]))
