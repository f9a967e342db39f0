"""Two arms carry a tray, level, over a wall, and set it down."""

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, Self

import mujoco
import numpy as np
from mink import SE3
from scipy.spatial.transform import Rotation

from robo47_qp.arrays import Matrix, Positive, Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.payload import Payload
from robo47_qp.model.tool_poses import ToolPoses
from robo47_qp.motion.waypoint import Motion, Waypoint
from robo47_qp.run.contact_steps import Unload
from robo47_qp.run.failure import Cause, Condition, Failure
from robo47_qp.run.steps import Move, Release, StepLike, Wait
from robo47_qp.run.task import Program, Task, option
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.carry_tray.tray import CUP, NAME, PLATE, Tray
from robo47_qp.tasks.goal import estimate_goal
from robo47_qp.tasks.handling.hand import Hand, settled, still_poses
from robo47_qp.tasks.handling.item_handler import HOME, NEAR
from robo47_qp.tasks.handling.place_criterion import (
    END,
    Miss,
    PlaceCriterion,
    told,
    unfinished,
)
from robo47_qp.tasks.handling.pose_estimate import camera_errs, estimate_pose
from robo47_qp.tasks.heading import level, raised, tilt, upright
from robo47_qp.tasks.table import SURFACE_FRICTION, TABLE_TOP, add_table, check_place
from robo47_qp.tasks.task_state import task_state

_START, _END, _WALL = (0.335, 0.36), (0.64, 0.66), (0.495, 0.505)
"""Ranges of x of random starts, goals and walls [m]."""
_ASIDE, _TURN = 0.04, 0.12
"""Ranges of random starts and goals about the middle: y [m] and heading [rad]."""
_THICK, _HIGH = (0.01, 0.02), (0.03, 0.10)
"""Sizes of random walls [m]."""
_WIDE = 0.20
"""Length of the wall along y [m]."""
_MASSES, _BALLS, _CUPS, _OFF = (0.3, 0.8), (0.02, 0.05), (0.05, 0.2), 0.02
"""Masses of random trays, balls and cups [kg], and their place beside the middle [m]."""
_ABOVE = 0.10
"""Height above the handles from which the hands descend [m]."""
_OVER = 0.05
"""Height of the tray above the wall [m]."""
_TAKE_UP = 0.015
"""Height of the first lift [m]."""
_PACE, _GENTLE = 0.5, 0.2
"""Pace of hands and tray, whose handles creep the more between the fingers the faster it goes; and
that of its first lift, when each hand begins to bear a weight that it does not know [-]."""
_UNLOADS = 3
"""How often: as the forces fade, hands and pads move a little."""
_LET_GO = 1e-3
"""Height from which the tray is let go: a table that takes its weight would push it aside [m]."""
_LIFTED = 5e-3
"""Height above which the tray counts as carried [m]."""
_GOAL, _OBSTACLE = "goal", "wall"
_TILT, _FORCE, _TOUCHED, _WENT = range(4)
"""Task state: largest tilt [rad], largest internal force [N], whether the wall was touched, and
whether the tray was above the wall."""


@dataclass(frozen=True, kw_only=True)
class CarryTray(Task):
    """Both arms hold a tray by its handles and carry it, level, over a wall to its goal.

    It counts as done when the tray is at rest at its goal, was never tilted by more than
    `tilt_max` nor squeezed by more than `squeeze_max`, did not touch the wall, the ball is in its
    dish and the cup stands, the grippers are open and the arms are home.
    """

    default_robot: ClassVar[str] = "panda_pair"
    tools_needed: ClassVar[int] = 2
    opening_needed: ClassVar[float | None] = 0.022

    start: tuple[float, float] = option(
        (0.35, 0.0), "Start of the tray without a seed: x, y [m].", drawn=True
    )
    end: tuple[float, float] = option((0.65, 0.0), "Its goal without a seed: x, y [m].", drawn=True)
    tray: Tray = field(default_factory=Tray)
    """The tray."""
    wall: tuple[float, float, float] = (0.50, 0.015, 0.08)
    """The wall between start and goal: its x, thickness and height [m]."""
    grip_force: Positive = 70.0
    """Force of one finger on a handle [N]."""
    tilt_max: Positive = 2.0
    """Largest tilt of the tray [°]."""
    squeeze_max: Positive = 20.0
    """Largest internal force between the hands [N]."""
    place_tolerance: Positive = 5e-3
    """Largest distance of the tray from its goal [m]."""
    name: str = "carry_tray"

    def __post_init__(self) -> None:
        """Check the fields; see `Checked`."""
        super().__post_init__()
        if min(self.wall[1:]) <= 0.0:
            raise InvalidValueError(
                "wall", self.wall, "a place, and a thickness and height above 0"
            )
        check_place("start", self.start, self.tray.size)
        check_place("end", self.end, self.tray.size)

    @cached_property
    def placed(self) -> PlaceCriterion:
        """When the tray counts as placed."""
        return PlaceCriterion(distance=self.place_tolerance)

    @property
    def judged(self) -> Sequence[str]:
        """See `Task.judged`."""
        placed = self.placed
        return (
            f"the tray: its middle within {1e3 * placed.distance:g} mm of the goal in 3-D, its "
            f"heading within {np.degrees(placed.turn):.3g}°, level within "
            f"{np.degrees(placed.tilt):.3g}°",
            f"tray and cup {placed.rest_words}",
            f"on the way never tilted by more than {self.tilt_max:g}° nor squeezed or pulled by "
            f"more than {self.squeeze_max:g} N, in every period; the tray was over the wall, above "
            "it, and nothing touched the wall at any look, every 20 ms",
            *self.tray.judged,
            END,
        )

    def variant(self, rng: np.random.Generator) -> Self:
        """Return the task with a random tray and wall."""
        tray = Tray(
            mass=rng.uniform(*_MASSES),
            ball_mass=rng.uniform(*_BALLS),
            cup_mass=rng.uniform(*_CUPS),
            aside=rng.uniform(-_OFF, _OFF),
        )
        wall = (rng.uniform(*_WALL), rng.uniform(*_THICK), rng.uniform(*_HIGH))
        return replace(self, tray=tray, wall=wall)

    @property
    def time_limit(self) -> float:
        """See `Task.time_limit` [s]."""
        return 120.0

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        """See `Task.build_scene`."""
        add_table(spec)
        self.tray.add(spec, *self.start, TABLE_TOP)
        x, thick, high = self.wall
        spec.worldbody.add_geom(
            name=_OBSTACLE,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[0.5 * thick, 0.5 * _WIDE, 0.5 * high],
            pos=[x, 0.0, TABLE_TOP + 0.5 * high],
            rgba=[0.45, 0.47, 0.50, 1.0],
            friction=SURFACE_FRICTION,
        )
        marker = spec.worldbody.add_body(name=_GOAL, mocap=True)
        marker.add_geom(
            name=_GOAL,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[0.10, 0.15, 0.0005],
            rgba=[0.15, 0.55, 0.30, 1.0],
            contype=0,
            conaffinity=0,
        )
        PlaceCriterion.add_state(spec, 4)

    def reset(self, simulation: Simulation, rng: np.random.Generator | None) -> None:
        """See `Task.reset`."""
        task_state(simulation)[:] = 0.0
        start, end, turns = np.array(self.start), np.array(self.end), np.zeros(2)
        if rng is not None:
            start = np.array([rng.uniform(*_START), rng.uniform(-_ASIDE, _ASIDE)])
            end = np.array([rng.uniform(*_END), rng.uniform(-_ASIDE, _ASIDE)])
            turns = rng.uniform(-_TURN, _TURN, 2)
        self.tray.place(simulation, upright([*start, TABLE_TOP], turns[0]))
        simulation.place_marker(_GOAL, upright([*end, TABLE_TOP], turns[1]))

    def preview(self, sensed: Sensed) -> Sequence[StepLike]:
        """See `Task.preview`."""
        tray = sensed.seen_pose(NAME)
        hands, goal = self._hands(sensed), sensed.seen_pose(_GOAL)
        grasps = self._grasps(hands, tray)
        holding = grasps.each(lambda _, pose: tray.inverse() @ pose)
        return [(*self._approach(grasps), *self._way(tray, holding, raised(goal, _LET_GO))), HOME]

    def program(self, sensed: Sensed) -> Program:
        """See `Task.program`."""
        hands = self._hands(sensed)
        goal = yield from estimate_goal(sensed)
        tray = yield from estimate_pose(sensed, NAME, TABLE_TOP)
        above, down = self._approach(self._grasps(hands, level(tray)))
        yield replace(above, onward=(down,))
        yield down
        free = {}
        for hand in hands:
            free[hand.name] = yield from hand.felt()
        for hand in hands:
            yield from hand.grasp(self.tray.handle_width, self.grip_force)
        # What the hands were off the handles is not to be carried along as an internal force.
        for _ in range(_UNLOADS):
            yield Unload()
        tray = yield from estimate_pose(sensed, NAME, TABLE_TOP)
        tray = level(tray)
        poses = yield from still_poses(hands)
        # One reading was the reference since; the hands are not to be led from it to the mean.
        yield self._carrying(hands, Waypoint(name="hold", target=poses, motion=Motion.LIN))
        holding = poses.each(lambda _, pose: tray.inverse() @ pose)
        loads = yield from self._take_up(sensed, tray, holding, free)
        goal, errs = level(goal), camera_errs(sensed)
        for waypoint in self._way(tray, holding, raised(goal, NEAR if errs else _LET_GO)):
            yield self._carrying(hands, replace(waypoint, carried=loads))
        if errs:
            # Beside its goal, both are seen with the same error of the camera's calibration.
            seen = yield from estimate_pose(sensed, NAME, goal.translation()[2])
            end = goal @ level(seen).inverse() @ raised(goal, _LET_GO)
            waypoint = _line("put down", end, holding)
            yield self._carrying(hands, replace(waypoint, carried=loads))
        for hand in hands:
            yield Release(name="let go", tool=hand.name)
        up = ToolPoses({hand.name: raised(hand.pose(), _ABOVE) for hand in hands})
        yield Waypoint(name="retreat", target=up, motion=Motion.LIN, pace=_PACE)
        yield HOME
        return None

    def monitor(self, simulation: Simulation) -> None:
        """See `Task.monitor`: note tilt, internal force and the wall while the tray is carried.

        In every control period where these are recorded, but for contacts with the wall: these are
        not, and are looked at now.
        """
        self.placed.monitor(simulation, (NAME, CUP))
        tray, robot = simulation.object_pose(NAME), simulation.robot
        pose = np.concatenate([tray.translation(), tray.rotation().wxyz])
        self._note(simulation, pose[None], [simulation.last_tool_force(i)[None] for i in (0, 1)])
        if simulation.lately is not None:
            felt = [simulation.lately(f"contact/{label}tool") for label, _ in robot.tool_labels()]
            self._note(simulation, simulation.lately(f"objects/{NAME}"), felt)
        if _touches_wall(simulation):
            task_state(simulation)[_TOUCHED] = 1.0

    def _note(self, simulation: Simulation, poses: Matrix, felt: Sequence[Matrix]) -> None:
        """Note what counts of some poses of the tray (N, 7) and forces on the hands (N, 3) [N]."""
        notes, lifted = task_state(simulation), poses[:, 2] - TABLE_TOP > _LIFTED
        if not lifted.any():
            return
        at, turns = poses[lifted, :3], Rotation.from_quat(poses[lifted, 3:], scalar_first=True)
        R = turns.as_matrix()
        tilts = np.arctan2(np.hypot(R[:, 2, 0], R[:, 2, 1]), R[:, 2, 2])
        notes[_TILT] = max(notes[_TILT], tilts.max())
        left, right = felt[:2]
        notes[_FORCE] = max(notes[_FORCE], squeeze(left, right)[lifted].max())
        x, thick, high = self.wall
        reach = np.abs(R[:, :2]) @ PLATE + 0.5 * np.array([thick, _WIDE])
        over = (np.abs(at[:, :2] - [x, 0.0]) < reach).all(axis=1)
        if (over & (at[:, 2] - TABLE_TOP > high)).any():
            notes[_WENT] = 1.0

    def verdict(self, simulation: Simulation) -> Failure | None:
        """See `Task.verdict`."""
        figures, notes = self.measures(simulation), task_state(simulation)
        if notes[_TOUCHED]:
            return Failure(cause=Cause.COLLISION, evidence="the wall was touched")
        against = [self.tray.lost(simulation)]
        for name, limit, text in (
            ("tilt_max_deg", self.tilt_max, "the tray was tilted by {:.2f}°; allowed are {:.2f}°"),
            (
                "internal_force_N",
                self.squeeze_max,
                "the hands squeezed or pulled it with {:.1f} N; allowed are {:.1f} N",
            ),
        ):
            if figures[name] > limit:
                against.append(text.format(figures[name], limit))
        against.append(self._against_end(simulation))
        if not notes[_WENT]:
            against.append("the tray was never above the wall")
        evidence = "; ".join(text for text in against if text is not None)
        if evidence:
            return Failure(cause=Cause.PLACE, evidence=evidence)
        return unfinished(simulation)

    def measures(self, simulation: Simulation) -> dict[str, float]:
        """Return the errors of the tray's position [m] and heading [rad], and the largest tilt [°]
        and internal force [N] on the way."""
        off, notes = self._miss(simulation), task_state(simulation)
        return {
            "place_error_m": off.distance,
            "place_turn_rad": off.turn,
            "tilt_max_deg": float(np.degrees(notes[_TILT])),
            "internal_force_N": float(notes[_FORCE]),
        }

    def _miss(self, simulation: Simulation) -> Miss:
        """Return how far the tray is from its goal; half a turn would swap dish and cup."""
        tray, goal = simulation.object_pose(NAME), self._goal(simulation)
        turn = (goal.inverse() @ tray).rotation().log()[2]
        off = float(np.linalg.norm(tray.translation() - goal.translation()))
        return Miss(distance=off, turn=abs(float(turn)), tilt=tilt(tray))

    def _against_end(self, simulation: Simulation) -> str | None:
        """Return why the tray is not placed at its goal; None if it is."""
        reasons = self.placed.against_pose(self._miss(simulation))
        return told("the tray", reasons) or self.placed.against_rest(simulation, (NAME, CUP))

    def _take_up(
        self, sensed: Sensed, tray: SE3, holding: ToolPoses, free: Mapping[str, float]
    ) -> Generator[StepLike, None, dict[str, Payload]]:
        """Lift the tray a little, and return what each hand carries by its own sensor.

        Args:
            sensed: What is sensed.
            tray: T_world_tray as it stands.
            holding: T_tray_tcp of the hands.
            free: What each hand felt before, by its name [N]; see `Hand.felt`.
        """
        hands = self._hands(sensed)
        loads = {hand.name: _load(0.5 * self.tray.whole_mass) for hand in hands}
        up = _line("take up", raised(tray, _TAKE_UP), holding)
        up = replace(up, carried=loads, pace=_GENTLE)
        yield self._carrying(hands, up)
        yield Wait(name="weigh", seconds=0.1)
        shares = {}
        for hand in hands:
            shares[hand.name] = yield from hand.weigh(free[hand.name])
        least = 0.05 * self.tray.whole_mass
        loads = {name: _load(max(share, least)) for name, share in shares.items()}
        yield from settled(replace(up, carried=loads))
        return loads

    def _approach(self, grasps: ToolPoses) -> tuple[Waypoint, ...]:
        """Return the waypoints of both hands above the handles and down to them."""
        above = grasps.each(lambda _, pose: raised(pose, _ABOVE))
        down = Waypoint(name="descend", target=grasps, motion=Motion.LIN, pace=_PACE)
        return Waypoint(name="approach", target=above), down

    def _way(self, tray: SE3, holding: ToolPoses, goal: SE3) -> tuple[Waypoint, ...]:
        """Return the straight ways of the tray up, over the wall and down to a goal."""
        top = TABLE_TOP + self.wall[2] + _OVER
        high, over = top - tray.translation()[2], raised(goal, top - goal.translation()[2])
        ways = (("lift", raised(tray, high)), ("cross", over), ("lower", goal))
        return tuple(_line(name, pose, holding) for name, pose in ways)

    def _carrying(self, hands: Sequence[Hand], waypoint: Waypoint) -> Move:
        width, force = self.tray.handle_width, self.grip_force
        held: tuple[Condition, ...] = tuple(h.holds(width, force, Cause.DROP) for h in hands)
        return Move(waypoints=(waypoint,), before=held, during=held)

    def _grasps(self, hands: Sequence[Hand], tray: SE3) -> ToolPoses:
        left, right = (hand.name for hand in hands)
        return ToolPoses({left: self.tray.grasp(tray, 1.0), right: self.tray.grasp(tray, -1.0)})

    def _hands(self, sensed: Sensed) -> tuple[Hand, ...]:
        tools = sensed.robot.tools[:2]
        return tuple(Hand(sensed=sensed, name=tool.name) for tool in tools)

    def _goal(self, simulation: Simulation) -> SE3:
        return simulation.marker_pose(_GOAL)


def squeeze(left: Matrix, right: Matrix) -> Vector:
    """Return the internal force of two hands on what both hold (N,), from that on each (N, 3) [N].

    The part of their contact forces that moves nothing: half the difference of what they feel,
    of which the weight they share cancels.
    """
    force: Vector = 0.5 * np.linalg.norm(left - right, axis=1)
    return force


def _line(name: str, tray: SE3, holding: ToolPoses) -> Waypoint:
    """Return a straight way of the tray."""
    return Waypoint(name=name, target=tray, holding=holding, motion=Motion.LIN, pace=_PACE)


def _load(mass: float) -> Payload:
    """Return a share of the tray that hangs at a hand."""
    small = 1e-5 * mass
    return Payload(mass=mass, inertia=(small, small, small), T_tcp_com=SE3.identity())


def _touches_wall(simulation: Simulation) -> bool:
    m, contact = simulation.model, simulation.data.contact
    wall = m.geom(_OBSTACLE).id
    return bool((contact.geom == wall).any())
