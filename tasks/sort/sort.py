"""Sort boxes and cylinders into two bins by colour."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.arrays import CountOrZero, Longest, Positive
from robo47_qp.errors import InvalidValueError
from robo47_qp.run.failure import Cause, Failure, StepFailed
from robo47_qp.run.steps import Release, StepLike
from robo47_qp.run.task import Program, Task
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.handling.item_handler import HOME, LOST, TO_GRASP, ItemHandler
from robo47_qp.tasks.handling.place_criterion import (
    END,
    Miss,
    PlaceCriterion,
    told,
    unfinished,
)
from robo47_qp.tasks.handling.pose_estimate import (
    GOOD_ENOUGH,
    at_height,
    camera_errs,
    coordinate_error,
    estimate_poses,
)
from robo47_qp.tasks.heading import end_tilt, heading, upright
from robo47_qp.tasks.item import BLUE, RED, Item, different, opening_for, upright_item
from robo47_qp.tasks.random_places import random_places
from robo47_qp.tasks.sort.bin import Bin
from robo47_qp.tasks.table import TABLE_TOP, add_table

_AREA = ((0.35, 0.60), (-0.17, 0.17))
"""Ranges of x and y of random items [m]."""
_APART = 0.11
"""Least distance between random items, so that the open fingers fit between them [m]."""
_START = ((0.36, -0.14), (0.36, 0.0), (0.36, 0.14), (0.54, -0.14), (0.54, 0.0), (0.54, 0.14))
"""Default positions of the items, x and y [m]."""
_SIDES, _HEIGHTS, _MASSES = (0.025, 0.045), (0.035, 0.05), (0.05, 0.3)
"""Sizes [m] and masses [kg] of random items."""
_LET_GO = 0.02
"""Width by which the fingers open in a bin [m]."""
_ROUGH = 2e-3
"""Accepted standard deviation of a coordinate of a held item: bins have room [m]."""
_ON_TABLE, _DEVIATIONS = 0.01, 3.0
"""How much higher than one that stands on the table an item may be seen and be taken to stand there
[m], and how many standard deviations of what the camera errs by beside [-]."""


@dataclass(frozen=True, kw_only=True)
class Sort(Task):
    """Put each item into the bin of its colour; with a seed, items are at random positions.

    An item is sorted when all of it is between the bin's walls, its centre below their rim, and it
    stands on an end and leans on nothing; the task succeeds when all are sorted and at rest, the
    gripper is open and the arm home.
    """

    items: tuple[Item, ...] = (
        Item(name="red box", size=(0.04, 0.04, 0.04), rgba=RED),
        Item(name="blue box", size=(0.03, 0.045, 0.04), rgba=BLUE),
        Item(name="red cylinder", size=(0.04, 0.04, 0.05), round=True, rgba=RED),
        Item(name="blue cylinder", size=(0.035, 0.035, 0.04), round=True, rgba=BLUE),
        Item(name="red bar", size=(0.045, 0.025, 0.035), rgba=RED),
        Item(name="blue bar", size=(0.025, 0.03, 0.05), rgba=BLUE),
    )
    """The items on the table; each has the colour of a bin."""
    bins: tuple[Bin, ...] = (
        Bin(name="red bin", centre=(0.45, 0.37), rgba=RED),
        Bin(name="blue bin", centre=(0.45, -0.37), rgba=BLUE),
    )
    """The bins."""
    grip_force: Positive = 30.0
    """Largest force of one finger; see `Item.grip_force` [N]."""
    above: Positive = 0.16
    """Height of the tool above the table before it descends and after it lifts [m]."""
    retries: CountOrZero = 4
    """Further attempts after an item was missed, lost or fell beside its bin."""
    force_max: Longest = 40.0
    """See `Task.force_max`; the hand touches no wall [N]."""
    name: str = "sort"
    opening_needed: ClassVar[float | None] = 0.046
    scene_stream: ClassVar[int | None] = 1

    def __post_init__(self) -> None:
        """Check the fields; see `Checked`.

        Raises:
            InvalidValueError: Two items have one name, an item has no bin, or a bin is too small
                for its items.
        """
        super().__post_init__()
        different(self.items)
        if not 1 <= len(self.items) <= len(_START):
            found = len(self.items)
            raise InvalidValueError("number of items", found, f"1 to {len(_START)}")
        for item in self.items:
            if item.rgba not in [b.rgba for b in self.bins]:
                raise InvalidValueError(f"colour of {item.name!r}", item.rgba, "that of a bin")
        for place in self.bins:
            count = sum(item.rgba == place.rgba for item in self.items)
            if count > len(place.slots):
                raise InvalidValueError(f"items for {place.name!r}", count, "one per slot at most")

    @property
    def opening(self) -> float | None:
        """See `Task.opening` [m]."""
        return opening_for(self.items, self.opening_needed)

    @cached_property
    def placed(self) -> PlaceCriterion:
        """When an item in its bin counts as at rest, and as standing."""
        return PlaceCriterion()

    @property
    def judged(self) -> Sequence[str]:
        """See `Task.judged`."""
        rim = 1e3 * min(place.height for place in self.bins)
        return (
            "each item: all of it between the walls of the bin of its colour, its centre below "
            f"the rim ({rim:g} mm), and its axis within {np.degrees(self.placed.tilt):.3g}° of the "
            "vertical, whichever end is up",
            f"all {self.placed.rest_words}",
            END,
        )

    def variant(self, rng: np.random.Generator) -> Self:
        """Return the task with boxes and cylinders of random sizes and masses."""
        items = []
        for item in self.items:
            x, y = rng.uniform(*_SIDES, 2)
            round_ = bool(rng.random() < 0.5)
            size = (x, x if round_ else y, rng.uniform(*_HEIGHTS))
            items.append(replace(item, size=size, round=round_, mass=rng.uniform(*_MASSES)))
        return replace(self, items=tuple(items))

    @property
    def time_limit(self) -> float:
        """See `Task.time_limit` [s]."""
        return 240.0

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        """See `Task.build_scene`."""
        add_table(spec)
        for place in self.bins:
            place.add(spec)
        for item, (x, y) in zip(self.items, _START, strict=False):
            item.add(spec, (x, y, TABLE_TOP + 0.5 * item.height))
        PlaceCriterion.add_state(spec)

    def reset(self, simulation: Simulation, rng: np.random.Generator | None) -> None:
        """See `Task.reset`."""
        places, turns = np.array(_START[: len(self.items)]), np.zeros(len(self.items))
        if rng is not None:
            places = random_places(rng, _AREA, len(self.items), _APART)
            turns = rng.uniform(-np.pi, np.pi, len(self.items))
        for item, (x, y), turn in zip(self.items, places, turns, strict=True):
            pose = upright([x, y, TABLE_TOP + 0.5 * item.height], turn)
            simulation.place_object(item.name, pose)
            if rng is not None:
                item.draw_friction(simulation, rng)

    def preview(self, sensed: Sensed) -> Sequence[StepLike]:
        """See `Task.preview`."""
        steps: list[StepLike] = []
        taken: list[tuple[float, float]] = []
        for item in self.items:
            T_world_item = sensed.seen_pose(item.name)
            hand = self._hand(sensed, item, T_world_item)
            slot = self._bin(item).free_slot(taken)
            taken.append(slot)
            grasp = item.grasp(T_world_item, sensed.gripper.width_max)
            steps += hand.foreseen(T_world_item, self._down(item, slot, grasp, T_world_item))
        return [*steps, HOME]

    def program(self, sensed: Sensed) -> Program:
        """See `Task.program`."""
        names = [item.name for item in self.items]
        left, good_enough = len(self.items) + self.retries, GOOD_ENOUGH
        while left:
            seen = yield from estimate_poses(sensed, names, good_enough)
            # What is still loose, and where there is room: one look, as well as a grasp calls for.
            good_enough = TO_GRASP
            loose = [
                item for item in self.items if not self._seen_in(sensed, item, seen[item.name])
            ]
            if not loose:
                break
            left -= 1
            item = loose[0]
            hand = self._hand(sensed, item, seen[item.name])
            others = [seen[other.name] for other in self.items if other is not item]
            try:
                yield from self._sort(hand, seen[item.name], others)
            except StepFailed as error:
                if error.failure.cause not in LOST:
                    raise
                yield from hand.back_off()
                if not left:
                    yield HOME
                    raise
            else:
                yield hand.retreat(sensed.tool_pose())
                yield Release(name="open gripper")
        yield HOME
        return None

    def monitor(self, simulation: Simulation) -> None:
        """See `Task.monitor`."""
        self.placed.monitor(simulation, [item.name for item in self.items])

    def verdict(self, simulation: Simulation) -> Failure | None:
        """See `Task.verdict`."""
        against = [self._against(simulation, item) for item in self.items]
        against.append(self.placed.against_rest(simulation, [item.name for item in self.items]))
        evidence = next((reason for reason in against if reason is not None), None)
        if evidence is not None:
            return Failure(cause=Cause.PLACE, evidence=evidence)
        return unfinished(simulation)

    def _against(self, simulation: Simulation, item: Item) -> str | None:
        """Return why an item does not lie in its bin; None if it does."""
        pose, home = simulation.object_pose(item.name), self._bin(item)
        reasons = []
        if not home.holds_all(item.as_in(simulation), pose):
            x, y, z = pose.translation()
            reasons.append(
                f"is at ({x:.3f}, {y:.3f}, {z:.3f}) m, and not all of it is in the "
                f"{home.name}: {home.room}"
            )
        off = Miss(distance=0.0, turn=0.0, tilt=end_tilt(pose))
        return told(f"the {item.name}", [*reasons, *self.placed.against_pose(off)])

    def measures(self, simulation: Simulation) -> dict[str, float]:
        """Return the number of items in their bins."""
        sorted_ = [self._is_in(item, simulation.object_pose(item.name)) for item in self.items]
        return {"sorted": float(sum(sorted_))}

    def _sort(
        self, hand: ItemHandler, seen: SE3, others: Sequence[SE3]
    ) -> Generator[StepLike, None, None]:
        """Pick an item that has just been seen and put it down in a free slot of its bin."""
        held = yield from hand.pick(seen)
        T_world_item = yield from hand.look_held(held, _ROUGH)
        taken = [(float(x), float(y)) for x, y, _ in (T.translation() for T in others)]
        slot = self._bin(hand.item).free_slot(taken)
        goal = self._down(hand.item, slot, hand.sensed.tool_pose(), T_world_item)
        yield from hand.place(goal, held)

    def _is_in(self, item: Item, T_world_item: SE3) -> bool:
        return self._bin(item).holds(T_world_item.translation())

    def _seen_in(self, sensed: Sensed, item: Item, T_world_item: SE3) -> bool:
        """Return whether an item that is seen at a pose is in its bin."""
        standing, _ = upright_item(item, T_world_item)
        height = self._resting(sensed, standing, T_world_item)
        return self._is_in(item, at_height(sensed, T_world_item, height))

    def _resting(self, sensed: Sensed, item: Item, T_world_item: SE3) -> float | None:
        """Return the height at which an item stands on the table [m]; None if it does not.

        What is off by no more than the camera errs stands there, and what is seen lower does, too:
        a hand that goes by the camera's height reaches into the table, or presses the item on it.
        """
        on_table = TABLE_TOP + 0.5 * item.height
        off = _DEVIATIONS * coordinate_error(sensed) if camera_errs(sensed) else 0.0
        higher = float(T_world_item.translation()[2]) - on_table
        return on_table if higher < _ON_TABLE + off else None

    def _bin(self, item: Item) -> Bin:
        return next(place for place in self.bins if place.rgba == item.rgba)

    def _hand(self, sensed: Sensed, item: Item, T_world_item: SE3) -> ItemHandler:
        item, turn = upright_item(item, T_world_item)
        return ItemHandler(
            sensed=sensed,
            item=item,
            above=TABLE_TOP + self.above,
            force=item.grip_force(self.grip_force, sensed.sheet.acceleration),
            opening=_LET_GO,
            good_enough=_ROUGH,
            resting=self._resting(sensed, item, T_world_item),
            T_item_standing=turn,
        )

    def _down(
        self, item: Item, slot: tuple[float, float], T_world_tcp: SE3, T_world_item: SE3
    ) -> SE3:
        """Return the pose of an item that stands in a slot, the fingers across the bin."""
        up = TABLE_TOP + 0.5 * item.height
        return upright([*slot, up], heading(T_world_item) - heading(T_world_tcp))
