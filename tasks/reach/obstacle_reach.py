"""Reach behind a post and under a shelf without touching them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import mujoco
import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Positive
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.obstacle import Obstacle, Shape, add_obstacle
from robo47_qp.motion.waypoint import Waypoint, tool_down
from robo47_qp.run.failure import Failure
from robo47_qp.run.steps import StepLike
from robo47_qp.run.task import Program, Task
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.handling.hold_criterion import HOME_WORDS, STILL, HoldCriterion
from robo47_qp.tasks.handling.item_handler import HOME
from robo47_qp.tasks.heading import upright
from robo47_qp.tasks.table import TABLE, TABLE_TOP, add_table, check_place

_BOARD = (0.12, 0.18, 0.01)
"""Half lengths of the shelf's board: outwards, across and up [m]."""


@dataclass(frozen=True, kw_only=True)
class ObstacleReach(Task):
    """Hold the tool behind a post and under a shelf, and go home.

    The positions of post and shelf are part of the scene; a seed draws the targets near them. A
    target is reached when the tool is held within `position_tolerance` and `turn_tolerance` of it
    for `seconds` at rest; its marker is then hidden.
    """

    post: tuple[float, float] = (0.38, -0.22)
    """Position of the post, x and y [m]."""
    post_radius: Positive = 0.04
    """Radius of the post [m]."""
    post_height: Positive = 0.40
    """Height of the post [m]."""
    shelf: tuple[float, float] = (0.45, 0.35)
    """Position of the shelf's centre, x and y [m]; it opens towards the robot."""
    shelf_height: Positive = 0.50
    """Height of the shelf's lower side [m]."""
    post_distance: tuple[float, float] = (0.36, 0.42)
    """Least and largest distance from the origin at which a seed puts the post [m]."""
    shelf_distance: tuple[float, float] = (0.55, 0.60)
    """Least and largest distance from the origin at which a seed puts the shelf [m]."""
    behind: Positive = 0.22
    """Default distance of the target behind the centre of the post [m]."""
    position_tolerance: Positive = 1e-3
    """Largest position error of a held tool [m]."""
    turn_tolerance: Positive = np.radians(0.5)
    """Largest orientation error of a held tool [rad]."""
    seconds: Positive = 0.5
    """Time for which each target is held [s]."""
    force_max: Positive = 1.0
    """Largest contact force: nothing may be touched [N]."""
    name: str = "obstacle_reach"
    goals_asked_for: ClassVar[bool] = True
    scene_stream: ClassVar[int | None] = 2

    def __post_init__(self) -> None:
        """Check the fields; see `Checked`."""
        super().__post_init__()
        check_place("post", self.post)
        check_place("shelf", self.shelf)
        for name in ("post_distance", "shelf_distance"):
            found = getattr(self, name)
            if len(found) != 2 or not 0.0 < found[0] <= found[1] < np.inf:
                expected = "two numbers above 0, the least and the largest distance [m]"
                raise InvalidValueError(name, found, expected)

    @property
    def obstacles(self) -> Sequence[Obstacle]:
        """The table, the post, and the shelf: a board and the panel that supports it."""
        radius, half = self.post_radius, 0.5 * self.post_height
        out, across, up = _BOARD
        T_world_shelf = upright([*self.shelf, TABLE_TOP], _azimuth(self.shelf))
        half_panel = 0.5 * self.shelf_height + up
        return (
            TABLE,
            Obstacle(
                name="post",
                shape=Shape.CYLINDER,
                size=(radius, half),
                T_world_obstacle=SE3.from_translation(np.array([*self.post, TABLE_TOP + half])),
            ),
            Obstacle(
                name="shelf",
                shape=Shape.BOX,
                size=_BOARD,
                T_world_obstacle=T_world_shelf @ _at(0.0, 0.0, self.shelf_height + up),
            ),
            Obstacle(
                name="panel",
                shape=Shape.BOX,
                size=(0.01, across, half_panel),
                T_world_obstacle=T_world_shelf @ _at(out + 0.01, 0.0, half_panel),
            ),
        )

    def variant(self, rng: np.random.Generator) -> Self:
        """Return the task with a random post and shelf, one to the left and one to the right."""
        side = 1.0 if rng.random() < 0.5 else -1.0
        post = _polar(rng.uniform(*self.post_distance), -side * rng.uniform(0.35, 0.75))
        shelf = _polar(rng.uniform(*self.shelf_distance), side * rng.uniform(0.55, 0.95))
        return replace(
            self,
            post=post,
            shelf=shelf,
            post_radius=rng.uniform(0.03, 0.05),
            post_height=rng.uniform(0.35, 0.45),
            shelf_height=rng.uniform(0.45, 0.60),
        )

    @property
    def judged(self) -> Sequence[str]:
        """See `Task.judged`."""
        return self._held.words, HOME_WORDS

    @property
    def time_limit(self) -> float:
        """See `Task.time_limit` [s]."""
        return 120.0

    @property
    def usual_time(self) -> float:
        """See `Task.usual_time` [s]."""
        return 12.0

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        """See `Task.build_scene`."""
        add_table(spec)
        HoldCriterion.add_state(spec)
        for obstacle in self.obstacles:
            if obstacle is not TABLE:
                add_obstacle(spec, obstacle).rgba = [0.45, 0.50, 0.58, 1.0]
        for name in self._targets:
            body = spec.worldbody.add_body(name=name, mocap=True)
            for i, (x, y, z) in enumerate(np.eye(3) * 0.02 + 0.002):
                body.add_geom(
                    type=mujoco.mjtGeom.mjGEOM_BOX,
                    pos=[x if i == 0 else 0.0, y if i == 1 else 0.0, z if i == 2 else 0.0],
                    size=[x, y, z],
                    rgba=[*(0.8 * np.eye(3)[i] + 0.1), 1.0],
                    contype=0,
                    conaffinity=0,
                )

    def reset(self, simulation: Simulation, rng: np.random.Generator | None) -> None:
        """See `Task.reset`."""
        HoldCriterion.reset(simulation)
        behind, height, turn = self.behind, 0.15, 0.0
        depth, drop, pitch = 0.07, 0.23, 0.6
        if rng is not None:
            behind, height = rng.uniform(0.20, 0.26), rng.uniform(0.08, 0.20)
            turn = rng.uniform(-0.5, 0.5)
            depth, drop = rng.uniform(0.04, 0.10), rng.uniform(0.20, 0.26)
            pitch = rng.uniform(0.5, 0.8)
        post, shelf = _azimuth(self.post), _azimuth(self.shelf)
        x, y = _polar(float(np.hypot(*self.post)) + behind, post)
        down = tool_down([x, y, TABLE_TOP + height], post + turn)
        x, y = _polar(float(np.hypot(*self.shelf)) - _BOARD[0] + depth, shelf)
        # From straight down, the tool is raised until its z points out and `pitch` down.
        raised = SO3.from_y_radians(pitch - 0.5 * np.pi) @ SO3.from_x_radians(np.pi)
        under = SE3.from_rotation_and_translation(
            SO3.from_z_radians(shelf) @ raised,
            np.array([x, y, TABLE_TOP + self.shelf_height - drop]),
        )
        for name, pose in zip(self._targets, (down, under), strict=True):
            simulation.place_marker(name, pose)

    def preview(self, sensed: Sensed) -> Sequence[StepLike]:
        """See `Task.preview`."""
        return [*(self._reach(sensed, name) for name in self._targets), HOME]

    def program(self, sensed: Sensed) -> Program:
        """See `Task.program`."""
        for name in self._targets:
            hold = self._held.hold(sensed, name)
            yield self._reach(sensed, name)
            yield hold
        yield HOME
        return None

    def monitor(self, simulation: Simulation) -> None:
        """See `Task.monitor`."""
        self._held.monitor(simulation, self._targets)

    def verdict(self, simulation: Simulation) -> Failure | None:
        """See `Task.verdict`."""
        return self._held.verdict(simulation, self._targets)

    def measures(self, simulation: Simulation) -> dict[str, float]:
        """Return the number of remaining targets [-] and the largest joint distance from home
        [rad]."""
        return self._held.measures(simulation, self._targets)

    @property
    def _held(self) -> HoldCriterion:
        return HoldCriterion(
            position_tolerance=self.position_tolerance,
            turn_tolerance=self.turn_tolerance,
            seconds=self.seconds,
            speed=STILL,
        )

    @property
    def _targets(self) -> tuple[str, str]:
        return "behind post", "under shelf"

    def _reach(self, sensed: Sensed, name: str) -> Waypoint:
        return Waypoint(name=f"reach {name}", target=sensed.seen_pose(name))


def _at(x: float, y: float, z: float) -> SE3:
    return SE3.from_translation(np.array([x, y, z]))


def _azimuth(where: tuple[float, float]) -> float:
    """Return the heading from the robot's base to a position on the table [rad]."""
    return float(np.arctan2(where[1], where[0]))


def _polar(radius: float, azimuth: float) -> tuple[float, float]:
    return float(radius * np.cos(azimuth)), float(radius * np.sin(azimuth))
