"""One arm picks a bar and gives it to the other in the air, which puts it down."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.arrays import CountOrZero, Positive
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.tool_poses import ToolPoses
from robo47_qp.motion.waypoint import Motion, Waypoint, tool_down
from robo47_qp.run.contact_steps import Guarded
from robo47_qp.run.failure import Cause, Failure, StepFailed
from robo47_qp.run.steps import Move, Release, StepLike
from robo47_qp.run.task import Program, Task, option
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.goal import Goal, add_goal, estimate_item_goal, place_goal
from robo47_qp.tasks.handling.hand import Hand, closed_on, settled
from robo47_qp.tasks.handling.held_item import HeldItem
from robo47_qp.tasks.handling.item_handler import HOME, LET_GO, LOST, NEAR
from robo47_qp.tasks.handling.place_criterion import END, PlaceCriterion, unfinished
from robo47_qp.tasks.handling.pose_estimate import camera_errs, estimate_pose
from robo47_qp.tasks.heading import heading, level, raised, upright
from robo47_qp.tasks.item import BLUE, Item
from robo47_qp.tasks.table import TABLE_TOP, add_table, check_place
from robo47_qp.tasks.task_state import task_state

_X, _Y = (0.40, 0.55), (0.18, 0.30)
"""Ranges of x and |y| of random starts, in front of the first arm, and goals [m]."""
_TURN = 0.6
"""Largest heading of random starts and goals [rad]."""
_THICK, _LONG, _MASSES = (0.02, 0.045), (0.20, 0.26), (0.05, 0.3)
"""Sizes [m] and masses [kg] of random bars."""
_AIR = (0.48, 0.0, 0.35)
"""Where the bar is handed over [m]."""
_ASIDE, _HIGHER, _AIR_TURN = 0.03, 0.05, 0.2
"""Ranges about it of a random place [m] and heading [rad]."""
_MARGIN = 0.025
"""Distance of a hand's middle from the end of the bar [m]."""
_LOWEST = 0.014
"""Least height of a tool point above the table [m]."""
_ABOVE = 0.12
"""Height above a grasp from which a hand descends [m]."""
_TOUCH = 3.0
"""Change of the force at the wrist by which a bar that is lowered touches the table [N]."""
_TAKE_UP = 0.015
"""Height of the first lift [m]."""


@dataclass(frozen=True, kw_only=True)
class Handover(Task):
    """The left arm picks a bar, both hold it in the air, and the right arm puts it at the goal.

    It counts as done when the bar is at rest at its goal, both hands held it at the same time
    above `height_min`, the grippers are open and the arms are home.
    """

    default_robot: ClassVar[str] = "panda_pair"
    tools_needed: ClassVar[int] = 2
    opening_needed: ClassVar[float | None] = 0.052

    start: tuple[float, float] = option(
        (0.45, 0.24), "Start of the bar without a seed: x, y [m].", drawn=True
    )
    end: tuple[float, float] = option(
        (0.45, -0.24), "Its goal without a seed: x, y [m].", drawn=True
    )
    bar: Item = Item(name="bar", size=(0.03, 0.22, 0.03), mass=0.15, rgba=BLUE, friction=(0.5, 0.9))
    """The bar; it is held at both ends of its y axis."""
    grip_force: Positive = 40.0
    """Force of one finger on the bar [N]."""
    height_min: Positive = 0.2
    """Least height of the bar above the table where it changes hands [m]."""
    place_tolerance: Positive = 5e-3
    """Largest distance of the bar from its goal [m]."""
    retries: CountOrZero = 2
    """Further attempts after a missed or lost grasp."""
    name: str = "handover"

    def __post_init__(self) -> None:
        """Check the fields; see `Checked`.

        Raises:
            InvalidValueError: The bar is too short for two hands, or too thick for one.
        """
        super().__post_init__()
        check_place("start", self.start, self.bar.size)
        check_place("end", self.end, self.bar.size)
        if self.bar.size[1] < _LONG[0] or self.bar.size[0] > 0.07:
            expected = f"at most 0.07 m along x and at least {_LONG[0]} m along y"
            raise InvalidValueError("size of the bar", self.bar.size, expected)

    @cached_property
    def placed(self) -> PlaceCriterion:
        """When the bar counts as placed."""
        return PlaceCriterion(distance=self.place_tolerance)

    @property
    def judged(self) -> Sequence[str]:
        """See `Task.judged`."""
        return (
            f"the {self.bar.name}: {self.placed.pose_words}",
            self.placed.rest_words,
            f"both hands held it at the same time, its centre above {self.height_min:g} m",
            END,
        )

    def variant(self, rng: np.random.Generator) -> Self:
        """Return the task with a bar of a random size and mass."""
        x, z = rng.uniform(*_THICK, 2)
        size = (x, rng.uniform(*_LONG), max(z, 0.025))
        return replace(self, bar=replace(self.bar, size=size, mass=rng.uniform(*_MASSES)))

    @property
    def time_limit(self) -> float:
        """See `Task.time_limit` [s]."""
        return 120.0

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        """See `Task.build_scene`."""
        add_table(spec)
        self.bar.add(spec, (*self.start, TABLE_TOP + 0.5 * self.bar.height))
        add_goal(spec, self.bar)
        _add_marker(spec, self.bar)
        PlaceCriterion.add_state(spec, 1)

    def reset(self, simulation: Simulation, rng: np.random.Generator | None) -> None:
        """See `Task.reset`."""
        task_state(simulation)[:] = 0.0
        start, end, air = np.array(self.start), np.array(self.end), np.array(_AIR)
        turns = np.zeros(3)
        if rng is not None:
            start = np.array([rng.uniform(*_X), rng.uniform(*_Y)])
            end = np.array([rng.uniform(*_X), -rng.uniform(*_Y)])
            air = air + rng.uniform(-1.0, 1.0, 3) * [_ASIDE, _ASIDE, _HIGHER]
            turns = rng.uniform(-1.0, 1.0, 3) * [_TURN, _TURN, _AIR_TURN]
        up = TABLE_TOP + 0.5 * self.bar.height
        simulation.place_object(self.bar.name, upright([*start, up], turns[0]))
        place_goal(simulation, end, turns[1])
        simulation.place_marker(_MEETING, upright([*air], turns[2]))

    def preview(self, sensed: Sensed) -> Sequence[StepLike]:
        """See `Task.preview`."""
        left, right = self._hands(sensed)
        T_world_bar = sensed.seen_pose(self.bar.name)
        first = self._grasp(T_world_bar, 1.0)
        T_bar_left = T_world_bar.inverse() @ first
        meeting = sensed.seen_pose(_MEETING)
        second = self._grasp(meeting, -1.0)
        return [
            Waypoint(name="approach", target=left.target(raised(first, _ABOVE))),
            left.line("descend", first),
            left.line("lift", raised(first, _ABOVE)),
            self._meet((left, right), meeting @ T_bar_left, second),
            right.line("reach", second),
            HOME,
        ]

    def program(self, sensed: Sensed) -> Program:
        """See `Task.program`."""
        for attempt in range(1 + self.retries):
            try:
                yield from self._attempt(sensed)
            except StepFailed as error:
                if error.failure.cause not in LOST or attempt == self.retries:
                    raise
                yield from self._back_off(sensed)
            else:
                break
        yield HOME
        return None

    def monitor(self, simulation: Simulation) -> None:
        """See `Task.monitor`: note that both hands hold the bar in the air."""
        self.placed.monitor(simulation, (self.bar.name,))
        high = simulation.object_pose(self.bar.name).translation()[2]
        # Its true one, which may differ from what is told.
        width = 2.0 * float(simulation.model.geom(self.bar.name).size[0])
        if high > TABLE_TOP + self.height_min and all(
            closed_on(simulation, tool, width, self.grip_force) for tool in (0, 1)
        ):
            task_state(simulation)[0] = 1.0

    def verdict(self, simulation: Simulation) -> Failure | None:
        """See `Task.verdict`."""
        missed = Goal(simulation=simulation, item=self.bar).missed(self.placed)
        if missed is None and not task_state(simulation)[0]:
            evidence = f"the hands never held the bar together above {self.height_min:.2f} m"
            missed = Failure(cause=Cause.PLACE, evidence=evidence)
        return missed or unfinished(simulation)

    def measures(self, simulation: Simulation) -> dict[str, float]:
        """Return the errors of the bar's pose, and whether it changed hands."""
        errors = Goal(simulation=simulation, item=self.bar).measures()
        return {**errors, "handed_over": float(task_state(simulation)[0])}

    def _attempt(self, sensed: Sensed) -> Generator[StepLike, None, None]:
        left, right = self._hands(sensed)
        goal = yield from estimate_item_goal(sensed, self.bar)
        bar, held = yield from self._pick(sensed, left)
        held = yield from self._give(sensed, bar, _HeldBar(hand=left, held=held))
        yield from self._put_down(sensed, bar, _HeldBar(hand=right, held=held), level(goal))

    def _pick(self, sensed: Sensed, left: Hand) -> Generator[StepLike, None, tuple[Item, HeldItem]]:
        """Pick the bar with the left hand.

        Returns:
            It with the mass that was measured, and what is known of it in the hand.
        """
        resting = TABLE_TOP + 0.5 * self.bar.height
        T_world_bar = yield from estimate_pose(sensed, self.bar.name, resting)
        grasp = self._grasp(T_world_bar, 1.0)
        yield Waypoint(name="approach", target=left.target(raised(grasp, _ABOVE)))
        yield left.line("descend", grasp)
        free = 0.0 if sensed.weights_known else (yield from left.felt())
        yield from left.grasp(self.bar.size[0], self.grip_force)
        bar, T_tcp_bar = self.bar, grasp.inverse() @ T_world_bar
        there, since = left.pose().inverse() @ T_world_bar, sensed.time
        held = (left.holds(bar.size[0], self.grip_force, Cause.DROP),)
        taken_up = raised(left.pose(), _TAKE_UP)
        # On no line: a bar of unknown weight pulls the hand off it.
        up = Waypoint(
            name="take up",
            target=left.target(taken_up),
            carried={left.name: bar.payload(T_tcp_bar)},
        )
        yield Move(waypoints=(up,), after=held)
        if not sensed.weights_known:
            mass = yield from left.weigh(free)
            bar = replace(bar, mass=max(mass, 0.1 * bar.mass))
            yield from settled(replace(up, carried={left.name: bar.payload(T_tcp_bar)}))
        lift = left.line("lift", raised(taken_up, _ABOVE - _TAKE_UP))
        lift = replace(lift, carried={left.name: bar.payload(T_tcp_bar)})
        yield Move(waypoints=(lift,), during=held, after=held)
        return bar, HeldItem(above=None, mass=bar.mass, T_tcp_item=there, since=since)

    def _give(
        self, sensed: Sensed, bar: Item, held_bar: "_HeldBar"
    ) -> Generator[StepLike, None, HeldItem]:
        """Bring the bar and the right hand together, and change hands.

        Returns:
            What is known of the bar in the right hand.
        """
        left, right = self._hands(sensed)
        width, force = bar.size[0], self.grip_force
        held = (left.holds(width, force, Cause.DROP),)
        T_world_bar = yield from held_bar.look(sensed, bar)
        T_bar_left = T_world_bar.inverse() @ left.pose()
        carried = {left.name: bar.payload(T_bar_left.inverse())}
        meeting = sensed.seen_pose(_MEETING)
        meet = replace(
            self._meet((left, right), meeting @ T_bar_left, self._grasp(meeting, -1.0)),
            carried=carried,
        )
        yield Move(waypoints=(meet,), during=held, after=held)
        T_world_bar = yield from held_bar.look(sensed, bar)
        grasp = self._grasp(T_world_bar, -1.0)
        reach = replace(right.line("reach", grasp), carried=carried)
        yield Move(waypoints=(reach,), during=held)
        yield from right.grasp(width, force)
        there, since = right.pose().inverse() @ T_world_bar, sensed.time
        yield from left.release("let go")
        carried = {right.name: bar.payload(right.pose().inverse() @ T_world_bar)}
        away = replace(left.line("leave", raised(left.pose(), _ABOVE)), carried=carried)
        taken = (right.holds(width, force, Cause.DROP),)
        yield Move(waypoints=(away,), before=taken, during=taken, after=taken)
        return HeldItem(above=None, mass=bar.mass, T_tcp_item=there, since=since)

    def _put_down(
        self, sensed: Sensed, bar: Item, held_bar: "_HeldBar", T_world_goal: SE3
    ) -> Generator[StepLike, None, None]:
        """Put the bar at its goal with the right hand; the left one goes home meanwhile."""
        right, errs = held_bar.hand, camera_errs(sensed)
        taken = (right.holds(bar.size[0], self.grip_force, Cause.DROP),)
        near = raised(T_world_goal, NEAR) if errs else T_world_goal
        lower, goal = yield from held_bar.lower(sensed, bar, near)
        over = Waypoint(
            name="carry",
            target=right.target(raised(goal, _ABOVE)),
            carried=lower.carried,
            onward=(lower,),
        )
        yield Move(waypoints=(over,), during=taken, after=taken)
        yield Move(waypoints=(lower,), during=taken)
        if errs:
            # Beside its goal, both are seen with the same error of the camera's calibration.
            lower, _ = yield from held_bar.lower(sensed, bar, raised(T_world_goal, LET_GO))
            # Its far end hangs lower than the camera tells.
            yield Guarded(waypoint=lower, force=_TOUCH, missing=None, tool=right.name)
        yield from right.release("put down")
        yield right.line("retreat", raised(right.pose(), _ABOVE))

    def _back_off(self, sensed: Sensed) -> Generator[StepLike, None, None]:
        """Open both hands and go up."""
        hands = self._hands(sensed)
        for hand in hands:
            yield Release(tool=hand.name)
        for hand in hands:
            if hand.pose().translation()[2] < 0.3:
                yield hand.line("back off", raised(hand.pose(), _ABOVE))
        yield HOME

    def _hands(self, sensed: Sensed) -> tuple[Hand, Hand]:
        left, right = (tool.name for tool in sensed.robot.tools[:2])
        return (
            Hand(sensed=sensed, name=left),
            Hand(sensed=sensed, name=right),
        )

    def _grasp(self, T_world_bar: SE3, side: float) -> SE3:
        """Return T_world_tcp of a hand from above at an end of the bar, 1 or -1 along its y."""
        reach = side * (0.5 * self.bar.size[1] - _MARGIN)
        x, y, z = T_world_bar.apply(np.array([0.0, reach, 0.0]))
        return tool_down([x, y, max(z, TABLE_TOP + _LOWEST)], heading(T_world_bar) + np.pi / 2)

    def _meet(self, hands: Sequence[Hand], T_world_left: SE3, grasp: SE3) -> Waypoint:
        """Return the waypoint at which the bar is in the air and the right hand above it."""
        left, right = (hand.name for hand in hands)
        poses = {left: T_world_left, right: raised(grasp, _ABOVE)}
        ways = {right: grasp, left: raised(T_world_left, _ABOVE)}
        onward = tuple(
            Waypoint(name=f"{hand} onward", motion=Motion.LIN, target=ToolPoses({hand: goal}))
            for hand, goal in ways.items()
        )
        return Waypoint(name="meet", target=ToolPoses(poses), onward=onward)


@dataclass(frozen=True, kw_only=True, eq=False)
class _HeldBar:
    """The bar in a hand, in which it may turn about the axis of the fingers."""

    hand: Hand
    held: HeldItem

    def look(self, sensed: Sensed, bar: Item) -> Generator[StepLike, None, SE3]:
        """Return T_world_bar as it is seen, at the height at which the hand is known to be.

        Where the fingers hide it, it is taken to be in the hand as it was grasped.
        """
        seen = yield from estimate_pose(sensed, bar.name)
        if self.held.hidden(sensed, bar.name):
            return self.hand.pose() @ self.held.T_tcp_item
        place = self.held.T_tcp_item.inverse().translation()
        x, y, _ = seen.translation()
        height = self.hand.pose().translation()[2] - seen.rotation().apply(place)[2]
        at = np.array([x, y, height]) if camera_errs(sensed) else seen.translation()
        return SE3.from_rotation_and_translation(seen.rotation(), at)

    def lower(
        self, sensed: Sensed, bar: Item, T_world_goal: SE3
    ) -> Generator[StepLike, None, tuple[Waypoint, SE3]]:
        """Return the way down to a goal, by a look at the bar, and T_world_tcp at its end."""
        T_world_bar = yield from self.look(sensed, bar)
        T_bar_tcp = T_world_bar.inverse() @ self.hand.pose()
        goal = T_world_goal @ T_bar_tcp
        carried = {self.hand.name: bar.payload(T_bar_tcp.inverse())}
        return replace(self.hand.line("lower", goal), carried=carried), goal


_MEETING = "meeting"
"""Marker where the bar changes hands."""


def _add_marker(spec: mujoco.MjSpec, bar: Item) -> None:
    body = spec.worldbody.add_body(name=_MEETING, mocap=True)
    body.add_geom(
        name=_MEETING,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[0.5 * length for length in bar.size],
        rgba=[0.15, 0.55, 0.30, 0.15],
        contype=0,
        conaffinity=0,
    )
