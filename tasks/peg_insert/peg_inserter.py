"""PegInserter: the steps that search for a hole and insert a peg."""

from collections.abc import Generator
from dataclasses import dataclass, field
from typing import ClassVar, Self

import numpy as np
from mink import SE3, SO3

from robo47_qp.motion.waypoint import Motion, Waypoint, tool_down
from robo47_qp.run.compliance import Compliance
from robo47_qp.run.contact_steps import Comply
from robo47_qp.run.failure import Cause, Condition
from robo47_qp.run.steps import Release, StepLike
from robo47_qp.tasks.handling.item_handler import ItemHandler
from robo47_qp.tasks.handling.pose_estimate import GOOD_ENOUGH
from robo47_qp.tasks.peg_insert.peg import BELOW_TOP, DEPTH, POSITION_ERROR

_TOUCH_FORCE = 2.0
"""Force of a first contact [N], small because both are steel."""
_FIRM = np.array([1500.0] * 3 + [40.0] * 3)
_SLACK = np.array([300.0] * 3 + [1.5, 1.5, 20.0])
"""Stiffness of the tool during the search, and during insertion, when the hole guides the peg [N/m,
N·m/rad]."""
PITCH = 0.4e-3
"""Pitch of a first spiral [m], less than the clearance: a peg tilted by 2 degrees about both axes
goes in over 0.4 mm, and friction pulls the turns up to 0.06 mm apart."""
FALLEN = 2e-3
"""Descent of the peg from first contact that means it is in the hole [m]; a peg tilted by twice the
angular error descends by 1 mm at the edge."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PegInserter(ItemHandler):
    """Handles the peg, and inserts it into the hole."""

    tips: ClassVar[bool] = True
    let_down: ClassVar[float] = 5e-3
    """Height above the block from which the peg is let down on it [m]."""

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
        T_world_peg = yield from self._look(None, GOOD_ENOUGH)
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

    def _pressing(self, stiffness: np.ndarray, force: float, speed: float) -> Compliance:
        """Return a compliance that presses the peg; free motion is slowed by force / speed."""
        return Compliance(stiffness=stiffness, axis=-self._axis, force=force, speed=speed)

    def lined_up(
        self, offset: np.ndarray, *, again: bool = False
    ) -> Generator[StepLike, None, tuple[Self, np.ndarray]]:
        """Return the handler and `offset` once all is known that can be, before an insertion.

        Args:
            offset: See `offset`.
            again: Whether an insertion has failed.
        """
        yield from ()
        return self, offset

    def draw_out(self) -> Generator[StepLike, None, bool]:
        """Move straight up with a compliant tool; return False if the peg sticks in the hole."""
        up = self._line("draw out", self._up(self.sensed.tool_pose()))
        springs = Compliance(stiffness=np.array([1000.0] * 3 + [20.0] * 3))
        yield Comply(name="draw out", waypoints=(up,), compliance=springs, speed=0.05)
        return True

    def let_go(self, name: str = "release") -> Generator[StepLike, None, None]:
        """Open the fingers fully, before a line that leads away from the peg."""
        yield Release(name=name)

    def to_hole(self, offset: np.ndarray) -> tuple[Waypoint, Waypoint]:
        """Return the waypoints above the estimated hole and down to a little above it."""
        T = self._tool_on_top(offset)
        payload = self.item.payload(
            SE3.from_translation(np.array([*offset, 0.5 * self.item.height - BELOW_TOP]))
        )
        start = SE3.from_translation(self.let_down * self._axis) @ T
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

    def _depth(self, start: SE3) -> float:
        """Return by how much the tool is below a pose along the hole's axis [m]."""
        return float((start.translation() - self.sensed.tool_pose().translation()).dot(self._axis))

    def _inside(self, offset: np.ndarray) -> bool:
        """Return True if the peg's end is so low that it must be in the hole."""
        return -self._height(offset) >= POSITION_ERROR + FALLEN

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

    def _sunk(self, touched: SE3, least: float = FALLEN) -> Condition:
        """Return the condition that the tool is at least so far below a pose [m]."""

        def against() -> str | None:
            sunk = self._depth(touched)
            if sunk >= least:
                return None
            return f"the peg has sunk by {1e3 * sunk:.1f} mm; {1e3 * least:.1f} mm are the hole"

        return Condition(name="the peg is in the hole", cause=Cause.TIMEOUT, against=against)

    def _at_bottom(self, offset: np.ndarray) -> Condition:
        """Return the condition that the peg rests at the depth of the estimated hole."""
        rests = self._rests(0.2)

        def against() -> str | None:
            height, still = self._height(offset), rests.against() is None
            if still and -height >= 0.9 * DEPTH - POSITION_ERROR:
                return None
            return f"the peg is {-1e3 * height:.1f} mm deep and still sinking, or stuck"

        return Condition(name="the peg is at the bottom", cause=Cause.TIMEOUT, against=against)

    def _rests(self, seconds: float = 0.5) -> Condition:
        """Return the condition that the tool has sunk no more for a time [s], from now on."""
        start = self.sensed.tool_pose()
        deepest, since = 0.0, self.sensed.time

        def against() -> str | None:
            nonlocal deepest, since
            sunk = self._depth(start)
            if sunk > deepest + 1e-4:
                deepest, since = sunk, self.sensed.time
            if self.sensed.time - since >= seconds:
                return None
            return f"the peg is still sinking, {1e3 * sunk:.1f} mm so far"

        return Condition(name="the peg sinks no more", cause=Cause.TIMEOUT, against=against)
