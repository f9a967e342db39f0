"""Wipe a board of unknown height with a sponge that is pressed on with a constant force."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.arrays import CountOrZero, Positive
from robo47_qp.run.failure import Cause, Failure, StepFailed
from robo47_qp.run.steps import StepLike
from robo47_qp.run.task import Program, Task, option
from robo47_qp.sim.sensed import HIDDEN_BELOW, Sensed
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.goal import on_table
from robo47_qp.tasks.handling.held_item import HeldItem
from robo47_qp.tasks.handling.item_handler import HOME, LOST
from robo47_qp.tasks.handling.place_criterion import END, PlaceCriterion, miss, unfinished
from robo47_qp.tasks.handling.pose_estimate import estimate_poses
from robo47_qp.tasks.heading import upright
from robo47_qp.tasks.table import TABLE_TOP, add_table
from robo47_qp.tasks.task_state import task_state
from robo47_qp.tasks.wipe.board import (
    DIRTY,
    HEIGHT_ERROR,
    MARKS,
    OUTSIDE,
    PRESSED,
    SLIDING,
    SURFACE,
    WipeMonitor,
    WipeSettings,
    add_board,
    mark,
    marks_left,
    marks_seen,
)
from robo47_qp.tasks.wipe.board_wiper import BoardWiper
from robo47_qp.tasks.wipe.sponge import Sponge

_SPONGE = (0.085, 0.04, 0.065)


@dataclass(frozen=True, kw_only=True)
class Wipe(Task):
    """Pick the sponge, wipe all marks off the board, and put the sponge back.

    A mark is wiped off when the sponge passes over it with at least `force_least`. While the sponge
    slides over the board, its force must be within `band` of `force` for at least 99 % of the time;
    at the end the marks are gone, the sponge is back, the gripper open and the arm home.
    """

    force: Positive = option(WipeSettings.force, "Force that the sponge is pressed with [N].")
    sponge: Sponge = field(
        default_factory=lambda: Sponge(
            name="sponge", size=_SPONGE, mass=0.04, rgba=(0.20, 0.45, 0.30, 1.0)
        )
    )
    grip_force: Positive = 30.0
    """Force of one finger on the sponge [N]."""
    place_tolerance: Positive = 0.01
    """Largest distance of the sponge from its place at the end [m]."""
    retries: CountOrZero = 2
    """Further attempts after a lost sponge or marks that were missed."""
    opening_needed: ClassVar[float | None] = 0.041
    name: str = "wipe"

    def __post_init__(self) -> None:
        """Check the fields; see `Checked` and `WipeSettings`."""
        super().__post_init__()
        self.settings  # noqa: B018  # checks the force

    @property
    def settings(self) -> WipeSettings:
        """Force and speed of the sponge on the board."""
        return WipeSettings(force=self.force)

    @property
    def force_max(self) -> float:
        """Three times the force; see `Task.force_max` [N]."""
        return 3.0 * self.force

    @property
    def time_limit(self) -> float:
        """See `Task.time_limit` [s]."""
        return 300.0

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        """See `Task.build_scene`."""
        add_table(spec)
        add_board(spec)
        self.sponge.add(spec, (0.45, 0.25, TABLE_TOP + 0.5 * self.sponge.height))
        _add_outline(spec, self.sponge)

    def reset(self, simulation: Simulation, rng: np.random.Generator | None) -> None:
        """See `Task.reset`."""
        board, start = upright([0.48, -0.06, SURFACE], 0.0), upright([0.42, 0.26, TABLE_TOP], 0.0)
        marks = np.array([[(-1) ** i * 0.05, 0.02 * i - 0.07] for i in range(MARKS)])
        if rng is not None:
            height = SURFACE + rng.uniform(-HEIGHT_ERROR, HEIGHT_ERROR)
            x, y = rng.uniform(0.44, 0.52), rng.uniform(-0.12, -0.02)
            board = upright([x, y, height], rng.uniform(-np.pi / 4, np.pi / 4))
            x, y = rng.uniform(0.35, 0.55), rng.uniform(0.24, 0.34)
            start = upright([x, y, TABLE_TOP], rng.uniform(-np.pi, np.pi))
            marks = rng.uniform(-1.0, 1.0, (MARKS, 2)) * DIRTY
        task_state(simulation)[:] = 0.0
        simulation.place_marker("board", board)
        simulation.place_marker("place of the sponge", start)
        up = SE3.from_translation(np.array([0.0, 0.0, 0.5 * self.sponge.height]))
        simulation.place_object(self.sponge.name, start @ up)
        if rng is not None:
            self.sponge.draw_friction(simulation, rng)
        for i, (x, y) in enumerate(marks):
            place = SE3.from_translation(np.array([x, y, 0.0]))
            simulation.place_marker(mark(i), board @ place)

    def as_seen(self, name: str, T_world_thing: SE3) -> SE3:
        """See `Task.as_seen`: the height of the board and its marks is the nominal one."""
        x, y, z = T_world_thing.translation()
        if z < HIDDEN_BELOW or (name != "board" and name not in map(mark, range(MARKS))):
            return T_world_thing
        return SE3.from_rotation_and_translation(
            T_world_thing.rotation(), np.array([x, y, SURFACE])
        )

    def preview(self, sensed: Sensed) -> Sequence[StepLike]:
        """See `Task.preview`."""
        hand = self._wiper(sensed, sensed.seen_pose("board"))
        T_world_sponge = sensed.seen_pose(self.sponge.name)
        *approach, descend = hand.approach(T_world_sponge)
        grasp = self.sponge.grasp(T_world_sponge, sensed.gripper.width_max)
        lift = hand.lift(grasp, T_world_sponge)
        above, hover = hand.to_board()
        return [*approach, descend, lift, above, hover, above.onward[1:], HOME]

    def program(self, sensed: Sensed) -> Program:
        """See `Task.program`."""
        names = ("board", "place of the sponge", self.sponge.name)
        seen = yield from estimate_poses(sensed, names)
        hand = self._wiper(sensed, seen["board"])
        home = SE3.from_translation(np.array([0.0, 0.0, 0.5 * self.sponge.height]))
        back = on_table(seen["place of the sponge"]) @ home
        held: HeldItem | None = None
        for attempt in range(1 + self.retries):
            try:
                if held is None:
                    held = yield from hand.pick(None if attempt else seen[self.sponge.name])
                    hand = hand.holding(held)
                yield from hand.wipe()
                if marks_seen(sensed) and attempt < self.retries:
                    continue
                yield from hand.place(back, held)
            except StepFailed as error:
                if error.failure.cause not in LOST:
                    raise
                held = None
                yield from hand.back_off()
                if attempt == self.retries:
                    yield HOME
                    raise
            else:
                break
        yield hand.retreat(sensed.tool_pose())
        yield HOME
        return None

    @cached_property
    def placed(self) -> PlaceCriterion:
        """When the sponge counts as back in its place."""
        return PlaceCriterion(distance=self.place_tolerance)

    @property
    def judged(self) -> Sequence[str]:
        """See `Task.judged`."""
        return (
            f"no mark is left; the sponge wipes one off that it touches with at least "
            f"{self.settings.force_least:g} N",
            self._settings_words,
            f"the sponge: {self.placed.pose_words}",
            self.placed.rest_words,
            END,
        )

    @property
    def _settings_words(self) -> str:
        return (
            f"while the sponge slides on the board, faster than {1e3 * SLIDING:g} mm/s and pressed "
            f"with more than {PRESSED * self.force:g} N, its force within "
            f"{100 * self.settings.band:g} % of {self.force:g} N for {100 * (1 - OUTSIDE):g} % of "
            "the time"
        )

    def monitor(self, simulation: Simulation) -> None:
        """See `Task.monitor`."""
        self.placed.monitor(simulation, (self.sponge.name,))
        self._monitor(simulation).update()

    def verdict(self, simulation: Simulation) -> Failure | None:
        """See `Task.verdict`."""
        left = len(marks_left(simulation))
        against = f"{left} of {MARKS} marks are left; allowed is none" if left else None
        place = self._place(simulation)
        against = against or self.placed.against(simulation, self.sponge, place)
        against = against or self._monitor(simulation).against_force()
        if against is not None:
            return Failure(cause=Cause.PLACE, evidence=against)
        return unfinished(simulation)

    def measures(self, simulation: Simulation) -> dict[str, float]:
        """Return the number of remaining marks [-], and the errors of the sponge's position [m],
        heading and tilt [rad]."""
        pose = simulation.object_pose(self.sponge.name)
        off = miss(self.sponge, pose, self._place(simulation))
        return {
            "marks_left": float(len(marks_left(simulation))),
            "sponge_error_m": off.distance,
            "sponge_turn_rad": off.turn,
            "sponge_tilt_rad": off.tilt,
        }

    def _place(self, simulation: Simulation) -> SE3:
        """Return T_world_sponge of the sponge in its place."""
        height = self.sponge.as_in(simulation).height
        up = SE3.from_translation(np.array([0.0, 0.0, 0.5 * height]))
        return simulation.marker_pose("place of the sponge") @ up

    def _wiper(self, sensed: Sensed, T_world_board: SE3) -> "BoardWiper":
        above = SURFACE + 0.10 + self.sponge.height
        return BoardWiper(
            sensed=sensed,
            item=self.sponge,
            above=above,
            force=self.grip_force,
            resting=TABLE_TOP + 0.5 * self.sponge.height,
            settings=self.settings,
            T_world_board=T_world_board,
        )

    def _monitor(self, simulation: Simulation) -> WipeMonitor:
        return WipeMonitor(simulation, self.sponge, self.settings)


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
