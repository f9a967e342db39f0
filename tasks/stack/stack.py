"""Stack three cubes at a goal."""

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
from robo47_qp.run.steps import StepLike
from robo47_qp.run.task import Program, Task, option
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.goal import GOAL, YELLOW, add_goal, marked_goal, place_goal, seen_goal
from robo47_qp.tasks.handling.item_handler import HOME, LOST, ItemHandler
from robo47_qp.tasks.handling.place_criterion import (
    END,
    Miss,
    PlaceCriterion,
    told,
    unfinished,
)
from robo47_qp.tasks.handling.pose_estimate import estimate_pose, estimate_poses
from robo47_qp.tasks.heading import heading, tilt, upright
from robo47_qp.tasks.item import BLUE, GREEN, RED, Item, different, opening_for, upright_item
from robo47_qp.tasks.random_places import random_places
from robo47_qp.tasks.stack.tower import Tower
from robo47_qp.tasks.table import TABLE_TOP, add_table, check_place

_AREA = ((0.35, 0.60), (-0.35, 0.35))
"""Ranges of x and y of random cubes [m]."""
_GOALS = ((0.40, 0.55), (-0.25, 0.25))
"""Ranges of x and y of random goals [m]."""
_APART, _CLEAR = 0.11, 0.19
"""Least distance between random cubes, and from the goal: the hand is 0.2 m wide and must not reach
over the tower during a pick [m]."""
_GRID = 15
"""Places for a cube that is put aside, along x and y [-]."""
_START = ((0.40, 0.22), (0.52, 0.12), (0.40, 0.0))
"""Default positions of the cubes, x and y [m]."""
_MASSES = (0.05, 0.2)
"""Range of the mass of random cubes [kg]."""
_EDGES = (0.035, 0.05)
"""Range of the edge of random cubes [m]."""


@dataclass(frozen=True, kw_only=True)
class Stack(Task):
    """Stack cubes on top of each other; with a seed, they and the goal are drawn at random.

    Any cube may be at any level, with its top up. The tower stands when every level has a cube
    whose centre is within `tolerance` of the goal's vertical and `height_tolerance` of its own
    height, which is level and has the heading of the goal by quarter turns, all at rest, the
    gripper open and the arm home.
    """

    cubes: tuple[Item, ...] = tuple(
        Item(name=name, size=(0.04, 0.04, 0.04), mass=0.1, rgba=rgba)
        for name, rgba in (("red cube", RED), ("green cube", GREEN), ("blue cube", BLUE))
    )
    """The cubes, all of one edge length."""
    goal: tuple[float, float] = option(
        (0.45, -0.20), "Where the tower stands without a seed: x, y [m].", drawn=True
    )
    tolerance: Positive = 5e-3
    """Largest horizontal distance of each cube's centre from the goal's vertical [m]."""
    height_tolerance: Positive = 2e-3
    """Largest error of the height of each centre [m]."""
    grip_force: Positive = 30.0
    """Largest force of one finger; see `Item.grip_force` [N]."""
    clearance: Positive = 0.06
    """Clearance between the tower and a cube that is carried over it [m]."""
    retries: CountOrZero = 4
    """Further attempts after a cube was missed, lost or knocked down."""
    force_max: Longest = 60.0
    """See `Task.force_max` [N]."""
    opening_needed: ClassVar[float | None] = 0.051
    name: str = "stack"

    def __post_init__(self) -> None:
        """Check the fields; see `Checked`.

        Raises:
            InvalidValueError: They are not two or three cubes of one edge, or two have one name.
        """
        super().__post_init__()
        edges = {length for cube in self.cubes for length in cube.size}
        few = not 2 <= len(self.cubes) <= len(_START)
        if few or len(edges) != 1 or any(cube.round for cube in self.cubes):
            found = [cube.size for cube in self.cubes]
            raise InvalidValueError("cubes", found, f"2 to {len(_START)} cubes of one edge")
        different(self.cubes)
        check_place("goal", self.goal, self.cubes[0].size)

    @property
    def opening(self) -> float | None:
        """See `Task.opening` [m]."""
        return opening_for(self.cubes, self.opening_needed)

    @property
    def edge(self) -> float:
        """Edge length of the cubes [m]."""
        return self.cubes[0].height

    @cached_property
    def placed(self) -> PlaceCriterion:
        """When a cube counts as placed; positions are judged by the tolerances of the tower."""
        return PlaceCriterion(distance=self.tolerance)

    @property
    def judged(self) -> Sequence[str]:
        """See `Task.judged`."""
        placed = self.placed
        return (
            f"each cube: its centre within {1e3 * self.tolerance:g} mm of the goal's vertical and "
            f"{1e3 * self.height_tolerance:g} mm of its height, its heading within "
            f"{np.degrees(placed.turn):.3g}° of the goal's by quarter turns, and its axis "
            f"within {np.degrees(placed.tilt):.3g}° of the vertical, with its top up",
            f"all {placed.rest_words}",
            END,
        )

    def variant(self, rng: np.random.Generator) -> Self:
        """Return the task with cubes of a random edge and mass."""
        edge, mass = rng.uniform(*_EDGES), rng.uniform(*_MASSES)
        cubes = tuple(replace(cube, size=(edge,) * 3, mass=mass) for cube in self.cubes)
        return replace(self, cubes=cubes)

    @property
    def time_limit(self) -> float:
        """See `Task.time_limit` [s]."""
        return 240.0

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        """See `Task.build_scene`."""
        add_table(spec)
        for cube, where in zip(self.cubes, _START, strict=False):
            cube.add(spec, (*where, TABLE_TOP + 0.5 * self.edge))
        add_goal(spec, self.cubes[0], YELLOW)
        PlaceCriterion.add_state(spec)

    def reset(self, simulation: Simulation, rng: np.random.Generator | None) -> None:
        """See `Task.reset`."""
        goal, places = np.array(self.goal), np.array(_START[: len(self.cubes)])
        turns = np.zeros(1 + len(self.cubes))
        if rng is not None:
            goal = np.array([rng.uniform(*limits) for limits in _GOALS])
            places = random_places(rng, _AREA, len(self.cubes), _APART, (goal, _CLEAR))
            turns = rng.uniform(-np.pi, np.pi, len(turns))
        place_goal(simulation, goal, turns[-1])
        for cube, (x, y), turn in zip(self.cubes, places, turns, strict=False):
            height = TABLE_TOP + 0.5 * self.edge
            simulation.place_object(cube.name, upright([x, y, height], turn))
            if rng is not None:
                cube.draw_friction(simulation, rng)

    def preview(self, sensed: Sensed) -> Sequence[StepLike]:
        """See `Task.preview`."""
        steps: list[StepLike] = []
        tower = self._tower(seen_goal(sensed))
        for level, cube in enumerate(self.cubes):
            T_world_cube = sensed.seen_pose(cube.name)
            hand = self._hand(sensed, tower, cube, T_world_cube)
            steps += hand.foreseen(T_world_cube, tower.level(level))
        return [*steps, HOME]

    def program(self, sensed: Sensed) -> Program:
        """See `Task.program`."""
        tower = self._tower((yield from estimate_pose(sensed, GOAL)))
        left = len(self.cubes) + self.retries
        while left:
            seen = yield from estimate_poses(sensed, [cube.name for cube in self.cubes])
            loose = tower.loose(seen)
            if not loose:
                break
            left -= 1
            cube = next(cube for cube in self.cubes if cube.name == loose[0])
            hand = self._hand(sensed, tower, cube, seen[cube.name])
            try:
                yield from self._add(hand, tower, seen)
            except StepFailed as error:
                if error.failure.cause not in LOST:
                    raise
                yield from hand.back_off()
                if not left:
                    yield HOME
                    raise
            else:
                yield hand.retreat(sensed.tool_pose())
        yield HOME
        return None

    def monitor(self, simulation: Simulation) -> None:
        """See `Task.monitor`."""
        self.placed.monitor(simulation, [cube.name for cube in self.cubes])

    def verdict(self, simulation: Simulation) -> Failure | None:
        """See `Task.verdict`."""
        order = sorted(self.cubes, key=lambda c: simulation.object_pose(c.name).translation()[2])
        against, below = list[str | None](), 0.0
        for level, cube in enumerate(order):
            edge = cube.as_in(simulation).height
            against.append(self._against(simulation, cube, level, below + 0.5 * edge))
            below += edge
        against.append(self.placed.against_rest(simulation, [cube.name for cube in order]))
        evidence = next((reason for reason in against if reason is not None), None)
        if evidence is not None:
            return Failure(cause=Cause.PLACE, evidence=evidence)
        return unfinished(simulation)

    def measures(self, simulation: Simulation) -> dict[str, float]:
        """Return the largest horizontal distance of a cube from the goal's vertical [m], and the
        largest heading error and tilt of a cube [rad]."""
        goal = marked_goal(simulation)
        poses = [simulation.object_pose(cube.name) for cube in self.cubes]
        off = [pose.translation() - goal.translation() for pose in poses]
        return {
            "stack_error_m": float(max(np.hypot(x, y) for x, y, _ in off)),
            "stack_turn_rad": max(self._turn(pose, goal) for pose in poses),
            "stack_tilt_rad": max(tilt(pose) for pose in poses),
        }

    def _against(self, simulation: Simulation, cube: Item, level: int, height: float) -> str | None:
        """Return why a cube is not in its place at a level of the tower; None if it is.

        Args:
            simulation: The world.
            cube: The cube.
            level: How many are below it.
            height: Where its centre is to be above the table, by the sizes in this world [m].
        """
        goal, pose = marked_goal(simulation), simulation.object_pose(cube.name)
        x, y, z = pose.translation() - goal.translation()
        off, rise = float(np.hypot(x, y)), float(z - height)
        reasons = []
        if off > self.tolerance:
            reasons.append(
                f"is {1e3 * off:.1f} mm beside the goal (allowed are {1e3 * self.tolerance:g} mm)"
            )
        if abs(rise) > self.height_tolerance:
            reasons.append(
                f"is {1e3 * rise:+.1f} mm off its height "
                f"(allowed are {1e3 * self.height_tolerance:g} mm)"
            )
        turned = Miss(distance=0.0, turn=self._turn(pose, goal), tilt=tilt(pose))
        reasons += self.placed.against_pose(turned)
        return told(f"the {cube.name}, number {level + 1} from below,", reasons)

    def _turn(self, T_world_cube: SE3, T_world_goal: SE3) -> float:
        """Return the heading error of a cube [rad]."""
        return abs(self.cubes[0].same_heading(heading(T_world_cube) - heading(T_world_goal)))

    def _add(
        self, hand: ItemHandler, tower: Tower, seen: dict[str, SE3]
    ) -> Generator[StepLike, None, None]:
        """Put a cube on the tower, or back where it was if the tower has changed meanwhile.

        Where another loose cube is in the way, this one, which may have been on top, goes aside.
        """
        held = yield from hand.pick()
        before = tower.standing(seen)
        now = yield from estimate_poses(hand.sensed, before)
        goal = tower.level(len(before))
        if tower.taken(seen, hand.item.name):
            goal = self._aside(tower, seen, hand.item.name)
        elif tower.standing(now) != before:
            T_world_cube = hand.stood(seen[hand.item.name])
            x, y, _ = T_world_cube.translation()
            goal = upright([x, y, tower.height(tower.storey(T_world_cube))], heading(T_world_cube))
        yield from hand.place(goal, held)

    def _aside(self, tower: Tower, seen: dict[str, SE3], name: str) -> SE3:
        """Return a pose on the table for a cube: the nearest one clear of tower and cubes."""
        goal = tower.T_world_goal.translation()[:2]
        others = [T.translation()[:2] for cube, T in seen.items() if cube != name]
        grid = np.array([(x, y) for x in _grid(*_AREA[0]) for y in _grid(*_AREA[1])])
        away = np.linalg.norm(grid - goal, axis=1)
        clear = away >= _CLEAR
        for other in others:
            clear &= np.linalg.norm(grid - other, axis=1) >= _APART
        # Three cubes never fill the area.
        x, y = grid[np.where(clear, away, np.inf).argmin()]
        return upright([x, y, tower.height(0)], heading(seen[name]))

    def _hand(self, sensed: Sensed, tower: Tower, cube: Item, T_world_cube: SE3) -> ItemHandler:
        top = tower.height(len(self.cubes) - 1)
        item, turn = upright_item(cube, T_world_cube)
        return ItemHandler(
            sensed=sensed,
            item=item,
            above=top + self.clearance,
            force=item.grip_force(self.grip_force, sensed.sheet.acceleration),
            resting=tower.height(tower.storey(T_world_cube)),
            T_item_standing=turn,
        )

    def _tower(self, T_world_goal: SE3) -> Tower:
        return Tower(edge=self.edge, T_world_goal=T_world_goal)


def _grid(low: float, high: float) -> np.ndarray:
    return np.linspace(low, high, _GRID)
