"""FeelingInserter: finds a hole by touch, where neither wrist nor camera tells its height."""

from collections import deque
from collections.abc import Generator
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np
from mink import SE3, SO3

from robo47_qp.motion.waypoint import Waypoint
from robo47_qp.run.contact_steps import Guarded, Press
from robo47_qp.run.failure import Cause, Condition, StepFailed
from robo47_qp.run.steps import Grasp, StepLike
from robo47_qp.tasks.handling.pose_estimate import camera_errs, estimate_poses
from robo47_qp.tasks.handling.wrist import FreeWrist, read_free_wrist
from robo47_qp.tasks.peg_insert.feeling_picker import FeelingPicker, given_up
from robo47_qp.tasks.peg_insert.hole_sense import SINKS, HoleSense
from robo47_qp.tasks.peg_insert.lanes import across, lanes_beyond, search_lanes
from robo47_qp.tasks.peg_insert.peg import BELOW_TOP, DEPTH
from robo47_qp.tasks.peg_insert.peg_inserter import FALLEN
from robo47_qp.tasks.peg_insert.sinking import Sinking

_FIRM_TOUCH, _TOUCH_SPEED, _MEAN = 4.0, 4e-3, 30
"""Force of a stiff arm that touches [N], above the drift of a sensor at the wrist; its speed
without contact [m/s]; and how many readings are averaged."""
_SEARCH, _FALLING, _CENTRE = 1.5, 1.5e-3, 1.0
"""Force of the search [N]; speed at which it presses without contact: a peg that snaps off an edge
knocks on the block [m/s]; and force with which a peg is brought back to the hole's middle [N]."""
_FRESH, _OFF = 15, 2e-3
"""Number of lanes, with the short ones between them, after which the wrist is read anew, as it
drifts; and how far the peg is lifted off for it [m]."""
_NEAR, _FINER = 1.2e-3, 0.6
"""Half the side of the square that is searched around where the hole's edge has caught the peg [m],
and its pitch, as a part of the one before."""
_SINK_SPEED, _SEARCH_SPEED = 0.0035, 0.007
"""Speeds at which a peg is pressed in and searches [m/s]."""
_EASED, _LET_BE, _AWAY, _ASIDE_DAMPING = 0.5, 2.0, 0.1, 2000.0
"""Force on the peg before it is moved or released, force on it that is let be, force with which the
arm goes where more pushes it [N], and damping with which it does [N·s/m]."""
_PRESSES = 6
"""How often a peg that is not deep is eased aside and pressed again."""
_STUCK = 8e-3
"""Depth from which on a peg that sticks stands in the hole without fingers [m]."""
_TIP, _OVER, _PUSH_SPEED = 9e-3, 8e-3, 0.01
"""Distance of the fingers' ends below the tool point, and of closed fingers from the top of a peg
before they push it [m], and at what speed they come [m/s]."""
_TRIED, _FIRM_INSERT = 4.0, 10.0
"""Force on a peg that seems to be in the hole, and during insertion, above friction in the joints
[N]: a peg that a wall has stopped beside the hole leaps off it when it is eased."""
_GUARD, _LOWERING = 5.0, 0.03
"""Force that stops a peg that is lowered [N], and its speed [m/s]."""
_KNOWN = 2e-3
"""Half the side of the square that is searched around a hole that has let the peg in before [m]:
the peg may have turned or slipped between the fingers since."""
_AROUND = 22e-3
"""Distance from the hole at which the block is touched beside it [m]."""
_TILTED, _BESIDE, _FAR = 2e-3, 0.7e-3, 12e-3
"""How much deeper than its axis the edge of a tilted peg touches; accepted standard deviation of a
coordinate beside the hole; and height above the block where that is less certain [m]."""
_DEEP = 0.9 * DEPTH - _TILTED
"""Descent from where the peg touched the block that means it is at the bottom [m]."""

_GOES_IN = "the peg goes in"


@dataclass(kw_only=True)
class Memory:
    """What is known of a hole since it let the peg in."""

    T_world_hole: SE3 | None = None
    """Its pose, as far as the peg's place in the tool is known."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FeelingInserter(FeelingPicker):
    """Inserts the peg with a stiff arm that feels the block.

    Friction in the joints of a compliant arm would hide a small force and drag a search off its
    way. Forces count from those of the free wrist, and depths from where the block was touched.
    """

    let_down: ClassVar[float] = 12e-3

    memory: Memory = field(default_factory=Memory)
    """One for all attempts: handlers that follow from this one share it."""

    def lined_up(
        self, offset: np.ndarray, *, again: bool = False
    ) -> Generator[StepLike, None, tuple[Self, np.ndarray]]:
        """See `PegInserter.lined_up`: peg and hole are seen side by side, and the block is felt.

        Of a hole that has let the peg in before, only the peg has to be seen.
        """
        if not camera_errs(self.sensed):
            return self, offset
        known = self.memory.T_world_hole
        hand = self if known is None else replace(self, T_world_hole=known)
        if not again:
            yield hand.to_hole(offset)[:1]
        hand, offset = yield from hand._look_again(levelled=again or known is not None)
        if again or known is not None:
            return hand, offset
        return (yield from hand._level(offset)), offset

    def _look_again(self, *, levelled: bool) -> Generator[StepLike, None, tuple[Self, np.ndarray]]:
        """Return the handler and `offset`, seen from above the hole with the peg beside it.

        There, both are seen with the same error of the camera's calibration.

        Args:
            levelled: Whether `_level` has found height and tilt of the block, which are kept.
        """
        names = (self.item.name, "hole seen")
        seen = yield from estimate_poses(self.sensed, names, _BESIDE)
        T_tool_peg = self.sensed.tool_pose().inverse() @ self._located(seen[self.item.name])
        hole, axis = seen["hole seen"], T_tool_peg.rotation().as_matrix()[:, 2]
        if self.memory.T_world_hole is not None:
            hole = self.memory.T_world_hole
        elif levelled:
            at = self.T_world_hole.translation()
            at[:2] = hole.translation()[:2]
            hole = SE3.from_rotation_and_translation(self.T_world_hole.rotation(), at)
        return replace(self, T_world_hole=hole, peg_axis=axis), T_tool_peg.translation()[:2]

    def insert(
        self, offset: np.ndarray, radius: float, pitch: float
    ) -> Generator[StepLike, None, None]:
        """See `PegInserter.insert`; here, the radius is half the side of a square of lanes.

        It is small around a hole that has let the peg in before.
        """
        if self.memory.T_world_hole is not None:
            radius = min(radius, _KNOWN)
        x, y = across(self._tool_on_top(offset), self._axis)
        corner = SE3.from_translation(-radius * (x + y)) @ self.T_world_hole
        yield from self._lower(replace(self, T_world_hole=corner), offset)
        stiff, free = yield from self._touch()
        touched = self.sensed.tool_pose()
        if self._inside(offset):
            touched = SE3.from_translation(-self._height(offset) * self._axis) @ touched
        lanes = search_lanes(touched, self._axis, radius, pitch)
        try:
            stiff, free = yield from self._find(stiff, free, touched, lanes, _FINER * pitch)
        except StepFailed as error:
            if error.failure.cause is Cause.TIMEOUT:
                self.memory.T_world_hole = None
            raise
        here, top = self.sensed.tool_pose(), self._tool_on_top(offset)
        off = here.translation() - top.translation()
        off -= off.dot(self._axis) * self._axis
        self.memory.T_world_hole = SE3.from_translation(off) @ self.T_world_hole
        for again in range(_PRESSES + 1):
            if again:
                yield from self._press_in(stiff, free, _FIRM_INSERT)
            if self._depth(touched) >= _DEEP:
                # Fingers that open under load would let the arm leap.
                yield from self._ease(stiff, free)
                return
        yield from self._push(touched, stiff, free)

    def _find(
        self,
        stiff: Press,
        free: FreeWrist,
        touched: SE3,
        lanes: tuple[Waypoint, ...],
        finer: float,
    ) -> Generator[StepLike, None, tuple[Press, FreeWrist]]:
        """Search along lanes until the peg has sunk into the hole, or came down into it.

        Where edges only caught the peg, the hole is searched for once more around them, with a
        finer pitch [m]. Fails with TIMEOUT where nothing was found, or the peg does not go in.

        Args:
            stiff: Step that has touched the block; see `_touch`.
            free: What the wrist read before it.
            touched: Pose of the tool with the peg on the block.
            lanes: Where to search.
            finer: The finer pitch [m].

        Returns:
            What `_touch` returned last.
        """
        edges, fine = list[SE3](), False
        while self._depth(touched) < FALLEN:
            # From one touch to the next, the peg creeps up between the fingers.
            touched = self.sensed.tool_pose()
            if not lanes:
                evidence = "its edge has caught the peg, and the peg does not go in there"
                yield given_up("search", Cause.TIMEOUT, _GOES_IN, evidence)
            last = len(lanes) <= _FRESH and (fine or not edges)
            caught = yield from self._search(stiff, free, lanes[:_FRESH], last=last)
            if caught is None:
                lanes = lanes[_FRESH:]
            else:
                yield from self._press_in(stiff, free, _TRIED)
                if self._depth(caught) >= SINKS:
                    break
                lanes = lanes_beyond(caught, self._axis, lanes)
                edges.append(caught)
                yield from self._ease(stiff, free)
            yield self._lift_off(stiff, _OFF + max(0.0, self._depth(touched)))
            around = not lanes and not fine
            if around:
                fine = True
                yield from self._come_back()
                yield self._line("beside the edge", self._beside_edges(edges))
            # By a wrist that has drifted meanwhile, walls would be felt everywhere.
            stiff, free = yield from self._touch()
            if around:
                lanes = search_lanes(self.sensed.tool_pose(), self._axis, _NEAR, finer)
        return stiff, free

    def _beside_edges(self, edges: list[SE3]) -> SE3:
        """Return the pose of the tool, off the block, at the corner of a square around its poses.

        In these, the hole's edge has caught the peg: the hole is near.
        """
        here = self.sensed.tool_pose()
        middle = np.mean([edge.translation() for edge in edges], axis=0) - here.translation()
        middle -= middle.dot(self._axis) * self._axis
        x, y = across(here, self._axis)
        return SE3.from_translation(middle - _NEAR * (x + y)) @ here

    def _search(
        self,
        stiff: Press,
        free: FreeWrist,
        lanes: tuple[Waypoint, ...],
        *,
        last: bool,
    ) -> Generator[StepLike, None, SE3 | None]:
        """Search along lanes; return the pose of the tool in which the hole caught the peg.

        A wall also stops a peg whose edge meets the hole from a lane beside it, which has not sunk.
        Returns None where nothing was found; fails with TIMEOUT if these were the last lanes.
        """
        sinking = Sinking(self.sensed, self._axis)
        hole = HoleSense(sensed=self.sensed, axis=self._axis, free=free, sinking=sinking)
        searching = replace(
            stiff,
            name="search",
            waypoints=lanes,
            force=_SEARCH,
            damping=_SEARCH / _FALLING,
            pace=hole.pace,
            insists=hole.insists,
            speed=_SEARCH_SPEED,
            seconds=0.0,
            until=hole.found(),
            needed=last,
        )
        yield searching
        # It may have sunk while the tool came to rest.
        sunk = hole.sunk()
        if not hole.met and sunk < SINKS:
            return None
        # While it sank, the search went on and tilted it between the fingers.
        caught = sinking.caught
        back = SE3.from_translation(-self._depth(caught) * self._axis) @ caught
        way = (self._line("centre", back),)
        yield replace(
            searching,
            name="centre",
            waypoints=way,
            force=_CENTRE,
            pace=None,
            insists=None,
            until=None,
        )
        return caught

    def _press_in(
        self, stiff: Press, free: FreeWrist, force: float
    ) -> Generator[StepLike, None, None]:
        """Ease the peg, and press it with a force [N] until it sinks no more, or for some time."""
        yield from self._ease(stiff, free)
        insert = replace(stiff, name="insert", force=force, damping=force / _SINK_SPEED)
        try:
            yield replace(insert, seconds=15.0, until=self._rests())
        except StepFailed as error:
            # How deep it is tells what follows.
            if error.failure.cause is not Cause.TIMEOUT:
                raise

    def _ease(self, stiff: Press, free: FreeWrist) -> Generator[StepLike, None, None]:
        """Give way to all that pushes or pulls the peg, and press hardly any more.

        In this order: friction goes with the force on the peg, and one that the arm still pulls at
        would leap.
        """
        aside = replace(stiff, name="ease aside", force=_AWAY, damping=_ASIDE_DAMPING)
        yield from self._give_way(replace(aside, seconds=0.5, until=None), free, _LET_BE)
        yield replace(stiff, name="ease", force=_EASED, seconds=0.4, until=None)

    def _push(self, touched: SE3, stiff: Press, free: FreeWrist) -> Generator[StepLike, None, None]:
        """Let go of a peg that sticks in the hole, and push it from above with closed fingers.

        Then nothing but the hole guides it. Fails with TIMEOUT if it is not deep enough to stand,
        and with DROP if it sticks nevertheless.
        """
        deep = self._depth(touched)
        if deep < _STUCK:
            evidence = f"the peg sticks {1e3 * deep:.1f} mm deep"
            yield given_up("insert", Cause.TIMEOUT, _GOES_IN, evidence)
        yield from self._ease(stiff, free)
        yield from self.let_go("let go")
        over = SE3.from_translation((BELOW_TOP + _TIP + _OVER) * self._axis)
        yield self._line("over the peg", over @ self.sensed.tool_pose())
        yield Grasp(name="close gripper", force=self.force)
        stiff, _ = yield from self._touch(_FIRM_INSERT, _PUSH_SPEED, held=False)
        yield replace(stiff, name="push", seconds=4.0, until=self._rests())
        deep = self._depth(touched) + BELOW_TOP + _TIP
        yield replace(stiff, name="ease", force=_EASED, seconds=0.4, until=None)
        if deep < _DEEP:
            evidence = f"the peg sticks {1e3 * deep:.1f} mm deep, though it was pushed"
            yield given_up("push", Cause.DROP, _GOES_IN, evidence)

    def _touch(
        self, force: float = _FIRM_TOUCH, speed: float = _TOUCH_SPEED, *, held: bool = True
    ) -> Generator[StepLike, None, tuple[Press, FreeWrist]]:
        """Go down until the tool is stopped with a force [N], from a speed [m/s].

        Returns:
            The step that did it, and what the free wrist read before it.
        """
        free = yield from read_free_wrist(self.sensed, untouched=True)
        readings: deque[float] = deque(maxlen=_MEAN)

        def felt() -> float:
            return float((self.sensed.felt_force() - free.force).dot(self._axis))

        def against() -> str | None:
            readings.append(felt())
            pressed = float(np.mean(readings))
            if len(readings) == _MEAN and pressed >= 0.8 * force:
                return None
            return f"the peg presses with {pressed:.1f} N, {force:.1f} N are due"

        touch = Press(
            name="touch",
            axis=-self._axis,
            force=force,
            damping=force / speed,
            felt=felt,
            seconds=8.0,
            until=Condition(name="the peg is stopped", cause=Cause.TIMEOUT, against=against),
            during=(self._held(Cause.DROP),) if held else (),
        )
        yield touch
        return touch, free

    def _lower(self, hand: Self, offset: np.ndarray) -> Generator[StepLike, None, None]:
        """Go above where another handler takes the hole for, and down until that or a touch."""
        above, lower = hand.to_hole(offset)
        yield above
        yield Guarded(waypoint=lower, force=_GUARD, speed=_LOWERING, missing=None)

    def _level(self, offset: np.ndarray) -> Generator[StepLike, None, Self]:
        """Return the handler with the height and the tilt of the block, felt at three points.

        Points of the tool when the peg's end touches the block beside the hole lie in a plane
        parallel to it, however the peg is tilted.
        """
        points, hole = [], self.T_world_hole
        for k in range(3):
            angle = 2.0 * np.pi * k / 3.0
            way = _AROUND * np.array([np.cos(angle), np.sin(angle), 0.0])
            hand = replace(self, T_world_hole=hole @ SE3.from_translation(way))
            if k == 0:
                yield from self._lower(hand, offset)
            else:
                # Between two points, it only moves aside.
                yield hand.to_hole(offset)[1:]
            touch, _ = yield from self._touch()
            points.append(self.sensed.tool_pose().translation())
            if k == 0:
                # As high as it was felt: the camera may err by all of the way that is left above.
                hole = SE3.from_translation(hand._height(offset) * self._axis) @ hole
            yield self._lift_off(touch, _FAR)
        normal = np.cross(points[1] - points[0], points[2] - points[0])
        normal /= np.linalg.norm(normal)
        turn = SO3.exp(np.cross(self._axis, normal))
        R = turn @ self.T_world_hole.rotation()
        top = self._tool_on_top(offset).translation()
        height = float((np.mean(points, axis=0) - top).dot(normal))
        at = self.T_world_hole.translation() + height * normal
        return replace(self, T_world_hole=SE3.from_rotation_and_translation(R, at))

    def _lift_off(self, touch: Press, height: float) -> Press:
        """Return the step that lifts the peg off the block by a height [m], with the arm stiff."""
        up = SE3.from_translation(height * self._axis) @ self.sensed.tool_pose()
        way_up = (self._line("lift off", up),)
        return replace(touch, name="lift off", waypoints=way_up, force=0.0, seconds=0.0, until=None)
