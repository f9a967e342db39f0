"""Wipe a board of unknown height with a sponge that is pressed with a constant force."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.errors import InvalidValueError
from robo47_qp.failure import Cause, Failure, StepFailed
from robo47_qp.obstacle import Obstacle
from robo47_qp.simulation import Simulation
from robo47_qp.steps import Compliance, Comply, Condition, Move, Step
from robo47_qp.task import Program
from robo47_qp.waypoint import Motion, Waypoint, tool_down
from tasks.handling import HOME, LOST, Handling
from tasks.headings import heading, upright
from tasks.item import Item
from tasks.table import TABLE_TOP, add_table

SURFACE = TABLE_TOP + 0.03
"""Height of the board's surface as far as the robot knows [m]."""
HEIGHT_ERROR = 5e-3
"""How far the surface may be from there [m]."""
BOARD = (0.19, 0.29)
"""Lengths of the board along its x and y [m]."""
_STROKE, _LANES = 0.09, (-0.04, 0.0, 0.04)
"""Half the length of a stroke along the board's y, and where the strokes are in its x [m]."""
_DIRTY = (0.065, 0.085)
"""Marks are at most so far from the board's centre, along its x and y [m]."""
_MARKS = 8
_SOFT = [-700.0, -12.0]
"""Stiffness and damping of the foam as MuJoCo's solref, which refers to the sponge's mass: with the
40 g and four corners that it has here, 10 N press the foam in by 9 mm. Where it slides with a
speed v, MuJoCo's convex friction lifts it by μ v times their ratio: 0.4 mm [1/s², 1/s]."""
_FIRM = np.array([3000.0] * 3 + [100.0] * 3)
"""Stiffness of the tool on the board [N/m, N·m/rad]."""
_SPONGE = (0.085, 0.04, 0.065)
_LET_DOWN = SURFACE + 0.5 * _SPONGE[2] + 0.015
"""Height of the tool from which the sponge is let down: 15 mm above the surface, as far as that
is known [m]."""


@dataclass(frozen=True, kw_only=True)
class Sponge(Item):
    """A stiff back that the fingers hold, and under it a foam that gives way."""

    foam_height: float = 0.025
    """[m]"""
    foam_friction: float = 0.3
    """On whatever it touches [-]."""

    @property
    def foam(self) -> tuple[float, float]:
        """Lengths of the foam along x and y; the fingers do not touch it [m]."""
        return self.size[0], self.size[1] - 0.004

    def add(self, spec: mujoco.MjSpec, position: tuple[float, float, float]) -> None:
        """See `Item.add`."""
        x, y, z = self.size
        deep, soft = self.foam_height, 0.25 * self.mass
        body = spec.worldbody.add_body(name=self.name, pos=position)
        body.add_freejoint()
        box = mujoco.mjtGeom.mjGEOM_BOX
        body.add_geom(
            name=self.name,
            type=box,
            pos=[0.0, 0.0, 0.5 * deep],
            size=[0.5 * x, 0.5 * y, 0.5 * (z - deep)],
            mass=self.mass - soft,
            rgba=self.rgba,
        )
        body.add_geom(
            name="foam",
            type=box,
            pos=[0.0, 0.0, 0.5 * (deep - z)],
            size=[0.5 * self.foam[0], 0.5 * self.foam[1], 0.5 * deep],
            mass=soft,
            rgba=[0.95, 0.80, 0.25, 1.0],
            friction=[self.foam_friction, 0.005, 1e-4],
            # Its own softness and friction hold, whatever it touches.
            priority=1,
            solref=_SOFT,
            solimp=[0.9, 0.9, 1e-3, 0.5, 2.0],
        )


@dataclass(frozen=True, kw_only=True)
class Wipe:
    """Take the sponge, wipe all marks off the board, and put the sponge back where it was.

    A mark is wiped once the sponge has passed over it, pressed with at least `force_least`.
    While the sponge slides, its force has to be within `band` of `force` in at least 99 % of
    the time; at the end the marks are gone, the sponge is back, the gripper open, the arm home.
    """

    force: float = 10.0
    """What the sponge is pressed with [N]."""
    force_least: float = 5.0
    """What it takes to wipe a mark off [N]."""
    band: float = 0.05
    """How far the force may be from the one asked for, relative to it [-]."""
    speed: float = 0.08
    """Of the sponge on the board [m/s]."""
    touch_speed: float = 0.1
    """At which the sponge meets the board, at most [m/s]."""
    sponge: Sponge = field(
        default_factory=lambda: Sponge(
            name="sponge", size=_SPONGE, mass=0.04, rgba=(0.20, 0.45, 0.30, 1.0)
        )
    )
    retries: int = 2
    """Further attempts after a lost sponge or marks that were missed."""
    force_max: float = 30.0
    """Three times the force: see `Task.force_max` [N]."""
    obstacles: tuple[Obstacle, ...] = ()
    """The board is to be touched."""
    name: str = "wipe"

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: One is not positive.
        """
        for name in ("force", "force_least", "band", "speed", "touch_speed"):
            if not getattr(self, name) > 0.0:
                raise InvalidValueError(name, getattr(self, name), "positive")

    def variant(self, rng: np.random.Generator) -> "Wipe":
        """The same: what differs are poses and heights."""
        return self

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        """See `Task.build_scene`."""
        add_table(spec)
        box, disc = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER
        board = spec.worldbody.add_body(name="board", mocap=True)
        x, y = BOARD
        board.add_geom(
            name="board",
            type=box,
            pos=[0.0, 0.0, -0.015],
            size=[0.5 * x, 0.5 * y, 0.015],
            rgba=[0.93, 0.94, 0.96, 1.0],
        )
        for i in range(_MARKS):
            mark = spec.worldbody.add_body(name=_mark(i), mocap=True)
            mark.add_geom(
                name=_mark(i),
                type=disc,
                size=[0.005, 2e-4, 0.0],
                rgba=[0.25, 0.16, 0.10, 1.0],
                contype=0,
                conaffinity=0,
            )
        self.sponge.add(spec, (0.45, 0.25, TABLE_TOP + 0.5 * self.sponge.height))
        _add_outline(spec, self.sponge)

    def reset(self, simulation: Simulation, rng: np.random.Generator | None) -> None:
        """See `Task.reset`."""
        board, start = upright([0.48, -0.06, SURFACE], 0.0), upright([0.42, 0.26, TABLE_TOP], 0.0)
        marks = np.array([[(-1) ** i * 0.05, 0.02 * i - 0.07] for i in range(_MARKS)])
        if rng is not None:
            height = SURFACE + rng.uniform(-HEIGHT_ERROR, HEIGHT_ERROR)
            x, y = rng.uniform(0.44, 0.52), rng.uniform(-0.12, -0.02)
            board = upright([x, y, height], rng.uniform(-np.pi / 4, np.pi / 4))
            x, y = rng.uniform(0.35, 0.55), rng.uniform(0.24, 0.34)
            start = upright([x, y, TABLE_TOP], rng.uniform(-np.pi, np.pi))
            marks = rng.uniform(-1.0, 1.0, (_MARKS, 2)) * _DIRTY
        simulation.place_marker("board", board)
        simulation.place_marker("place of the sponge", start)
        up = SE3.from_translation(np.array([0.0, 0.0, 0.5 * self.sponge.height]))
        simulation.place_object(self.sponge.name, start @ up)
        for i, (x, y) in enumerate(marks):
            place = SE3.from_translation(np.array([x, y, 0.0]))
            simulation.place_marker(_mark(i), board @ place)

    def outlook(self, simulation: Simulation) -> Sequence[Step]:
        """See `Task.outlook`."""
        hand = self._wiper(simulation)
        T_world_sponge = simulation.object_pose(self.sponge.name)
        *approach, descend = hand.approach(T_world_sponge)
        grasp = self.sponge.grasp(T_world_sponge, simulation.gripper.width_max)
        lift = hand.lift(grasp, T_world_sponge)
        return [*approach, descend, lift, *hand.to_board(), *hand.strokes(), HOME]

    def program(self, simulation: Simulation) -> Program:
        """See `Task.program`."""
        hand = self._wiper(simulation)
        home = SE3.from_translation(np.array([0.0, 0.0, 0.5 * self.sponge.height]))
        back = simulation.marker_pose("place of the sponge") @ home
        held = False
        for attempt in range(1 + self.retries):
            try:
                if not held:
                    yield from hand.pick()
                    held = True
                yield from hand.wipe()
                if hand.marks_left() and attempt < self.retries:
                    continue
                yield from hand.place(back)
            except StepFailed as error:
                if error.failure.cause not in LOST:
                    raise
                held = False
                yield from hand.back_off()
                if attempt == self.retries:
                    yield HOME
                    raise
            else:
                break
        yield hand.retreat(simulation.tool_pose())
        yield HOME
        return hand.notes.against_force(self.band)

    def verdict(self, simulation: Simulation) -> Failure | None:
        """See `Task.verdict`."""
        measures = self.measures(simulation)
        left, off = round(measures["marks_left"]), measures["sponge_error_m"]
        away = float(np.abs(simulation.state().q - simulation.robot.home).max())
        width, open_width = simulation.width(), simulation.gripper.width_max - 1e-3
        speed = float(np.linalg.norm(simulation.object_twist(self.sponge.name)[:3]))
        if left or off > 0.01 or speed > 1e-3 or away > 0.01 or width < open_width:
            evidence = (
                f"{left} of {_MARKS} marks are left, the sponge is {1e3 * off:.1f} mm from its "
                f"place and moves at {1e3 * speed:.1f} mm/s, a joint is {away:.3f} rad from home, "
                f"the gripper is open {1e3 * width:.1f} mm; allowed are 0, 10.0 mm, 1 mm/s, "
                f"0.01 rad, at least {1e3 * open_width:.1f} mm"
            )
            return Failure(cause=Cause.PLACE, evidence=evidence)
        return None

    def measures(self, simulation: Simulation) -> dict[str, float]:
        """Marks that are left [-], and how far the sponge is from its place [m]."""
        place = simulation.marker_pose("place of the sponge").translation()
        up = np.array([0.0, 0.0, 0.5 * self.sponge.height])
        sponge = simulation.object_pose(self.sponge.name).translation()
        return {
            "marks_left": float(len(_marks_left(simulation))),
            "sponge_error_m": float(np.linalg.norm(sponge - place - up)),
        }

    def _wiper(self, simulation: Simulation) -> "Wiper":
        above = SURFACE + 0.10 + self.sponge.height
        notes = Notes(simulation, self)
        return Wiper(
            simulation=simulation,
            item=self.sponge,
            above=above,
            force=40.0,
            task=self,
            notes=notes,
        )


class Notes:
    """What becomes of the marks, and how well the force is held, while the sponge slides."""

    def __init__(self, simulation: Simulation, task: Wipe) -> None:
        """Nothing has been seen yet."""
        self._simulation, self._task = simulation, task
        self.sliding = self.outside = 0
        """How often the sponge was seen sliding, and how often with a force out of its band."""
        self.worst = task.force
        """The force then that was furthest from the one asked for [N]."""

    def pressed(self) -> float:
        """Force of the sponge on the board [N]: that on the hand without the sponge's weight."""
        force = float(self._simulation.last_tool_force()[2])
        return force + 9.81 * self._task.sponge.mass

    def take(self) -> None:
        """Look once: wipe marks off, and take note of the force while the sponge slides."""
        simulation, task = self._simulation, self._task
        force = self.pressed()
        if force >= task.force_least:
            self._wipe_off()
        twist = simulation.object_twist(task.sponge.name)
        if np.hypot(twist[0], twist[1]) > 5e-3 and force > 0.1 * task.force:
            self.sliding += 1
            off = abs(force - task.force)
            self.outside += off > task.band * task.force
            if off > abs(self.worst - task.force):
                self.worst = force

    def against_force(self, band: float) -> Failure | None:
        """What speaks against the force having been held; None where it was."""
        if self.sliding and self.outside <= 0.01 * self.sliding:
            return None
        share = 100.0 * self.outside / max(1, self.sliding)
        evidence = (
            f"the force was off by more than {100 * band:.0f} % for {share:.1f} % of the time of "
            f"sliding, {self.worst:.2f} N at worst; allowed is 1 %"
        )
        return Failure(cause=Cause.PLACE, evidence=evidence)

    def _wipe_off(self) -> None:
        simulation, sponge = self._simulation, self._task.sponge
        T_sponge_world = simulation.object_pose(sponge.name).inverse()
        for i in _marks_left(simulation):
            at = T_sponge_world @ simulation.marker_pose(_mark(i)).translation()
            if (np.abs(at[:2]) <= 0.5 * np.array(sponge.foam)).all():
                gone = SE3.from_translation(np.array([0.0, 0.0, -1.0]))
                simulation.place_marker(_mark(i), gone)


@dataclass(frozen=True, kw_only=True, eq=False)
class Wiper(Handling):
    """Handles the sponge, and wipes with it."""

    task: Wipe
    notes: Notes

    def wipe(self) -> Generator[Step, None, None]:
        """To the board, down on it, along the strokes, and up; fails with DROP or TIMEOUT."""
        yield Move(
            waypoints=self.to_board(),
            before=(self._held(Cause.DROP),),
            during=(self._held(Cause.DROP),),
        )
        pressing = Compliance(
            stiffness=_FIRM,
            axis=np.array([0.0, 0.0, -1.0]),
            force=self.task.force,
            speed=self.task.touch_speed,
        )
        held = (self._held(Cause.DROP),)
        yield Comply(
            name="touch down",
            waypoints=(),
            compliance=pressing,
            seconds=2.0,
            until=self._in_contact(),
            during=held,
            stay=True,
        )
        yield Comply(
            name="settle",
            waypoints=(),
            compliance=pressing,
            seconds=2.0,
            until=self._pressed(),
            during=held,
            stay=True,
        )
        yield Comply(
            name="wipe",
            # Level, at the height at which the tool is now.
            waypoints=self.strokes(self.simulation.tool_pose().translation()[2]),
            compliance=pressing,
            renew=True,
            speed=self.task.speed,
            during=held,
            observe=self.notes.take,
        )
        off = self._line("lift off", self._up(self.simulation.tool_pose()))
        yield Comply(
            name="lift off", waypoints=(off,), compliance=Compliance(stiffness=_FIRM), during=held
        )

    def marks_left(self) -> list[int]:
        """Numbers of the marks on the board."""
        return _marks_left(self.simulation)

    def to_board(self) -> tuple[Waypoint, Waypoint]:
        """To above the first stroke, and down to a little above the board."""
        strokes = self.strokes()
        start = self._over(_LANES[0], -_STROKE, _LET_DOWN)
        payload = self.item.payload(SE3.identity())
        hover = Waypoint(name="hover", target=start, motion=Motion.LIN, carried=payload)
        above = self._up(start)
        onward = (hover, *strokes)
        return Waypoint(name="to the board", target=above, carried=payload, onward=onward), hover

    def strokes(self, height: float = _LET_DOWN) -> tuple[Waypoint, ...]:
        """Up and down the board, without a stop between, the tool at a height [m]."""
        ways, end = [], _STROKE
        for i, x in enumerate(_LANES):
            if i:
                centre = self._over(0.5 * (x + _LANES[i - 1]), -end, height)
                middle = centre.translation() - np.sign(end) * 0.5 * (x - _LANES[i - 1]) * self._y()
                ways.append(
                    Waypoint(
                        name=f"turn {i}",
                        target=self._over(x, -end, height),
                        motion=Motion.CIRC,
                        through=middle,
                        blend=0.01,
                    )
                )
            last = i == len(_LANES) - 1
            ways.append(
                Waypoint(
                    name=f"stroke {i + 1}",
                    target=self._over(x, end, height),
                    motion=Motion.LIN,
                    blend=0.0 if last else 0.01,
                )
            )
            end = -end
        return tuple(ways)

    def _over(self, x: float, y: float, height: float) -> SE3:
        """Tool pose over a place of the board, at a height in the world [m]."""
        T_world_board = self.simulation.marker_pose("board")
        at = T_world_board @ np.array([x, y, 0.0])
        at[2] = height
        return tool_down(at, heading(T_world_board))

    def _y(self) -> np.ndarray:
        """Direction of the strokes (3,) [-]."""
        return self.simulation.marker_pose("board").rotation().as_matrix()[:, 1]

    def _pressed(self) -> Condition:
        """True once the force has been close to the one asked for, for a while."""
        since = self.simulation.time

        def against() -> str | None:
            nonlocal since
            now, force = self.simulation.time, self.notes.pressed()
            if abs(force - self.task.force) > 0.02 * self.task.force:
                since = now
            if now - since >= 0.1:
                return None
            return f"the sponge presses with {force:.2f} N, {self.task.force:.2f} N are asked for"

        return Condition(name="the force is steady", cause=Cause.TIMEOUT, against=against)

    def _in_contact(self) -> Condition:
        def against() -> str | None:
            force = self.notes.pressed()
            if force >= 0.5 * self.task.force:
                return None
            return f"the sponge presses with {force:.1f} N, {self.task.force:.1f} N are asked for"

        return Condition(name="the sponge is on the board", cause=Cause.TIMEOUT, against=against)


def _mark(i: int) -> str:
    return f"mark{i}"


def _marks_left(simulation: Simulation) -> list[int]:
    return [i for i in range(_MARKS) if simulation.marker_pose(_mark(i)).translation()[2] > 0.0]


def _add_outline(spec: mujoco.MjSpec, sponge: Sponge) -> None:
    place = spec.worldbody.add_body(name="place of the sponge", mocap=True)
    x, y, _ = sponge.size
    place.add_geom(
        name="place of the sponge",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[0.5 * x + 0.005, 0.5 * y + 0.005, 5e-4],
        rgba=[0.15, 0.55, 0.30, 1.0],
        contype=0,
        conaffinity=0,
    )
