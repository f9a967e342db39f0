"""Pick a cube from a moving belt and put it beside the belt."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import mujoco
import numpy as np

from robo47_qp.arrays import CountOrZero, Positive
from robo47_qp.errors import InvalidValueError
from robo47_qp.run.failure import Cause, Failure, StepFailed
from robo47_qp.run.steps import Release, StepLike, Wait
from robo47_qp.run.task import Program, Task
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.conveyor_pick.belt_picker import BeltPicker
from robo47_qp.tasks.goal import Goal, add_goal, estimate_item_goal, goal_pose, place_goal
from robo47_qp.tasks.handling.item_handler import HOME, LOST, ItemHandler
from robo47_qp.tasks.handling.object_tracker import ObjectTracker
from robo47_qp.tasks.handling.place_criterion import END, PlaceCriterion, unfinished
from robo47_qp.tasks.heading import upright
from robo47_qp.tasks.item import RED, Item, opening_for
from robo47_qp.tasks.table import SURFACE_FRICTION, TABLE_TOP, add_table, check_place

_BELT = (0.09, 0.60, 0.015)
"""Half lengths of the belt: across, along the y axis, and up [m]."""
_BELT_X = 0.55
"""Centre of the belt [m]."""
_SPEEDS, _LATERAL = (0.05, 0.20), 0.05
"""Ranges of random speeds [m/s] and of positions across the belt [m]."""
_AREA = ((0.28, 0.36), (-0.25, 0.25))
"""Ranges of x and y of random goals [m]."""
_START = 0.50
"""Distance upstream of the belt's centre at which the cube starts [m]."""
_FIRST, _LAST = -0.30, 0.20
"""Earliest and latest position along the belt, from its centre, where the cube is met [m]."""
_STARTS = 0.15
"""Time in which the cube is accelerated to the speed of the belt [s]."""

_STOPPED = 0.1
"""Share of the belt's speed below which the cube has stopped, however noisy the camera is [-]."""


@dataclass(frozen=True, kw_only=True)
class ConveyorPick(Task):
    """Pick the cube from the belt and put it on the goal; with a seed, all is drawn at random.

    The belt's speed belongs to the scene. The cube counts as placed as in `PickPlace`.
    """

    speed: float = 0.12
    """Speed of the belt along the world's y axis; negative for the other direction [m/s]."""
    goal: tuple[float, float] = (0.32, 0.0)
    """Goal of the cube's centre on the table, x and y [m]."""
    item: Item = Item(name="cube", size=(0.04, 0.04, 0.04), mass=0.1, rgba=RED)
    """The cube."""
    grip_force: Positive = 30.0
    """Force of a finger on the item [N]."""
    clearance: Positive = 0.10
    """Height of the waiting and following tool above the grasp [m]."""
    place_tolerance: Positive = 5e-3
    """Largest distance of the cube from its goal [m]."""
    retries: CountOrZero = 2
    """Further attempts while the cube is in reach."""
    force_max: Positive = 60.0
    """See `Task.force_max`."""
    name: str = "conveyor_pick"
    opening_needed: ClassVar[float | None] = 0.05
    scene_stream: ClassVar[int | None] = 2

    def __post_init__(self) -> None:
        """Check the fields; see `Checked`."""
        super().__post_init__()
        check_place("goal", self.goal, self.item.size)
        if not (np.isfinite(self.speed) and 0.0 < abs(self.speed) <= _SPEEDS[1]):
            raise InvalidValueError("speed", self.speed, f"up to {_SPEEDS[1]} m/s, and not 0")

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
        """Return the task with a belt of a random speed in a random direction."""
        speed = rng.uniform(*_SPEEDS)
        return replace(self, speed=speed if rng.random() < 0.5 else -speed)

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        """See `Task.build_scene`."""
        add_table(spec)
        belt = spec.worldbody.add_geom(
            name="belt",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[_BELT_X, 0.0, TABLE_TOP + _BELT[2]],
            size=_BELT,
            friction=SURFACE_FRICTION,
            rgba=[0.22, 0.24, 0.27, 1.0],
        )
        # Its surface runs and takes along by friction what lies on it; the geom stands still.
        belt.surfacevel = [0.0, self.speed, 0.0, 0.0, 0.0, 0.0]
        self.item.add(spec, self._on_belt(0.0))
        add_goal(spec, self.item)
        PlaceCriterion.add_state(spec)

    def reset(self, simulation: Simulation, rng: np.random.Generator | None) -> None:
        """See `Task.reset`."""
        lateral, goal = 0.0, np.array(self.goal)
        turn_start = turn_goal = 0.0
        if rng is not None:
            lateral = rng.uniform(-_LATERAL, _LATERAL)
            goal = np.array([rng.uniform(*limits) for limits in _AREA])
            turn_start, turn_goal = rng.uniform(-np.pi, np.pi, 2)
        simulation.place_object(self.item.name, upright(self._on_belt(lateral), turn_start))
        place_goal(simulation, goal, turn_goal)
        if rng is not None:
            self.item.draw_friction(simulation, rng)

    def preview(self, sensed: Sensed) -> Sequence[StepLike]:
        """See `Task.preview`."""
        hand, goal = self._handling(sensed), goal_pose(sensed, self.item)
        x, _, z = sensed.seen_pose(self.item.name).translation()
        T_world_item = upright([x, 0.0, z], 0.0)
        grasp = self.item.grasp(T_world_item, sensed.gripper.width_max)
        return [
            self._picker(sensed).wait_above(T_world_item),
            hand.carry(grasp, T_world_item, goal),
            hand.lower(grasp, T_world_item, goal),
            Release(),
            hand.retreat(hand.release_pose(grasp, T_world_item, goal)),
            HOME,
        ]

    def program(self, sensed: Sensed) -> Program:
        """See `Task.program`."""
        hand = self._handling(sensed)
        yield Wait(name="the belt starts", seconds=_STARTS)
        for attempt in range(1 + self.retries):
            picker = self._picker(sensed)
            try:
                yield from picker.watch()
                gone = self._gone(picker)
                if gone is not None:
                    yield HOME
                    return gone
                held = yield from picker.catch(self._first)
                goal = yield from estimate_item_goal(sensed, self.item)
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
        yield hand.retreat(sensed.tool_pose())
        yield HOME
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
        above = TABLE_TOP + 2.0 * _BELT[2] + 0.5 * self.item.height + self.clearance
        return ItemHandler(
            sensed=sensed,
            item=self.item,
            above=above,
            force=self.item.grip_force(self.grip_force, sensed.sheet.acceleration),
        )

    def _picker(self, sensed: Sensed) -> BeltPicker:
        return BeltPicker(
            sensed=sensed,
            item=self.item,
            rise=self.clearance,
            force=self.item.grip_force(self.grip_force, sensed.sheet.acceleration),
            tracker=ObjectTracker(sensed, self.item.name, self._on_belt(0.0)[2]),
        )

    @property
    def _first(self) -> float:
        """Return the earliest y in the world where the cube can be met [m]."""
        return float(np.sign(self.speed) * _FIRST)

    def _gone(self, picker: BeltPicker) -> Failure | None:
        """Return why the cube cannot be met any more; None if it can."""
        way = np.sign(self.speed)
        if way * picker.tracker.velocity[1] < _STOPPED * abs(self.speed):
            evidence = f"the {self.item.name} does not move along with the belt"
            return Failure(cause=Cause.TIMEOUT, evidence=evidence)
        along = way * picker.meeting().translation()[1]
        if along <= _LAST:
            return None
        return Failure(
            cause=Cause.TIMEOUT,
            evidence=f"the {self.item.name} will be {along:.2f} m along the belt when the tool can "
            f"be there; it is met up to {_LAST:.2f} m",
        )

    def _goal(self, simulation: Simulation) -> Goal:
        return Goal(simulation=simulation, item=self.item)

    def _on_belt(self, lateral: float) -> tuple[float, float, float]:
        start = -np.sign(self.speed) * _START
        return _BELT_X + lateral, start, TABLE_TOP + 2.0 * _BELT[2] + 0.5 * self.item.height
