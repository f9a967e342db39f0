"""ItemHandler: the steps that pick an item and place it."""

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from mink import SE3

from robo47_qp.model.gripper import Grip
from robo47_qp.model.payload import Payload
from robo47_qp.motion.waypoint import Motion, Place, Waypoint
from robo47_qp.run.contact_steps import Guarded
from robo47_qp.run.failure import Cause, Condition, StepFailed
from robo47_qp.run.steps import Grasp, Move, Release, StepLike, Wait
from robo47_qp.sim.sensed import Sensed
from robo47_qp.tasks.handling.compliant_grasp import compliant_grasp
from robo47_qp.tasks.handling.grasp_check import GraspCheck
from robo47_qp.tasks.handling.held_item import HeldItem
from robo47_qp.tasks.handling.mass_measurement import measure_mass
from robo47_qp.tasks.handling.pose_estimate import (
    GOOD_ENOUGH,
    at_height,
    camera_errs,
    estimate_pose,
)
from robo47_qp.tasks.handling.wrist import FreeWrist, read_free_wrist
from robo47_qp.tasks.heading import heading, raised
from robo47_qp.tasks.item import Item, turned_about_vertical

LOST = frozenset({Cause.GRASP, Cause.SLIP, Cause.DROP})
"""Causes of failure after which the item is looked for and picked again."""
UNPLANNED = frozenset({Cause.IK, Cause.PLAN})
"""Causes of failure before a step has started to move."""
_ROUGH, TO_GRASP = 4e-3, 1.5e-3
"""Accepted standard deviations of a coordinate: on the way, and of what is to be grasped [m]."""
NEAR = 0.012
"""Height above its goal at which a held item is looked at once more [m]."""
LET_GO = 0.5e-3
"""Height above its goal at which an item is released where it is seen with errors [m]: an arm that
presses it down is pushed aside by more than it errs while it is free."""
_TIPS, _SLOWLY, _LANDED, _SHORT = 0.02, 0.025, 5.0, 3e-3
"""Height of the tool above an item below which fingers come slowly around it [m], how fast [m/s],
the force that stops them [N], and how far from the grasp that is too early [m]."""
_PADS, _WENT = 0.01, 4e-3
"""Half the width of usual fingers, and how far an item goes that they squeeze out, at least [m]."""
SETTLE = 0.25
"""Time in which an arm comes back from where it was pushed [s]."""
_AROUND = 0.001
"""Distance of each finger from an item whose pose is known, on the way down to it [m]."""
HOME = Waypoint(name="home", target=Place.HOME)


@dataclass(frozen=True, kw_only=True, eq=False)
class ItemHandler:
    """Picks and places one item, with the tool pointing down."""

    tips: ClassVar[bool] = False
    """Whether the item tips over easily; see `compliant_grasp`."""

    sensed: Sensed
    item: Item
    above: float
    """Height of the tool before it descends and after it lifts, in the world [m]."""
    force: float = 30.0
    """Force of one finger [N]."""
    opening: float | None = None
    """Width by which the fingers open to release the item [m]; None opens them fully."""
    resting: float | None = None
    """Known height of the item's centre in the world before it is picked [m]; None takes the
    camera's, which may be noisy."""
    good_enough: float = GOOD_ENOUGH
    """Accepted standard deviation of a coordinate of the item beside its goal [m]."""
    across: float = 0.0
    """Turn from the sides of the item that suit the wrist to those that are grasped [rad]."""
    T_item_standing: SE3 | None = None
    """Rotation of an item that has tipped over, from its own frame to that of `item`, with z up."""
    in_hand: HeldItem | None = None
    """What is known of the item while it is held, which fingers may hide from the camera."""

    def pick(self, seen: SE3 | None = None) -> Generator[StepLike, None, HeldItem]:
        """Locate, approach, grasp and lift the item; fails with GRASP, or DROP during the lift.

        An item that the fingers miss is grasped along its other sides, if it is slender enough: the
        camera errs by the same again, but fingers that close along that error centre the item.
        They are brought to where it has gone when it was missed; see `_beside`.

        Args:
            seen: T_world_item as it has just been estimated; None looks at it.
        """
        if seen is None:
            before = yield from self._look(self.resting, TO_GRASP)
        else:
            before = self.stood(at_height(self.sensed, seen, self.resting))
        try:
            return (yield from self._pick(before))
        except StepFailed as error:
            missed = error.failure.cause is Cause.GRASP and camera_errs(self.sensed)
            other = replace(self, across=0.5 * np.pi)
            if not missed or self.across or not other._fits():
                raise
        yield from self.back_off()
        seen = yield from self._look(self.resting, TO_GRASP)
        beside = self._beside(before, seen)
        try:
            return (yield from other._pick(beside @ seen))
        except StepFailed as error:
            if error.failure.cause not in UNPLANNED:
                raise
        # The wrist does not turn so far that way.
        yield from self.back_off()
        seen = yield from self._look(self.resting, TO_GRASP)
        return (yield from replace(self, across=-other.across)._pick(beside @ seen))

    def _beside(self, before: SE3, after: SE3) -> SE3:
        """Return the translation from where the camera sees an item that was missed to where it is.

        What fingers squeeze out goes to the side on which it was, off the middle by at least half
        their width.

        Args:
            before: Where it was seen when it was missed.
            after: Where it is seen now.
        """
        along = self._grasp(before).rotation().as_matrix()[:, 0]
        went = float(along.dot(after.translation() - before.translation()))
        squeezed = _PADS * np.sign(went) if abs(went) > _WENT else 0.0
        return SE3.from_translation(squeezed * along)

    def _pick(self, T_world_item: SE3) -> Generator[StepLike, None, HeldItem]:
        """Approach, grasp and lift the item at a pose."""
        yield from self._come_around(T_world_item)
        known = self.sensed.weights_known
        free = None if known else (yield from read_free_wrist(self.sensed))
        check = self._check
        held, around = (check.condition(Cause.GRASP),), (check.around(Cause.GRASP),)
        grasp = Grasp(name="close gripper", force=self.force, during=around, after=held)
        yield from compliant_grasp(self.sensed, self.item, T_world_item, grasp, tips=self.tips)
        since = self.sensed.time
        height = float(self.sensed.tool_pose().translation()[2])
        hand = self if free is None else (yield from self._weighed(free))
        yield hand.lift(self.sensed.tool_pose(), self._seen())
        above = None if self.resting is None else self.resting - height
        T_tcp_item = self._grasp(T_world_item).inverse() @ T_world_item
        return HeldItem(above=above, mass=hand.item.mass, T_tcp_item=T_tcp_item, since=since)

    def _come_around(self, T_world_item: SE3) -> Generator[StepLike, None, None]:
        """Come down from above, with the fingers around the item at a pose."""
        approach, descend = self.approach(T_world_item)
        yield self._closing(approach, descend, T_world_item)
        yield from self._descend(descend, T_world_item)

    def _descend(self, descend: Waypoint, T_world_item: SE3) -> Generator[StepLike, None, None]:
        """Go down around the item; fails with GRASP where the fingers land on it.

        They may, where the camera errs: from a little above the item on, they come slowly and stop
        where something is touched. A push is gone when they go on; an item stops them again.
        """
        grasp = descend.target
        if not camera_errs(self.sensed) or not isinstance(grasp, SE3):
            yield descend
            return
        bottom = float(grasp.translation()[2])
        top = float(T_world_item.translation()[2]) + 0.5 * self.item.height
        over = top - bottom + _TIPS
        if bottom + over < self.above:
            yield self._line("descend", raised(grasp, over))

        def short() -> str | None:
            left = float(self.sensed.tool_pose().translation()[2]) - bottom
            stopped = f"something stops them {1e3 * left:.1f} mm above the grasp"
            return stopped if left > _SHORT else None

        around = f"the fingers are beside the {self.item.name}"
        down = Condition(name=around, cause=Cause.GRASP, against=short)
        step = Guarded(waypoint=descend, force=_LANDED, speed=_SLOWLY, missing=None, after=(down,))
        try:
            yield step
        except StepFailed:
            yield step

    def holding(self, held: HeldItem | None) -> Self:
        """Return the handler of a held item, with its measured mass."""
        if held is None:
            return self
        return replace(self, item=replace(self.item, mass=held.mass), in_hand=held)

    def place(
        self, T_world_goal: SE3, held: HeldItem | None = None
    ) -> Generator[StepLike, None, None]:
        """Carry the item to a pose and release it; fails with DROP on the way.

        Args:
            T_world_goal: Pose of the item when it is released.
            held: What `pick` returned.
        """
        hand, errs = self.holding(held), camera_errs(self.sensed)
        T_world_item = yield from self.look_held(held, _ROUGH)
        T_world_tcp = self.sensed.tool_pose()
        yield hand.carry(T_world_tcp, T_world_item, T_world_goal)
        # It may have turned between the fingers on the way.
        T_world_item = yield from self.look_held(held, _ROUGH if errs else GOOD_ENOUGH)
        yield from hand._lowered(T_world_item, raised(T_world_goal, NEAR) if errs else T_world_goal)
        if errs:
            # Beside its goal, both are seen with the same error of the camera's calibration.
            T_world_item = yield from self.look_held(held, self.good_enough)
            yield from hand._let_down(T_world_item, T_world_goal)
        yield self.release()
        if errs:
            # What pressed on the goal until it was let go had pushed the arm aside.
            yield Wait(name="settle", seconds=SETTLE)

    def _let_down(self, T_world_item: SE3, T_world_goal: SE3) -> Generator[StepLike, None, None]:
        """Lower the held item from a little above its goal to where it is let go."""
        yield from self._lowered(T_world_item, raised(T_world_goal, LET_GO))

    def _lowered(self, T_world_item: SE3, T_world_goal: SE3) -> Generator[StepLike, None, None]:
        """Lower the held item from where it is to a pose, in another branch if need be."""
        T_world_tcp = self.sensed.tool_pose()
        lower = self.lower(T_world_tcp, T_world_item, T_world_goal, turned=True)
        try:
            yield lower
        except StepFailed as error:
            if error.failure.cause not in UNPLANNED:
                raise
            # As it has turned, the line would leave a joint's limits.
            yield self.carry(T_world_tcp, T_world_item, T_world_goal, turned=True)
            yield lower

    def look_held(
        self, held: HeldItem | None, good_enough: float = GOOD_ENOUGH
    ) -> Generator[StepLike, None, SE3]:
        """Return the pose of the held item, with z up; `held` as in `place`."""
        height = None
        if held is not None and held.above is not None:
            height = float(self.sensed.tool_pose().translation()[2]) + held.above
        return (yield from self.holding(held)._look(height, good_enough))

    def _weighed(self, free: FreeWrist) -> Generator[StepLike, None, Self]:
        """Return the handler with the measured mass of the item."""
        sensed, held = self.sensed, self._held(Cause.GRASP)
        mass = yield from measure_mass(sensed, self.item.name, self._carried(), held, free)
        # Friction holds the joints of a springy arm anyhow; at rest, the observer finds out how.
        yield Wait(name="settle", seconds=SETTLE)
        return replace(self, item=replace(self.item, mass=mass))

    def _look(self, height: float | None, good_enough: float) -> Generator[StepLike, None, SE3]:
        seen = yield from estimate_pose(self.sensed, self.item.name, None, good_enough)
        return at_height(self.sensed, self._located(seen), height)

    def release(self) -> Release:
        """Return the step that releases the item."""
        if self.opening is None:
            return Release()
        widest = self.sensed.gripper.width_max
        return Release(width=min(self.sensed.width() + self.opening, widest))

    def foreseen(self, T_world_item: SE3, T_world_goal: SE3) -> list[StepLike]:
        """Return the steps from above the item at one pose to above it at another."""
        *approach, descend = self.approach(T_world_item)
        grasp = self.item.grasp(T_world_item, self.sensed.gripper.width_max)
        return [
            *approach,
            descend,
            self.lift(grasp, T_world_item),
            self.carry(grasp, T_world_item, T_world_goal),
            self.lower(grasp, T_world_item, T_world_goal),
            Release(),
            self.retreat(self.release_pose(grasp, T_world_item, T_world_goal)),
        ]

    def leave(self, T_world_tcp: SE3) -> Move:
        """Return the move up from a released item and home, on which the fingers open."""
        gripper = self.sensed.gripper
        wide = Grip(width=gripper.width_max, force=gripper.force_max)
        return Move(waypoints=(self.retreat(T_world_tcp), HOME), meanwhile=wide)

    def retreat(self, T_world_tcp: SE3) -> Waypoint:
        """Return the waypoint straight up from a pose."""
        return self._line("retreat", self._up(T_world_tcp))

    def back_off(self) -> Generator[StepLike, None, None]:
        """Move up with the gripper open after a failure, for the next attempt."""
        yield self._line("back off", self._up(self.sensed.tool_pose()))
        yield Release(name="open gripper")

    def approach(self, T_world_item: SE3) -> list[Waypoint]:
        """Return the waypoints above the item and down to it."""
        grasp = self._grasp(T_world_item)
        descend, up = self._line("descend", grasp), self._up(grasp)
        # What leads down does not always lead up again: near a fold the way back may differ.
        onward = (descend, self._line("lift", up))
        return [Waypoint(name="approach", target=up, onward=onward), descend]

    def _closing(self, approach: Waypoint, descend: Waypoint, T_world_item: SE3) -> Move:
        """Return the move above the item; fingers close around one whose pose is known."""
        around: Grip | None = None
        if not camera_errs(self.sensed) and isinstance(descend.target, SE3):
            largest = 1.0 + float(self.sensed.sheet.noise["size_tolerance"])
            width = largest * self.item.width(descend.target, T_world_item) + 2.0 * _AROUND
            gripper = self.sensed.gripper
            around = Grip(width=min(width, gripper.width_max), force=gripper.force_max)
        return Move(waypoints=(approach,), meanwhile=around)

    def lift(self, T_world_tcp: SE3, T_world_item: SE3) -> Move:
        """Return the move straight up with the item."""
        payload = self.item.payload(T_world_tcp.inverse() @ T_world_item)
        return self._carrying(replace(self._line("lift", self._up(T_world_tcp)), carried=payload))

    def carry(
        self, T_world_tcp: SE3, T_world_item: SE3, T_world_goal: SE3, *, turned: bool = False
    ) -> Move:
        """Return the move above the pose from which the item is lowered to its goal."""
        poses = (T_world_tcp, T_world_item, T_world_goal)
        lower = self.lower(*poses, turned=turned).waypoints[0]
        target = self._up(self.release_pose(*poses, turned=turned))
        onward = (lower, self._line("retreat", target))
        return self._carrying(
            Waypoint(name="carry", target=target, carried=lower.carried, onward=onward)
        )

    def lower(
        self, T_world_tcp: SE3, T_world_item: SE3, T_world_goal: SE3, *, turned: bool = False
    ) -> Move:
        """Return the move straight down to the item's goal."""
        poses = (T_world_tcp, T_world_item, T_world_goal)
        payload = self.item.payload(T_world_tcp.inverse() @ T_world_item)
        target = self.release_pose(*poses, turned=turned)
        return self._carrying(replace(self._line("lower", target), carried=payload))

    def release_pose(
        self, T_world_tcp: SE3, T_world_item: SE3, T_world_goal: SE3, *, turned: bool = False
    ) -> SE3:
        """Return T_world_tcp with the held item at its goal.

        The wrist is as near to its middle as the item's symmetry permits; with `turned` it has
        been so before, and turns least from there: what the camera errs by turns with the item.
        """
        tool, item, goal = (heading(T) for T in (T_world_tcp, T_world_item, T_world_goal))
        middle = 0.0 if turned else tool
        turn = self.item.same_heading(middle + goal - item) - middle
        placed = turned_about_vertical(T_world_item, turn, T_world_goal.translation())
        return placed @ T_world_item.inverse() @ T_world_tcp

    def _grasp(self, T_world_item: SE3) -> SE3:
        """Return T_world_tcp that grasps the item."""
        grasp = self.item.grasp(T_world_item, self.sensed.gripper.width_max)
        return turned_about_vertical(grasp, self.across, grasp.translation())

    def _fits(self) -> bool:
        T_world_item = self._seen()
        grasp = self._grasp(T_world_item)
        return self.item.fits(grasp, T_world_item, self.sensed.gripper.width_max)

    def stood(self, T_world_item: SE3) -> SE3:
        """Return the pose of the item with z up, from the pose of its body."""
        if self.T_item_standing is None:
            return T_world_item
        return T_world_item @ self.T_item_standing

    def _carried(self) -> Payload:
        """Return the payload of the held item, where it is seen."""
        return self.item.payload(self.sensed.tool_pose().inverse() @ self._seen())

    def _seen(self) -> SE3:
        return self._located(self.sensed.seen_pose(self.item.name))

    def _located(self, seen: SE3) -> SE3:
        """Return the pose with z up of the item that the camera saw last at a pose."""
        held = self.in_hand
        if held is None or not held.hidden(self.sensed, self.item.name):
            return self.stood(seen)
        return self.sensed.tool_pose() @ held.T_tcp_item

    def _carrying(self, waypoint: Waypoint) -> Move:
        held = (self._held(Cause.DROP),)
        return Move(waypoints=(waypoint,), before=held, during=held, after=held)

    @property
    def _check(self) -> GraspCheck:
        return GraspCheck(sensed=self.sensed, item=self.item, force=self.force, standing=self._seen)

    def _held(self, cause: Cause) -> Condition:
        return self._check.condition(cause)

    def _line(self, name: str, target: SE3) -> Waypoint:
        return Waypoint(name=name, target=target, motion=Motion.LIN)

    def _up(self, T_world_tcp: SE3) -> SE3:
        x, y, _ = T_world_tcp.translation()
        return SE3.from_rotation_and_translation(
            T_world_tcp.rotation(), np.array([x, y, self.above])
        )
