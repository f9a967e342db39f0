"""BeltPicker: the steps that take an item from where it moves."""

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace

import numpy as np
from mink import SE3
from scipy.interpolate import BPoly

from robo47_qp.model.gripper import Grip
from robo47_qp.motion.waypoint import Waypoint
from robo47_qp.run.failure import Cause, Condition
from robo47_qp.run.follow_step import Follow
from robo47_qp.run.steps import StepLike, Wait
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.handling.grasp_check import GraspCheck
from robo47_qp.tasks.handling.object_tracker import ObjectTracker
from robo47_qp.tasks.item import Item

_AHEAD = 1.8
"""Time that the arm is given to be at the meeting point [s]."""
_LEAD = 0.25
"""How long before the item is there the tool sets out; as long after, it goes with it [s]."""
_LONGEST = 30.0
"""How long to wait for an item at most [s]."""
_WAY = 0.8
"""Time of the way down to the item, and of the way up with it [s]."""
_NEAR, _ALIGNED = 1.5e-3, 0.02
"""How close the tool is to where it should be before it goes on [m] and [rad]."""

_PATIENCE = 2.0
"""How long the tool may take to be where it should be [s]."""

Target = Callable[[float], SE3]
"""T_world_tcp at a time."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BeltPicker:
    """Catches one item that moves level and steadily, with the tool pointing down."""

    simulation: Simulation
    item: Item
    tracker: ObjectTracker
    rise: float
    """Height above the grasp at which the tool waits and follows [m]."""
    force: float
    """Of one finger [N]."""

    def watch(self) -> Generator[StepLike, None, None]:
        """Look until the item's motion is known."""
        yield from self.tracker.watch()

    def meeting(self) -> SE3:
        """T_world_item when the tool can be there at the earliest."""
        return self.tracker.at(self.simulation.time + _AHEAD)

    def wait_above(self, T_world_item: SE3) -> Waypoint:
        """Where the tool waits for an item that will come to a pose."""
        return Waypoint(name="meet", target=_raised(self._grasp(T_world_item), self.rise))

    def catch(self, first: float) -> Generator[StepLike, None, None]:
        """Meet it, go with it, close the fingers on it and lift it.

        It fails with TIMEOUT where the tool does not keep up, with GRASP where the fingers do
        not hold it and with DROP where it gets lost on the way up.

        Args:
            first: The y from which on it is in reach, in the world [m].
        """
        y, speed = self.meeting().translation()[1], float(self.tracker.velocity[1])
        late = _AHEAD + max(0.0, (first - y) / speed)
        meet = self.simulation.time + late
        yield self.wait_above(self.tracker.at(meet))
        yield Wait(name="wait", seconds=_LONGEST, until=self._comes(meet))
        start = self.simulation.time
        end = start + 2.0 * max(meet - start, _LEAD)
        yield self._follow("follow", self._setting_out(start, meet, end), end)
        end = self.simulation.time + _WAY
        yield self._follow("descend", self._eased(end, self.rise, 0.0), end)
        still = self._with_item(lambda _: 0.0)
        yield Follow(
            name="close gripper",
            target=still,
            grip=Grip(width=0.0, force=self.force),
            until=self._held(Cause.GRASP),
            seconds=1.5,
        )
        T_tcp_item = self._tool().inverse() @ self.simulation.seen_pose(self.item.name)
        end = self.simulation.time + _WAY
        lift = self._follow("lift", self._eased(end, 0.0, self.rise), end)
        held = (self._held(Cause.DROP),)
        yield replace(lift, carried=self.item.payload(T_tcp_item), after=held)

    def _follow(self, name: str, target: Target, end: float) -> Follow:
        """Follow a target that does not change its ways any more from some time on."""
        seconds = end - self.simulation.time + _PATIENCE
        return Follow(name=name, target=target, until=self._there(target, end), seconds=seconds)

    def _tool(self) -> SE3:
        return self.simulation.tool_pose()

    def _grasp(self, T_world_item: SE3) -> SE3:
        return self.item.grasp(T_world_item, self.simulation.gripper.width_max)

    def _with_item(self, height: Callable[[float], float]) -> Target:
        """T_world_tcp over time, at a height above where it grasps the item."""
        return lambda time: _raised(self._grasp(self.tracker.at(time)), height(time))

    def _setting_out(self, start: float, meet: float, end: float) -> Target:
        """T_world_tcp over time: from rest where the item will be, until it goes with the item.

        The tool is where it belongs at a time of the item that stands still at first and runs on
        as it should in the end, by the polynomial of degree 5 without a jump in acceleration.
        """
        clock = BPoly.from_derivatives([start, end], [[meet, 0.0, 0.0], [end, 1.0, 0.0]])

        def target(time: float) -> SE3:
            when = float(clock(max(time, start))) if time < end else time
            return _raised(self._grasp(self.tracker.at(when)), self.rise)

        return target

    def _eased(self, end: float, before: float, after: float) -> Target:
        """With the item, and in `_WAY` from one height to another, without such a jump."""
        course = BPoly.from_derivatives([end - _WAY, end], [[before, 0.0, 0.0], [after, 0.0, 0.0]])
        return self._with_item(lambda time: float(course(np.clip(time, end - _WAY, end))))

    def _comes(self, meet: float) -> Condition:
        def against() -> str | None:
            self.tracker.update()
            left = meet - self.simulation.time
            return None if left <= _LEAD else f"the {self.item.name} is {left:.2f} s away"

        return Condition(name="the item comes", cause=Cause.TIMEOUT, against=against)

    def _there(self, target: Target, end: float) -> Condition:
        def against() -> str | None:
            left = end - self.simulation.time
            if left > 0.0:
                return f"{left:.2f} s are left"
            T = target(self.simulation.time).inverse() @ self._tool()
            off = float(np.linalg.norm(T.translation()))
            turned = float(np.linalg.norm(T.rotation().log()))
            if off <= _NEAR and turned <= _ALIGNED:
                return None
            return f"the tool is {1e3 * off:.1f} mm and {turned:.3f} rad from where it should be"

        return Condition(name="the tool keeps up", cause=Cause.TIMEOUT, against=against)

    def _held(self, cause: Cause) -> Condition:
        sim, item = self.simulation, self.item
        hold = GraspCheck(
            simulation=sim,
            item=item,
            force=self.force,
            standing=lambda: sim.seen_pose(item.name),
            settled=True,
        )
        return hold.condition(cause)


def _raised(T_world_tcp: SE3, height: float) -> SE3:
    return SE3.from_translation(np.array([0.0, 0.0, height])) @ T_world_tcp
