"""Insert a peg into a hole whose pose is less certain than the clearance, by compliant search."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import mujoco
import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import CountOrZero, Longest, Positive
from robo47_qp.errors import InvalidValueError
from robo47_qp.run.failure import Cause, Failure, StepFailed
from robo47_qp.run.steps import Release, StepLike
from robo47_qp.run.task import Program, Task
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.handling.item_handler import HOME, LOST
from robo47_qp.tasks.handling.place_criterion import END, PlaceCriterion, told, unfinished
from robo47_qp.tasks.handling.pose_estimate import camera_errs, estimate_pose
from robo47_qp.tasks.handling.wrist import wrist_errs
from robo47_qp.tasks.heading import upright
from robo47_qp.tasks.peg_insert.feeling_inserter import FeelingInserter
from robo47_qp.tasks.peg_insert.peg import (
    ANGLE_ERROR,
    DEPTH,
    DIAMETER,
    LENGTH,
    POSITION_ERROR,
    TOP,
    Peg,
    add_block,
    set_exact_contacts,
)
from robo47_qp.tasks.peg_insert.peg_inserter import PITCH, PegInserter
from robo47_qp.tasks.table import TABLE_TOP, add_table

_DEPTH_LEAST, _DEPTH_MOST, _ASIDE, _TILT = 0.9 * DEPTH, 1.1 * DEPTH, 1e-3, 0.03
"""Least depth of the inserted peg and largest distance of its end from the hole's axis [m], and
largest angle between them [rad]."""


@dataclass(frozen=True, kw_only=True)
class PegInsert(Task):
    """Pick the peg from the table and insert it into the hole, down to the bottom.

    The peg counts as inserted when at least 90 % of the depth is in the hole, it is upright and at
    rest, the gripper is open and the arm is home.
    """

    opening_needed: ClassVar[float | None] = 0.021

    peg: Peg = field(
        default_factory=lambda: Peg(
            name="peg",
            size=(DIAMETER, DIAMETER, LENGTH),
            round=True,
            mass=0.15,
            rgba=(0.75, 0.62, 0.30, 1.0),
        )
    )
    grip_force: Positive = 30.0
    """Force of one finger on the peg [N]."""
    search_force: Positive = 2.0
    """Force on the peg during the search for the hole [N]."""
    insert_force: Positive = 5.0
    """Force on the peg during insertion [N]."""
    search_radius: Positive = 3.2e-3
    """Radius of the first spiral: a little more than the position error in x and y [m]."""
    retries: CountOrZero = 3
    """Further attempts, with the peg picked again, or with a spiral that is 1.5 times as wide and
    has 0.7 times the pitch."""
    force_max: Longest = 60.0
    """See `Task.force_max` [N]."""
    name: str = "peg_insert"

    def __post_init__(self) -> None:
        """Check the fields; see `Checked`.

        Raises:
            InvalidValueError: The hole is not made for the peg.
        """
        super().__post_init__()
        if not self.peg.round or self.peg.size != (DIAMETER, DIAMETER, LENGTH):
            expected = f"a cylinder of {1e3 * DIAMETER:g} mm, {1e3 * LENGTH:g} mm long, as its hole"
            raise InvalidValueError("size of the peg", self.peg.size, expected)

    @cached_property
    def placed(self) -> PlaceCriterion:
        """When the peg counts as inserted, beside its depth: distance and tilt are in the hole."""
        return PlaceCriterion(distance=_ASIDE, tilt=_TILT)

    @property
    def judged(self) -> Sequence[str]:
        """See `Task.judged`."""
        return (
            f"the peg's end at least {1e3 * _DEPTH_LEAST:g} mm deep in a hole of "
            f"{1e3 * DEPTH:g} mm, within {1e3 * _ASIDE:g} mm of its axis, and the peg within "
            f"{np.degrees(_TILT):.3g}° of it, the right end down",
            self.placed.rest_words,
            END,
        )

    @property
    def time_limit(self) -> float:
        """See `Task.time_limit` [s]."""
        return 240.0

    def build_scene(self, spec: mujoco.MjSpec) -> None:
        """See `Task.build_scene`."""
        add_table(spec)
        set_exact_contacts(spec)
        PlaceCriterion.add_state(spec)
        self.peg.add(spec, (0.40, 0.20, TABLE_TOP + 0.5 * LENGTH))
        add_block(spec.worldbody.add_body(name="hole", mocap=True))
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
        peg, hole = upright([0.40, 0.20, TABLE_TOP], 0.0), upright([0.48, -0.10, TOP], 0.0)
        error = SE3.from_rotation_and_translation(
            SO3.from_rpy_radians(0.02, -0.015, 0.0), np.array([1.2e-3, -0.8e-3, 0.5e-3])
        )
        if rng is not None:
            x, y = rng.uniform(0.38, 0.58), rng.uniform(0.12, 0.30)
            peg = upright([x, y, TABLE_TOP], rng.uniform(-np.pi, np.pi))
            x, y = rng.uniform(0.38, 0.58), rng.uniform(-0.30, -0.02)
            hole = upright([x, y, TOP], rng.uniform(-np.pi, np.pi))
            shift = rng.uniform(-POSITION_ERROR, POSITION_ERROR, 3)
            turn = SO3.from_rpy_radians(*rng.uniform(-ANGLE_ERROR, ANGLE_ERROR, 3))
            error = SE3.from_rotation_and_translation(turn, shift)
        up = SE3.from_translation(np.array([0.0, 0.0, 0.5 * LENGTH]))
        simulation.place_object(self.peg.name, peg @ up)
        simulation.place_marker("hole", hole)
        simulation.place_marker("hole seen", hole @ error)

    def as_seen(self, name: str, T_world_thing: SE3) -> SE3 | None:
        """See `Task.as_seen`: of the hole, only the less certain pose is told."""
        return None if name == "hole" else T_world_thing

    def preview(self, sensed: Sensed) -> Sequence[StepLike]:
        """See `Task.preview`."""
        hand = self._inserter(sensed, sensed.seen_pose("hole seen"))
        T_world_peg = sensed.seen_pose(self.peg.name)
        *approach, descend = hand.approach(T_world_peg)
        grasp = self.peg.grasp(T_world_peg, sensed.gripper.width_max)
        lift = hand.lift(grasp, T_world_peg)
        return [*approach, descend, lift, *hand.to_hole(np.zeros(2)), Release(), HOME]

    def program(self, sensed: Sensed) -> Program:
        """See `Task.program`."""
        hand = self._inserter(sensed, (yield from estimate_pose(sensed, "hole seen")))
        radius, pitch, offset = self.search_radius, PITCH, None
        for attempt in range(1 + self.retries):
            try:
                if offset is None:
                    held = yield from hand.pick()
                    hand = hand.holding(held)
                    offset = yield from hand.offset()
                    hand, offset = yield from hand.lined_up(offset)
                yield from hand.insert(offset, radius, pitch)
            except StepFailed as error:
                lost = error.failure.cause in LOST
                if not lost and error.failure.cause is not Cause.TIMEOUT:
                    raise
                if lost or offset is None or not (yield from hand.draw_out()):
                    yield from hand.back_off()
                    offset = None
                else:
                    if error.failure.step == "search":
                        radius, pitch = 1.5 * radius, 0.7 * pitch
                    hand, offset = yield from hand.lined_up(offset, again=True)
                if attempt == self.retries:
                    yield HOME
                    raise
            else:
                break
        yield from hand.let_go()
        yield hand.retreat(sensed.tool_pose())
        yield HOME
        return None

    def monitor(self, simulation: Simulation) -> None:
        """See `Task.monitor`."""
        self.placed.monitor(simulation, (self.peg.name,))

    def verdict(self, simulation: Simulation) -> Failure | None:
        """See `Task.verdict`."""
        measures, reasons = self.measures(simulation), []
        depth, aside, tilt = (measures[name] for name in ("depth_m", "aside_m", "tilt_rad"))
        if depth < _DEPTH_LEAST:
            reasons.append(
                f"is {1e3 * depth:.1f} mm deep (it must be at least {1e3 * _DEPTH_LEAST:.1f} mm)"
            )
        if depth > _DEPTH_MOST:
            reasons.append(
                f"is {1e3 * depth:.1f} mm below the top of the hole, which is "
                f"{1e3 * DEPTH:g} mm deep"
            )
        if aside > _ASIDE:
            reasons.append(
                f"is {1e3 * aside:.2f} mm beside the axis of the hole "
                f"(allowed are {1e3 * _ASIDE:g} mm)"
            )
        if tilt > _TILT:
            reasons.append(f"is tilted by {tilt:.3f} rad (allowed are {_TILT:g} rad)")
        against = told("the peg", reasons)
        against = against or self.placed.against_rest(simulation, (self.peg.name,))
        if against is not None:
            return Failure(cause=Cause.PLACE, evidence=against)
        return unfinished(simulation)

    def measures(self, simulation: Simulation) -> dict[str, float]:
        """Return depth and lateral error of the peg's end in the hole [m], and its tilt [rad]."""
        T_hole_peg = simulation.marker_pose("hole").inverse() @ simulation.object_pose(
            self.peg.name
        )
        end = T_hole_peg @ np.array([0.0, 0.0, -0.5 * self.peg.as_in(simulation).height])
        upwards = float(T_hole_peg.rotation().as_matrix()[2, 2])
        return {
            "depth_m": float(-end[2]),
            "aside_m": float(np.hypot(end[0], end[1])),
            "tilt_rad": float(np.arccos(np.clip(upwards, -1.0, 1.0))),
        }

    def _inserter(self, sensed: Sensed, T_world_hole: SE3) -> PegInserter:
        errs = wrist_errs(sensed) or camera_errs(sensed)
        return (FeelingInserter if errs else PegInserter)(
            sensed=sensed,
            item=self.peg,
            resting=TABLE_TOP + 0.5 * LENGTH,
            above=TOP + LENGTH + 0.06,
            force=self.grip_force,
            search_force=self.search_force,
            insert_force=self.insert_force,
            T_world_hole=T_world_hole,
        )
