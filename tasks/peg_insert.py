"""Put a peg into a hole that is known less well than it fits: feel for it, and give way."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np
from mink import SE3, SO3

from robo47_qp.errors import InvalidValueError
from robo47_qp.failure import Cause, Failure, StepFailed
from robo47_qp.obstacle import Obstacle
from robo47_qp.simulation import Simulation
from robo47_qp.steps import Compliance, Comply, Condition, Release, Step
from robo47_qp.task import Program
from robo47_qp.waypoint import Motion, Waypoint, tool_down
from tasks.handling import HOME, LOST, Handling
from tasks.headings import upright
from tasks.item import Item
from tasks.looking import look
from tasks.table import TABLE_TOP, add_table

DIAMETER, LENGTH = 0.02, 0.06
"""Of the peg, a cylinder without chamfer [m]."""
CLEARANCE = 0.5e-3
"""Diameter of the hole less that of the peg; the hole has no chamfer either [m]."""
DEPTH = 0.03
"""Of the hole [m]."""
POSITION_ERROR, ANGLE_ERROR = 2e-3, np.radians(2.0)
"""How far the pose of the hole that the robot knows is off, at most: along each axis [m], about
each axis [rad]."""
_TOP = TABLE_TOP + DEPTH + 0.01
"""Height of the block's top [m]."""
_FACETS, _OUTER = 16, 0.04
"""Boxes around the hole, which touch its circle from outside, and their outer radius [m]."""
_HARD = {"solref": [3e-3, 1.0], "solimp": [0.9, 0.9, 1e-4, 0.5, 2.0]}
"""Contacts of peg and hole: 20 N press them into each other by less than 0.05 mm."""
_FRICTION = [0.3, 0.005, 1e-4]
_BELOW_TOP = 0.012
"""How deep below the peg's top the tool point grasps it: the rest is longer than the hole [m]."""
_LET_DOWN, _TOUCH_FORCE = 5e-3, 2.0
"""Where above the block the peg is let down [m], and what with [N]: steel meets steel slowly."""
_FIRM = np.array([2500.0] * 3 + [60.0] * 3)
_SLACK = np.array([300.0] * 3 + [1.5, 1.5, 20.0])
"""Stiffness of the tool in the search, and on the way down, where the hole leads the peg [N/m,
N·m/rad]."""
_PITCH = 0.4e-3
"""Between the turns of a spiral [m]: less than the clearance."""
_FALLEN = 2e-3
"""Sinking of the peg from where it touched, from which it is in the hole [m]. A peg that is tilted
by twice the error of an angle sinks by 1 mm at the edge."""


@dataclass(frozen=True, kw_only=True)
class Peg(Item):
    """A cylinder that is grasped close to its top."""

    def add(self, spec: mujoco.MjSpec, position: tuple[float, float, float]) -> None:
        """See `Item.add`."""
        super().add(spec, position)
        geom = spec.geom(self.name)
        geom.friction, geom.solref, geom.solimp = _FRICTION, _HARD["solref"], _HARD["solimp"]

    def grasp(self, T_world_item: SE3, width_max: float) -> SE3:
        """See `Item.grasp`."""
        x, y, z = T_world_item.translation()
        return tool_down([x, y, z + 0.5 * self.height - _BELOW_TOP])


@dataclass(frozen=True, kw_only=True)
class PegInsert:
    """Pick the peg from the table and put it into the hole, down to the bottom.

    The peg counts as inserted when it is at least 90 % of the depth in the hole, upright
    and at rest, the gripper is open and the arm is home.
    """

    peg: Peg = field(
        default_factory=lambda: Peg(
            name="peg",
            size=(DIAMETER, DIAMETER, LENGTH),
            round=True,
            mass=0.15,
            rgba=(0.75, 0.62, 0.30, 1.0),
        )
    )
    grip_force: float = 60.0
    """Of a finger on the peg [N]."""
    search_force: float = 8.0
    """What the peg is pressed with while it looks for the hole [N]."""
    insert_force: float = 6.0
    """What it is pressed with on the way down [N]."""
    search_radius: float = 3.2e-3
    """Of the first spiral: a little more than the error of the position in x and y [m]."""
    retries: int = 3
    """Further attempts, each with a spiral 1.5 times as wide, or with the peg picked again."""
    force_max: float = 60.0
    """See `Task.force_max` [N]."""
    obstacles: tuple[Obstacle, ...] = ()
    """The block is to be touched."""
    name: str = "peg_insert"

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: One is not positive.
        """
        for name in ("grip_force", "search_force", "insert_force", "search_radius"):
            if not getattr(self, name) > 0.0:
                raise InvalidValueError(name, getattr(self, name), "positive")

    def variant(self, rng: np.random.Generator) -> "PegInsert":
        """The same: what differs are poses, and what is known of them."""
        return self

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        """See `Task.build_scene`."""
        add_table(spec)
        self.peg.add(spec, (0.40, 0.20, TABLE_TOP + 0.5 * LENGTH))
        _add_block(spec.worldbody.add_body(name="hole", mocap=True))
        seen = spec.worldbody.add_body(name="hole seen", mocap=True)
        seen.add_geom(
            name="hole seen",
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            size=[0.5 * DIAMETER, 3e-4, 0.0],
            rgba=[0.15, 0.55, 0.30, 0.6],
            contype=0,
            conaffinity=0,
        )

    def reset(self, simulation: Simulation, rng: np.random.Generator | None) -> None:
        """See `Task.reset`."""
        peg, hole = upright([0.40, 0.20, TABLE_TOP], 0.0), upright([0.48, -0.10, _TOP], 0.0)
        error = SE3.from_translation(np.array([1.2e-3, -0.8e-3, 0.5e-3]))
        if rng is not None:
            x, y = rng.uniform(0.38, 0.58), rng.uniform(0.12, 0.30)
            peg = upright([x, y, TABLE_TOP], rng.uniform(-np.pi, np.pi))
            x, y = rng.uniform(0.38, 0.58), rng.uniform(-0.30, -0.02)
            hole = upright([x, y, _TOP], rng.uniform(-np.pi, np.pi))
            shift = rng.uniform(-POSITION_ERROR, POSITION_ERROR, 3)
            turn = SO3.from_rpy_radians(*rng.uniform(-ANGLE_ERROR, ANGLE_ERROR, 3))
            error = SE3.from_rotation_and_translation(turn, shift)
        up = SE3.from_translation(np.array([0.0, 0.0, 0.5 * LENGTH]))
        simulation.place_object(self.peg.name, peg @ up)
        simulation.place_marker("hole", hole)
        simulation.place_marker("hole seen", hole @ error)

    def outlook(self, simulation: Simulation) -> Sequence[Step]:
        """See `Task.outlook`."""
        hand = self._inserter(simulation)
        T_world_peg = simulation.object_pose(self.peg.name)
        *approach, descend = hand.approach(T_world_peg)
        grasp = self.peg.grasp(T_world_peg, simulation.gripper.width_max)
        lift = hand.lift(grasp, T_world_peg)
        return [*approach, descend, lift, *hand.to_hole(np.zeros(2)), Release(), HOME]

    def program(self, simulation: Simulation) -> Program:
        """See `Task.program`."""
        hand = self._inserter(simulation)
        radius, offset = self.search_radius, None
        for attempt in range(1 + self.retries):
            try:
                if offset is None:
                    yield from hand.pick()
                    offset = yield from hand.offset()
                yield from hand.insert(offset, radius)
            except StepFailed as error:
                lost = error.failure.cause in LOST
                if not lost and error.failure.cause is not Cause.TIMEOUT:
                    raise
                if lost:
                    yield from hand.back_off()
                    offset = None
                else:
                    radius *= 1.5
                    yield from hand.draw_out()
                if attempt == self.retries:
                    yield HOME
                    raise
            else:
                break
        yield Release()
        yield hand.retreat(simulation.tool_pose())
        yield HOME
        return None

    def verdict(self, simulation: Simulation) -> Failure | None:
        """See `Task.verdict`."""
        measures = self.measures(simulation)
        depth, tilt = measures["depth_m"], measures["tilt_rad"]
        aside = measures["aside_m"]
        speed = float(np.linalg.norm(simulation.object_twist(self.peg.name)[:3]))
        if depth < 0.9 * DEPTH or aside > 1e-3 or tilt > 0.03 or speed > 1e-3:
            evidence = (
                f"the peg is {1e3 * depth:.1f} mm deep, {1e3 * aside:.2f} mm beside the axis of "
                f"the hole, tilted by {tilt:.3f} rad, and moves at {1e3 * speed:.1f} mm/s; "
                f"allowed are at least {1e3 * 0.9 * DEPTH:.1f} mm, 1 mm, 0.03 rad, 1 mm/s"
            )
            return Failure(cause=Cause.PLACE, evidence=evidence)
        away = float(np.abs(simulation.state().q - simulation.robot.home).max())
        open_width = simulation.gripper.width_max - 1e-3
        if away > 0.01 or simulation.width() < open_width:
            evidence = (
                f"a joint is {away:.3f} rad from home, the gripper is open "
                f"{1e3 * simulation.width():.1f} mm; allowed are 0.01 rad, "
                f"at least {1e3 * open_width:.1f} mm"
            )
            return Failure(cause=Cause.PLACE, evidence=evidence)
        return None

    def measures(self, simulation: Simulation) -> dict[str, float]:
        """How deep the peg's end is in the hole, how far beside its axis [m], its tilt [rad]."""
        T_hole_peg = simulation.marker_pose("hole").inverse() @ simulation.object_pose("peg")
        end = T_hole_peg @ np.array([0.0, 0.0, -0.5 * LENGTH])
        upwards = float(T_hole_peg.rotation().as_matrix()[2, 2])
        return {
            "depth_m": float(-end[2]),
            "aside_m": float(np.hypot(end[0], end[1])),
            "tilt_rad": float(np.arccos(np.clip(upwards, -1.0, 1.0))),
        }

    def _inserter(self, simulation: Simulation) -> "Inserter":
        return Inserter(
            simulation=simulation,
            item=self.peg,
            above=_TOP + LENGTH + 0.06,
            force=self.grip_force,
            task=self,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Inserter(Handling):
    """Handles the peg, and puts it into the hole."""

    task: PegInsert

    def offset(self) -> Generator[Step, None, np.ndarray]:
        """Where the peg's axis is in the plane of the tool (2,) [m].

        Along the tool's x it is looked at; along y the fingers have centred it.
        """
        T_world_peg = yield from look(self.simulation, self.item.name)
        at = (self.simulation.tool_pose().inverse() @ T_world_peg).translation()
        return np.array([at[0], 0.0])

    def insert(self, offset: np.ndarray, radius: float) -> Generator[Step, None, None]:
        """Touch the block, feel for the hole, and go down; fails with TIMEOUT or DROP."""
        yield from self.to_hole(offset)
        held = (self._held(Cause.DROP),)
        yield Comply(
            name="touch",
            waypoints=(),
            compliance=self._pressing(_FIRM, _TOUCH_FORCE, 8e-3),
            seconds=3.0,
            until=self._touched(),
            during=held,
            stay=True,
        )
        touched = self.simulation.tool_pose()
        if -self._height(offset) < POSITION_ERROR + _FALLEN:
            yield Comply(
                name="search",
                waypoints=self._spiral(touched, radius),
                compliance=self._pressing(_FIRM, self.task.search_force, 0.03),
                renew=True,
                speed=0.012,
                until=self._sunk(touched),
                during=held,
            )
        yield Comply(
            name="insert",
            waypoints=(),
            compliance=self._pressing(_SLACK, self.task.insert_force, 0.015),
            seconds=6.0,
            until=self._at_bottom(offset),
            during=held,
        )

    def _pressing(self, stiffness: np.ndarray, force: float, speed: float) -> Compliance:
        """Into the hole as it is known. What is free to move is slowed by force / speed."""
        return Compliance(stiffness=stiffness, axis=-self._axis, force=force, speed=speed)

    def draw_out(self) -> Generator[Step, None, None]:
        """Straight up, giving way."""
        up = self._line("draw out", self._up(self.simulation.tool_pose()))
        springs = Compliance(stiffness=np.array([1000.0] * 3 + [20.0] * 3))
        yield Comply(name="draw out", waypoints=(up,), compliance=springs)

    def to_hole(self, offset: np.ndarray) -> tuple[Waypoint, Waypoint]:
        """To above the hole, and down to a little above it, as far as it is known."""
        T = self._tool_on_top(offset)
        payload = self.item.payload(
            SE3.from_translation(np.array([*offset, 0.5 * self.item.height - _BELOW_TOP]))
        )
        start = SE3.from_translation(_LET_DOWN * self._axis) @ T
        lower = Waypoint(name="lower", target=start, motion=Motion.LIN, carried=payload)
        above = Waypoint(
            name="to the hole", target=self._up(start), carried=payload, onward=(lower,)
        )
        return above, lower

    @property
    def _axis(self) -> np.ndarray:
        """Direction out of the hole as it is known (3,) [-]."""
        return self.simulation.marker_pose("hole seen").rotation().as_matrix()[:, 2]

    def _tool_on_top(self, offset: np.ndarray) -> SE3:
        """Tool pose with the end of the peg on the block, over the hole as it is known."""
        axis, z = self._axis, np.array([0.0, 0.0, 1.0])
        sine = np.cross(z, axis)
        tilt = SO3.exp(sine)
        rotation = tilt @ tool_down([0.0, 0.0, 0.0]).rotation()
        end = np.array([*offset, self.item.height - _BELOW_TOP])
        hole = self.simulation.marker_pose("hole seen").translation()
        return SE3.from_rotation_and_translation(rotation, hole - rotation.as_matrix() @ end)

    def _height(self, offset: np.ndarray) -> float:
        """Of the peg's end above the block, as far as that is known [m]."""
        here, top = self.simulation.tool_pose(), self._tool_on_top(offset)
        return float((here.translation() - top.translation()).dot(self._axis))

    def _spiral(self, T_world_tcp: SE3, radius: float) -> tuple[Waypoint, ...]:
        """A square spiral around a tool pose, across the axis of the hole, out to a radius."""
        ways = [T_world_tcp.rotation().as_matrix()[:, i] for i in (0, 1)]
        poses, at, length = [], np.zeros(3), _PITCH
        while length <= 2.0 * radius:
            for way in ways:
                at = at + length * way
                poses.append(SE3.from_translation(at) @ T_world_tcp)
            ways, length = [-way for way in ways], length + _PITCH
        return tuple(
            Waypoint(name=f"search {i + 1}", target=pose, motion=Motion.LIN)
            for i, pose in enumerate(poses)
        )

    def _touched(self) -> Condition:
        def against() -> str | None:
            force = float(self.simulation.felt_force().dot(self._axis))
            force += 9.81 * self.item.mass
            if force >= 0.5 * _TOUCH_FORCE:
                return None
            return f"the peg presses with {force:.1f} N, {_TOUCH_FORCE:.1f} N are due"

        return Condition(name="the peg touches the block", cause=Cause.TIMEOUT, against=against)

    def _sunk(self, touched: SE3) -> Condition:
        axis, start = self._axis, touched.translation()

        def against() -> str | None:
            sunk = float((start - self.simulation.tool_pose().translation()).dot(axis))
            if sunk >= _FALLEN:
                return None
            return f"the peg has sunk by {1e3 * sunk:.1f} mm; {1e3 * _FALLEN:.1f} mm are the hole"

        return Condition(name="the peg is in the hole", cause=Cause.TIMEOUT, against=against)

    def _at_bottom(self, offset: np.ndarray) -> Condition:
        """True where the peg is as deep as the hole, as far as that is known, and stands still."""
        lowest, since = np.inf, self.simulation.time

        def against() -> str | None:
            nonlocal lowest, since
            height, now = self._height(offset), self.simulation.time
            if height < lowest - 1e-4:
                lowest, since = height, now
            if -height >= 0.9 * DEPTH - POSITION_ERROR and now - since >= 0.2:
                return None
            return f"the peg is {-1e3 * height:.1f} mm deep and still sinking, or stuck"

        return Condition(name="the peg is at the bottom", cause=Cause.TIMEOUT, against=against)


def _add_block(body: mujoco.MjsBody) -> None:
    """A block with a hole, the origin in the middle of the hole's upper end."""
    inner = 0.5 * (DIAMETER + CLEARANCE)
    box, turn = mujoco.mjtGeom.mjGEOM_BOX, 2.0 * np.pi / _FACETS
    middle, half = 0.5 * (inner + _OUTER), 0.5 * (_OUTER - inner)
    for i in range(_FACETS):
        body.add_geom(
            name=f"wall{i}",
            type=box,
            pos=[middle * np.cos(i * turn), middle * np.sin(i * turn), -0.5 * DEPTH],
            quat=SO3.from_z_radians(i * turn).wxyz,
            size=[half, _OUTER * np.tan(0.5 * turn), 0.5 * DEPTH],
            rgba=[0.45, 0.50, 0.56, 1.0],
            friction=_FRICTION,
            **_HARD,
        )
    body.add_geom(
        name="bottom",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        pos=[0.0, 0.0, -DEPTH - 0.005],
        size=[_OUTER, 0.005, 0.0],
        rgba=[0.45, 0.50, 0.56, 1.0],
        friction=_FRICTION,
        **_HARD,
    )
