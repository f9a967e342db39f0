"""Pick an item from the table and place it somewhere else."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import mujoco
import numpy as np

from robo47_qp.arrays import CountOrZero, Longest, Positive
from robo47_qp.model.obstacle import Obstacle
from robo47_qp.run.failure import Failure, StepFailed
from robo47_qp.run.steps import StepLike
from robo47_qp.run.task import Program, Task, option
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.goal import Goal, add_goal, estimate_goal_and_item, goal_pose, place_goal
from robo47_qp.tasks.handling.item_handler import HOME, LOST, ItemHandler
from robo47_qp.tasks.handling.place_criterion import END, PlaceCriterion, unfinished
from robo47_qp.tasks.heading import upright
from robo47_qp.tasks.item import BLUE, RED, Item, opening_for
from robo47_qp.tasks.table import TABLE_TOP, add_table, check_place

_AREA = ((0.35, 0.60), (-0.35, 0.35))
"""Ranges of x and y of random starts and goals [m]."""
_APART = 0.15
"""Least distance between random start and goal [m]."""
_SIDES, _HEIGHTS, _MASSES = (0.025, 0.072), (0.03, 0.08), (0.05, 0.5)
"""Sizes [m] and masses [kg] of random items."""
_OPENING = 0.012
"""Width by which the fingers open before the tool moves up from the item [m]."""
_OFF = 5e-3
"""Largest distance of the centre of mass of random items from the middle, per axis [m]."""


@dataclass(frozen=True, kw_only=True)
class PickPlace(Task):
    """Carry an item from `pick` to `place`; with a seed, both are drawn at random.

    The item counts as placed when its centre is within `place_tolerance` of the goal, it stands
    upright with the heading of the goal and is at rest, the gripper is open and the arm is home;
    see `PlaceCriterion`. A cube looks the same after a quarter turn, and so does its goal; one on
    its side is not placed.
    """

    pick: tuple[float, float] = option(
        (0.40, 0.20), "Where the item is picked without a seed: x, y [m].", drawn=True
    )
    place: tuple[float, float] = option(
        (0.40, -0.20), "Where the item is placed without a seed: x, y [m].", drawn=True
    )
    item: Item = Item(name="cube", size=(0.04, 0.04, 0.04), mass=0.1, rgba=RED)
    """The item."""
    grip_force: Positive = 30.0
    """Largest force of one finger on the item; see `Item.grip_force` [N]."""
    clearance: Positive = 0.12
    """Height of the tool above the item on the table before it descends and after it lifts [m]."""
    place_tolerance: Positive = 5e-3
    """Largest distance of the item from its goal [m]."""
    retries: CountOrZero = 2
    """Further attempts after a missed or lost grasp."""
    force_max: Longest = 60.0
    """See `Task.force_max` [N]."""
    obstacles: tuple[Obstacle, ...] = ()
    """Empty, as only the item stands on the table."""
    opening_needed: ClassVar[float | None] = 0.061
    name: str = "pick_place"

    def __post_init__(self) -> None:
        """Check the fields; see `Checked`."""
        super().__post_init__()
        check_place("pick", self.pick, self.item.size)
        check_place("place", self.place, self.item.size)

    @property
    def opening(self) -> float | None:
        """See `Task.opening` [m]."""
        return opening_for((self.item,), self.opening_needed)

    @cached_property
    def placed(self) -> PlaceCriterion:
        """When the item counts as placed."""
        return PlaceCriterion(distance=self.place_tolerance)

    @property
    def judged(self) -> Sequence[str]:
        """See `Task.judged`."""
        return (f"the {self.item.name}: {self.placed.pose_words}", self.placed.rest_words, END)

    def variant(self, rng: np.random.Generator) -> Self:
        """Return the task with a box or a cylinder of a random size, mass and centre of mass."""
        x, y = rng.uniform(*_SIDES, 2)
        height, mass = rng.uniform(*_HEIGHTS), rng.uniform(*_MASSES)
        if rng.random() < 0.5:
            item = Item(name="cylinder", size=(x, x, height), round=True, mass=mass, rgba=BLUE)
        else:
            item = Item(name="box", size=(x, y, height), mass=mass, rgba=RED)
        a, b, c = rng.uniform(-_OFF, _OFF, 3)
        return replace(self, item=replace(item, com=(a, b, c)))

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        """See `Task.build_scene`."""
        add_table(spec)
        self.item.add(spec, self._on_table(self.pick))
        add_goal(spec, self.item)
        PlaceCriterion.add_state(spec)

    def reset(self, simulation: Simulation, rng: np.random.Generator | None) -> None:
        """See `Task.reset`."""
        start, goal = np.array(self.pick), np.array(self.place)
        turn_start = turn_goal = 0.0
        if rng is not None:
            start, goal = _random_place(rng), _random_place(rng)
            while np.linalg.norm(goal - start) < _APART:
                goal = _random_place(rng)
            turn_start, turn_goal = rng.uniform(-np.pi, np.pi, 2)
        simulation.place_object(self.item.name, upright(self._on_table(start), turn_start))
        place_goal(simulation, goal, turn_goal)
        if rng is not None:
            self.item.draw_friction(simulation, rng)

    def preview(self, sensed: Sensed) -> Sequence[StepLike]:
        """See `Task.preview`."""
        hand, goal = self._handling(sensed), goal_pose(sensed, self.item)
        T_world_item = sensed.seen_pose(self.item.name)
        return [*hand.foreseen(T_world_item, goal), HOME]

    def program(self, sensed: Sensed) -> Program:
        """See `Task.program`."""
        hand = self._handling(sensed)
        goal, seen = yield from estimate_goal_and_item(sensed, self.item)
        for attempt in range(1 + self.retries):
            try:
                held = yield from hand.pick(None if attempt else seen)
                yield from hand.place(goal, held)
            except StepFailed as error:
                if error.failure.cause not in LOST:
                    raise
                yield from hand.back_off()
                if attempt == self.retries:
                    yield HOME
                    raise
            else:
                break
        yield hand.leave(sensed.tool_pose())
        return None

    def monitor(self, simulation: Simulation) -> None:
        """See `Task.monitor`."""
        self.placed.monitor(simulation, (self.item.name,))

    def verdict(self, simulation: Simulation) -> Failure | None:
        """See `Task.verdict`."""
        return self._goal(simulation).missed(self.placed) or unfinished(simulation)

    def measures(self, simulation: Simulation) -> dict[str, float]:
        """See `Goal.measures`."""
        return self._goal(simulation).measures()

    def _handling(self, sensed: Sensed) -> ItemHandler:
        resting = TABLE_TOP + 0.5 * self.item.height
        return ItemHandler(
            sensed=sensed,
            item=self.item,
            above=resting + self.clearance,
            force=self.item.grip_force(self.grip_force, sensed.sheet.acceleration),
            opening=_OPENING,
            resting=resting,
        )

    def _goal(self, simulation: Simulation) -> Goal:
        return Goal(simulation=simulation, item=self.item)

    def _on_table(self, where: Sequence[float] | np.ndarray) -> tuple[float, float, float]:
        return float(where[0]), float(where[1]), TABLE_TOP + 0.5 * self.item.height


def _random_place(rng: np.random.Generator) -> np.ndarray:
    return np.array([rng.uniform(*limits) for limits in _AREA])
