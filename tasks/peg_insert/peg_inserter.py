"""PegInserter: the steps that search for a hole and insert a peg."""

from collections import deque
from collections.abc import Generator
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from mink import SE3, SO3

from robo47_qp.motion.waypoint import Motion, Waypoint, tool_down
from robo47_qp.run.compliance import Compliance
from robo47_qp.run.contact_steps import Comply, Press, Unload
from robo47_qp.run.failure import Cause, Condition
from robo47_qp.run.steps import StepLike
from robo47_qp.tasks.handling.item_handler import ItemHandler
from robo47_qp.tasks.handling.pose_estimate import camera_errs, estimate_pose, estimate_poses
from robo47_qp.tasks.handling.wrist import read_free_wrist, wrist_errs
from robo47_qp.tasks.peg_insert.peg import BELOW_TOP, DEPTH, POSITION_ERROR

_LET_DOWN, _TOUCH_FORCE = 5e-3, 2.0
"""Height above the block at which the peg is released to touch it [m], and the force [N], small
because both are steel."""
_FIRM = np.array([1500.0] * 3 + [40.0] * 3)
_SLACK = np.array([300.0] * 3 + [1.5, 1.5, 20.0])
"""Stiffness of the tool during the search, and during insertion, when the hole guides the peg [N/m,
N·m/rad]."""
PITCH = 0.4e-3
"""Pitch of a first spiral [m], less than the clearance: a peg tilted by 2 degrees about both axes
goes in over 0.4 mm, and friction pulls the turns up to 0.06 mm apart."""
_FIRM_TOUCH, _TOUCH_SPEED, _MEAN = 4.0, 6e-3, 30
"""Force of a stiff arm that touches and searches [N], above the drift of a sensor at the wrist; its
speed without contact [m/s]; and how many readings are averaged."""
_SINKS, _SINK_SPEED, _SEARCH_SPEED = 0.8e-3, 0.008, 0.004
"""Descent of a peg upright on the block that means it is in the hole [m]; speeds at which it sinks
and searches: while it sinks, the search tilts it between the fingers [m/s]."""
_EASED = 0.5
"""Force on the peg before it is released [N]."""
_CAUGHT = 0.3e-3
"""Descent from which on the hole holds the peg's end [m]."""
_FIRM_INSERT = 10.0
"""Force on the peg during insertion, above friction in the joints [N]."""
_AROUND = 22e-3
"""Distance from the hole at which the block is touched beside it [m]."""
_TILTED, _BESIDE, _FAR = 2e-3, 0.7e-3, 12e-3
"""How much deeper than its axis the edge of a tilted peg touches; accepted standard deviation of a
coordinate beside the hole; and height above the block where that is less certain [m]."""
_FALLEN = 2e-3
"""Descent of the peg from first contact that means it is in the hole [m]; a peg tilted by twice the
angular error descends by 1 mm at the edge."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PegInserter(ItemHandler):
    """Handles the peg, and inserts it into the hole."""

    search_force: float
    """Force on the peg during the search for the hole [N]."""
    insert_force: float
    """Force on the peg during insertion [N]."""
    T_world_hole: SE3
    """Estimated pose of the hole."""
    peg_axis: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))
    """Direction of the peg in the tool, from its lower end to its upper one (3,) [-]."""

    def offset(self) -> Generator[StepLike, None, np.ndarray]:
        """Return the position of the peg's axis in the plane of the tool (2,) [m].

        It is seen along the tool's x; along y, the fingers have centred it.
        """
        T_world_peg = yield from estimate_pose(self.sensed, self.item.name)
        at = (self.sensed.tool_pose().inverse() @ T_world_peg).translation()
        return np.array([at[0], 0.0])

    def insert(
        self, offset: np.ndarray, radius: float, pitch: float
    ) -> Generator[StepLike, None, None]:
        """Touch the block, search for the hole and insert the peg; fails with TIMEOUT or DROP.

        Args:
            offset: See `offset`.
            radius: Radius of the spiral [m].
            pitch: Distance between its turns [m].
        """
        yield from self.to_hole(offset)
        if wrist_errs(self.sensed) or camera_errs(self.sensed):
            yield from self._insert_by_touch(offset, radius, pitch)
            return
        held = (self._held(Cause.DROP),)
        yield Comply(
            name="touch",
            waypoints=(),
            compliance=self._pressing(_FIRM, _TOUCH_FORCE, 6e-3),
            seconds=3.0,
            until=self._touched(offset),
            during=held,
            stay=True,
        )
        touched = self.sensed.tool_pose()
        if not self._inside(offset):
            yield Comply(
                name="search",
                waypoints=self._spiral(touched, radius, pitch),
                compliance=self._pressing(_FIRM, self.search_force, 0.02),
                renew=True,
                speed=0.008,
                until=self._sunk(touched),
                during=held,
            )
        yield Comply(
            name="insert",
            waypoints=(),
            compliance=self._pressing(_SLACK, self.insert_force, 0.015),
            seconds=15.0,
            until=self._at_bottom(offset),
            during=held,
        )

    def _insert_by_touch(
        self, offset: np.ndarray, radius: float, pitch: float
    ) -> Generator[StepLike, None, None]:
        """Do the same where neither the wrist nor the camera tells the height of the block.

        The arm is stiff while it touches and searches, as friction in its joints would hide a
        small force and pull turns of the spiral apart; forces count from those of the free wrist,
        and depths from where the block was touched.
        """
        stiff = yield from self._touch()
        touched = self.sensed.tool_pose()
        if self._height(offset) > -0.5 * DEPTH:
            search = self._spiral(touched, radius, pitch)
            caught = touched

            def watch() -> None:
                nonlocal caught
                here = self.sensed.tool_pose()
                if (touched.translation() - here.translation()).dot(self._axis) < _CAUGHT:
                    caught = here

            searching = replace(
                stiff,
                name="search",
                waypoints=search,
                damping=_FIRM_TOUCH / _SINK_SPEED,
                speed=_SEARCH_SPEED,
                seconds=0.0,
                observe=watch,
                until=self._sunk(touched, _SINKS),
            )
            yield searching
            # While it sank, the search went on and tilted it between the fingers.
            down = (self.sensed.tool_pose().translation() - caught.translation()).dot(self._axis)
            back = SE3.from_translation(float(down) * self._axis) @ caught
            way = (self._line("centre", back),)
            yield replace(searching, name="centre", waypoints=way, observe=None, until=None)
        else:
            # It went in at once, and stands on the bottom.
            touched = SE3.from_translation(DEPTH * self._axis) @ touched
        yield replace(
            stiff,
            name="insert",
            force=_FIRM_INSERT,
            damping=_FIRM_INSERT / _SINK_SPEED,
            seconds=6.0,
            until=self._stands(touched),
        )
        # Fingers that open under load would let the arm leap.
        yield replace(stiff, name="ease", force=_EASED, seconds=0.5, until=None)
        yield Unload()

    def _touch(self) -> Generator[StepLike, None, Press]:
        """Lower the peg until it is stopped, and return the step that did it."""
        free = yield from read_free_wrist(self.sensed)
        readings: deque[float] = deque(maxlen=_MEAN)

        def felt() -> float:
            return float((self.sensed.felt_force() - free.force).dot(self._axis))

        def against() -> str | None:
            readings.append(felt())
            force = float(np.mean(readings))
            if len(readings) == _MEAN and force >= 0.8 * _FIRM_TOUCH:
                return None
            return f"the peg presses with {force:.1f} N, {_FIRM_TOUCH:.1f} N are due"

        touch = Press(
            name="touch",
            axis=-self._axis,
            force=_FIRM_TOUCH,
            damping=_FIRM_TOUCH / _TOUCH_SPEED,
            felt=felt,
            seconds=8.0,
            until=Condition(name="the peg is stopped", cause=Cause.TIMEOUT, against=against),
            during=(self._held(Cause.DROP),),
        )
        yield touch
        return touch

    def level(self, offset: np.ndarray) -> Generator[StepLike, None, Self]:
        """Return the handler with the height and the tilt of the block, felt at three points.

        Points of the tool when the peg's end touches the block beside the hole lie in a plane
        parallel to it, however the peg is tilted.
        """
        points = []
        for k in range(3):
            angle = 2.0 * np.pi * k / 3.0
            way = _AROUND * np.array([np.cos(angle), np.sin(angle), 0.0])
            beside = self.T_world_hole @ SE3.from_translation(way)
            ways = replace(self, T_world_hole=beside).to_hole(offset)
            # Between two points, it only moves aside.
            yield ways if k == 0 else ways[1:]
            touch = yield from self._touch()
            points.append(self.sensed.tool_pose().translation())
            up = SE3.from_translation(_FAR * self._axis) @ self.sensed.tool_pose()
            way_up = (self._line("lift off", up),)
            yield replace(
                touch, name="lift off", waypoints=way_up, force=0.0, seconds=0.0, until=None
            )
        normal = np.cross(points[1] - points[0], points[2] - points[0])
        normal /= np.linalg.norm(normal)
        turn = SO3.exp(np.cross(self._axis, normal))
        R = turn @ self.T_world_hole.rotation()
        top = self._tool_on_top(offset).translation()
        height = float((np.mean(points, axis=0) - top).dot(normal))
        at = self.T_world_hole.translation() + height * normal
        return replace(self, T_world_hole=SE3.from_rotation_and_translation(R, at))

    def _stands(self, touched: SE3) -> Condition:
        """Return the condition that the peg sinks no more, deep below where it was touched."""
        lowest, since = 0.0, self.sensed.time

        def against() -> str | None:
            nonlocal lowest, since
            way = (self.sensed.tool_pose().translation() - touched.translation()).dot(self._axis)
            if way < lowest - 1e-4:
                lowest, since = float(way), self.sensed.time
            if -way >= 0.9 * DEPTH - _TILTED and self.sensed.time - since >= 0.3:
                return None
            return f"the peg is {-1e3 * way:.1f} mm deep and still sinking, or stuck"

        return Condition(name="the peg is at the bottom", cause=Cause.TIMEOUT, against=against)

    def look_again(
        self, *, levelled: bool = False
    ) -> Generator[StepLike, None, tuple[Self, np.ndarray]]:
        """Return the handler and `offset`, seen from above the hole with the peg beside it.

        There, both are seen with the same error of the camera's calibration.

        Args:
            levelled: Whether `level` has found height and tilt of the block, which are kept.
        """
        names = (self.item.name, "hole seen")
        seen = yield from estimate_poses(self.sensed, names, _BESIDE)
        T_tool_peg = self.sensed.tool_pose().inverse() @ seen[self.item.name]
        hole, axis = seen["hole seen"], T_tool_peg.rotation().as_matrix()[:, 2]
        if levelled:
            at = self.T_world_hole.translation()
            at[:2] = hole.translation()[:2]
            hole = SE3.from_rotation_and_translation(self.T_world_hole.rotation(), at)
        return replace(self, T_world_hole=hole, peg_axis=axis), T_tool_peg.translation()[:2]

    def _pressing(self, stiffness: np.ndarray, force: float, speed: float) -> Compliance:
        """Return a compliance that presses the peg; free motion is slowed by force / speed."""
        return Compliance(stiffness=stiffness, axis=-self._axis, force=force, speed=speed)

    def draw_out(self) -> Generator[StepLike, None, None]:
        """Move straight up with a compliant tool."""
        up = self._line("draw out", self._up(self.sensed.tool_pose()))
        springs = Compliance(stiffness=np.array([1000.0] * 3 + [20.0] * 3))
        yield Comply(name="draw out", waypoints=(up,), compliance=springs, speed=0.05)

    def to_hole(self, offset: np.ndarray) -> tuple[Waypoint, Waypoint]:
        """Return the waypoints above the estimated hole and down to a little above it."""
        T = self._tool_on_top(offset)
        payload = self.item.payload(
            SE3.from_translation(np.array([*offset, 0.5 * self.item.height - BELOW_TOP]))
        )
        height = _FAR if camera_errs(self.sensed) else _LET_DOWN
        start = SE3.from_translation(height * self._axis) @ T
        lower = Waypoint(name="lower", target=start, motion=Motion.LIN, carried=payload)
        above = Waypoint(
            name="to the hole", target=self._up(start), carried=payload, onward=(lower,)
        )
        return above, lower

    @property
    def _axis(self) -> np.ndarray:
        """Return the direction out of the hole, as far as it is known (3,) [-]."""
        return self.T_world_hole.rotation().as_matrix()[:, 2]

    def _tool_on_top(self, offset: np.ndarray) -> SE3:
        """Return the tool pose with the peg's end on the block, over the estimated hole."""
        axis, z = self._axis, np.array([0.0, 0.0, 1.0])
        sine = np.cross(z, axis)
        tilt = SO3.exp(sine)
        rotation = tilt @ tool_down([0.0, 0.0, 0.0]).rotation()
        rotation = SO3.exp(np.cross(rotation.apply(self.peg_axis), axis)) @ rotation
        half = 0.5 * self.item.height
        end = np.array([*offset, half - BELOW_TOP]) - half * self.peg_axis
        hole = self.T_world_hole.translation()
        return SE3.from_rotation_and_translation(rotation, hole - rotation.as_matrix() @ end)

    def _height(self, offset: np.ndarray) -> float:
        """Return the height of the peg's end above the block, as far as that is known [m]."""
        here, top = self.sensed.tool_pose(), self._tool_on_top(offset)
        return float((here.translation() - top.translation()).dot(self._axis))

    def _inside(self, offset: np.ndarray) -> bool:
        """Return True if the peg's end is so low that it must be in the hole."""
        return -self._height(offset) >= POSITION_ERROR + _FALLEN

    def _spiral(self, T_world_tcp: SE3, radius: float, pitch: float) -> tuple[Waypoint, ...]:
        """Return a square spiral around a tool pose, normal to the hole's axis, out to a radius."""
        ways = [T_world_tcp.rotation().as_matrix()[:, i] for i in (0, 1)]
        poses, at, length = [], np.zeros(3), pitch
        while length <= 2.0 * radius:
            for way in ways:
                at = at + length * way
                poses.append(SE3.from_translation(at) @ T_world_tcp)
            ways, length = [-way for way in ways], length + pitch
        return tuple(
            Waypoint(name=f"search {i + 1}", target=pose, motion=Motion.LIN)
            for i, pose in enumerate(poses)
        )

    def _touched(self, offset: np.ndarray) -> Condition:
        """Return the condition of contact; it also holds if the peg goes into the hole at once."""

        def against() -> str | None:
            if self._inside(offset):
                return None
            force = float(self.sensed.felt_force().dot(self._axis))
            force += 9.81 * self.item.mass
            if force >= 0.5 * _TOUCH_FORCE:
                return None
            return f"the peg presses with {force:.1f} N, {_TOUCH_FORCE:.1f} N are due"

        return Condition(name="the peg touches the block", cause=Cause.TIMEOUT, against=against)

    def _sunk(self, touched: SE3, least: float = _FALLEN) -> Condition:
        axis, start = self._axis, touched.translation()

        def against() -> str | None:
            sunk = float((start - self.sensed.tool_pose().translation()).dot(axis))
            if sunk >= least:
                return None
            return f"the peg has sunk by {1e3 * sunk:.1f} mm; {1e3 * least:.1f} mm are the hole"

        return Condition(name="the peg is in the hole", cause=Cause.TIMEOUT, against=against)

    def _at_bottom(self, offset: np.ndarray) -> Condition:
        """Return the condition that the peg rests at the depth of the estimated hole."""
        lowest, since = np.inf, self.sensed.time

        def against() -> str | None:
            nonlocal lowest, since
            height, now = self._height(offset), self.sensed.time
            if height < lowest - 1e-4:
                lowest, since = height, now
            if -height >= 0.9 * DEPTH - POSITION_ERROR and now - since >= 0.2:
                return None
            return f"the peg is {-1e3 * height:.1f} mm deep and still sinking, or stuck"

        return Condition(name="the peg is at the bottom", cause=Cause.TIMEOUT, against=against)
