"""BeltPicker: the steps that pick an item from a moving belt."""

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from mink import SE3
from scipy.interpolate import BPoly

from robo47_qp.model.gripper import Grip
from robo47_qp.motion.waypoint import Motion, Waypoint
from robo47_qp.run.failure import Cause, Condition, StepFailed
from robo47_qp.run.follow_step import Follow
from robo47_qp.run.steps import Move, StepLike, Wait
from robo47_qp.sim.sensed import Sensed
from robo47_qp.tasks.handling.compliant_grasp import width_around
from robo47_qp.tasks.handling.grasp_check import GraspCheck
from robo47_qp.tasks.handling.held_item import HeldItem
from robo47_qp.tasks.handling.item_handler import UNPLANNED
from robo47_qp.tasks.handling.object_tracker import ObjectTracker
from robo47_qp.tasks.handling.pose_estimate import camera_errs
from robo47_qp.tasks.heading import heading, raised
from robo47_qp.tasks.item import Item, turned_about_vertical

_AHEAD = 1.8
"""Time given to the arm to reach the meeting point [s]."""
_LEAD = 0.4
"""Least time before the meeting at which the tool starts to move, and after it until it has the
item's velocity [s]."""
_LONGEST = 30.0
"""Longest time to wait for an item [s]."""
_WAY = 0.8
"""Duration of the descent to the item, and of the lift [s]."""
_STOPS = 0.4
"""Time in which a tool that lifts the item comes to rest along the belt [s]."""
_NEAR, _ALIGNED = 1.5e-3, 0.02
"""Errors of position [m] and orientation [rad] below which the tool is on its target."""
_LACKS, _TURNS = 0.4, 0.4
"""Part of the rise that a lift may lack where joints end, and angle by which it may end turned
[rad]: the item is off the belt."""

_CLOSING = 1.5
"""Longest time in which fingers close at their full speed [s]."""
_CLOSED = 0.8
"""Usual time in which they close [s]."""
_GENTLY = 0.03
"""Rate of the opening width where one finger touches the item before the other [m/s]."""
_AROUND = 4.5
"""Standard deviations of the camera's errors by which fingers come down beside the item: there is
no second look."""
_PATIENCE = 2.0
"""Longest time to reach the target after the planned end [s]."""

Target = Callable[[float], SE3]
"""Function of time [s] that returns T_world_tcp."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BeltPicker:
    """Picks an item that moves horizontally at a constant velocity, with the tool pointing down."""

    sensed: Sensed
    item: Item
    tracker: ObjectTracker
    rise: float
    """Height above the grasp at which the tool waits and follows [m]."""
    force: float
    """Force of one finger [N]."""

    def watch(self) -> Generator[StepLike, None, None]:
        """Observe the item until its velocity is known."""
        yield from self.tracker.watch()

    def meeting(self) -> SE3:
        """Return T_world_item at the earliest time at which the tool can be there."""
        return self.tracker.at(self.sensed.time + _AHEAD)

    def wait_above(self, T_world_item: SE3) -> Waypoint:
        """Return the waypoint above the pose at which the item will be met."""
        return Waypoint(name="meet", target=raised(self._grasp(T_world_item), self.rise))

    def catch(self, first: float) -> Generator[StepLike, None, HeldItem]:
        """Meet the item, follow it, close the fingers on it and lift it.

        Fails with TIMEOUT if the tool does not keep up, with GRASP if the fingers do not hold the
        item, and with DROP if it is lost during the lift.

        Args:
            first: The y in the world from which on the item is in reach [m].
        """
        y, speed = self.meeting().translation()[1], float(self.tracker.velocity[1])
        late = _AHEAD + max(0.0, (first - y) / speed)
        meet = self.sensed.time + late
        waits = raised(self._kept(self.tracker.at(meet)), self.rise)
        above = Waypoint(name="meet", target=waits)
        tracked = (self._tracked(self.tracker.update),)
        try:
            foreseen = replace(above, onward=self._onward(meet))
            yield Move(waypoints=(foreseen,), during=tracked)
        except StepFailed as error:
            if error.failure.cause not in UNPLANNED:
                raise
            # Not every place on that way may be in reach; the item may be held before.
            yield Move(waypoints=(above,), during=tracked)
        yield Wait(name="wait", seconds=_LONGEST, until=self._comes(meet))
        start = self.sensed.time
        end = start + 2.0 * max(meet - start, _LEAD)
        follow = self._follow("follow", self._setting_out(waits, start, meet, end), end)
        yield replace(follow, during=(self._tracked(self.tracker.collect),))
        end = self.sensed.time + _WAY
        descend = self._follow("descend", self._with_item(_eased(end, self.rise, 0.0)), end)
        descend = replace(descend, during=(self._tracked(self.tracker.update_smoothly),))
        close, seconds = Grip(width=0.0, force=self.force), _CLOSING
        if camera_errs(self.sensed):
            T_world_item = self.tracker.at(self.sensed.time)
            near = width_around(self.sensed, self.item, T_world_item, _AROUND)
            descend = replace(descend, grip=replace(close, width=near))
            close = replace(close, speed=_GENTLY)
            seconds += (near - min(self.item.size[:2])) / _GENTLY
        yield descend
        still = self._with_item(lambda _: 0.0)
        yield Follow(
            name="close gripper",
            target=still,
            grip=close,
            until=self._check.condition(Cause.GRASP),
            during=(self._check.around(Cause.GRASP),),
            seconds=seconds,
        )
        return (yield from self._lift())

    def _lift(self) -> Generator[StepLike, None, HeldItem]:
        """Lift the item that the fingers hold off the belt; fails with DROP or TIMEOUT."""
        tool = self._tool()
        T_world_item = self.tracker.at(self.sensed.time)
        T_tcp_item, since = tool.inverse() @ T_world_item, self.sensed.time
        end = self.sensed.time + _WAY
        lift = self._follow("lift", self._lifting(end), end, _LACKS * self.rise, _TURNS)
        held = (self._check.condition(Cause.DROP),)
        yield replace(lift, carried=self.item.payload(T_tcp_item), after=held)
        height = float(T_world_item.translation()[2] - tool.translation()[2])
        return HeldItem(above=height, mass=self.item.mass, T_tcp_item=T_tcp_item, since=since)

    def _follow(
        self, name: str, target: Target, end: float, near: float = _NEAR, aligned: float = _ALIGNED
    ) -> Follow:
        """Return a step that follows a target, whose motion is steady from `end` on [s].

        Args:
            name: Name of the step.
            target: T_world_tcp over time.
            end: When it is there [s].
            near: How near to the target it is then [m].
            aligned: And how well turned [rad].
        """
        seconds = end - self.sensed.time + _PATIENCE
        until = self._there(target, end, near, aligned)
        return Follow(name=name, target=target, until=until, seconds=seconds)

    def _tool(self) -> SE3:
        return self.sensed.tool_pose()

    @cached_property
    def _first(self) -> SE3:
        """T_world_item when the grasp was chosen."""
        return self.tracker.at(self.sensed.time)

    def _kept(self, T_world_item: SE3) -> SE3:
        """Return T_world_tcp that grasps the item by the sides that were chosen first.

        Of one that is seen a little otherwise, other sides may be as near.
        """
        turn = self.item.same_heading(heading(T_world_item) - heading(self._first))
        where = self._grasp(T_world_item).translation()
        return turned_about_vertical(self._grasp(self._first), turn, where)

    def _grasp(self, T_world_item: SE3) -> SE3:
        return self.item.grasp(T_world_item, self.sensed.gripper.width_max)

    def _with_item(self, height: Callable[[float], float]) -> Target:
        """Return T_world_tcp over time, at a height above the grasp of the moving item."""
        return lambda time: raised(self._kept(self.tracker.at(time)), height(time))

    def _onward(self, meet: float) -> tuple[Waypoint, ...]:
        """Return the ways along the belt and down that follow the meeting at a time [s]: the joints
        are to have room for them."""
        there = self._kept(self.tracker.at(meet + 2.0 * _LEAD + _WAY + _CLOSED))
        ways = {"along": raised(there, self.rise), "down": there}
        return tuple(
            Waypoint(name=name, target=pose, motion=Motion.LIN) for name, pose in ways.items()
        )

    def _setting_out(self, waits: SE3, start: float, meet: float, end: float) -> Target:
        """Return T_world_tcp over time, from rest at the meeting point until it follows the item.

        The time at which the item's pose is taken runs from standstill to real time, by a
        polynomial of degree 5 with continuous acceleration. By another one fades what the meeting
        point, at which the tool `waits`, is off from where it is known to be by now.
        """
        clock = BPoly.from_derivatives([start, end], [[meet, 0.0, 0.0], [end, 1.0, 0.0]])
        fade = BPoly.from_derivatives([start, end], [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
        above = raised(self._kept(self.tracker.at(meet)), self.rise)
        off = (above.inverse() @ waits).log()

        def target(time: float) -> SE3:
            if time >= end:
                return raised(self._kept(self.tracker.at(time)), self.rise)
            when, left = float(clock(max(time, start))), float(fade(max(time, start)))
            there = raised(self._kept(self.tracker.at(when)), self.rise)
            return there @ SE3.exp(left * off)

        return target

    def _lifting(self, end: float) -> Target:
        """Return a target that rises with the item within `_WAY`, and comes to rest meanwhile.

        The time at which the item's pose is taken runs from real time to standstill, half as far as
        it would have gone within `_STOPS`.
        """
        start, height = end - _WAY, _eased(end, 0.0, self.rise)
        rest, stands = start + _STOPS, start + 0.5 * _STOPS
        clock = BPoly.from_derivatives([start, rest], [[start, 1.0, 0.0], [stands, 0.0, 0.0]])

        def target(time: float) -> SE3:
            when = float(clock(np.clip(time, start, rest)))
            return raised(self._kept(self.tracker.at(when)), height(time))

        return target

    def _tracked(self, look: Callable[[], object]) -> Condition:
        """Return a condition that always holds, and sees more of the item meanwhile."""

        def against() -> None:
            look()

        return Condition(
            name=f"the {self.item.name} is tracked",
            cause=Cause.TIMEOUT,
            against=against,
        )

    def _comes(self, meet: float) -> Condition:
        def against() -> str | None:
            self.tracker.update()
            left = meet - self.sensed.time
            return None if left <= _LEAD else f"the {self.item.name} is {left:.2f} s away"

        return Condition(name="the item comes", cause=Cause.TIMEOUT, against=against)

    def _there(self, target: Target, end: float, near: float, aligned: float) -> Condition:
        def against() -> str | None:
            left = end - self.sensed.time
            if left > 0.0:
                return f"{left:.2f} s are left"
            T = target(self.sensed.time).inverse() @ self._tool()
            off = float(np.linalg.norm(T.translation()))
            turned = float(np.linalg.norm(T.rotation().log()))
            if off <= near and turned <= aligned:
                return None
            return f"the tool is {1e3 * off:.1f} mm and {turned:.3f} rad from where it should be"

        return Condition(name="the tool keeps up", cause=Cause.TIMEOUT, against=against)

    @property
    def _check(self) -> GraspCheck:
        sensed, item = self.sensed, self.item
        return GraspCheck(
            sensed=sensed,
            item=item,
            force=self.force,
            standing=lambda: sensed.seen_pose(item.name),
            settled=True,
        )


def _eased(end: float, before: float, after: float) -> Callable[[float], float]:
    """Return a height over time that changes smoothly within `_WAY`."""
    course = BPoly.from_derivatives([end - _WAY, end], [[before, 0.0, 0.0], [after, 0.0, 0.0]])
    return lambda time: float(course(np.clip(time, end - _WAY, end)))
