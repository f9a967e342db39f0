"""Board: marks on it, and what becomes of them under a sponge."""

from dataclasses import dataclass

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.errors import InvalidValueError
from robo47_qp.failure import Cause, Failure
from robo47_qp.simulation import Simulation
from tasks.sponge import Sponge
from tasks.table import TABLE_TOP

SURFACE = TABLE_TOP + 0.03
"""Height of the board's surface as far as the robot knows [m]."""
HEIGHT_ERROR = 5e-3
"""How far the surface may be from there [m]."""
BOARD = (0.19, 0.29)
"""Lengths of the board along its x and y [m]."""
DIRTY = (0.065, 0.085)
"""Marks are at most so far from the board's centre, along its x and y [m]."""
MARKS = 8
"""How many there are."""
_SLIDING = 5e-3
"""Speed from which the sponge slides [m/s]."""


@dataclass(frozen=True, kw_only=True)
class Wish:
    """How a sponge is to be led over a board."""

    force: float = 10.0
    """What the sponge is pressed with [N]."""
    force_least: float = 5.0
    """What it takes to wipe a mark off [N]."""
    band: float = 0.05
    """How far the force may be from the one asked for, relative to it [-]."""
    speed: float = 0.06
    """Of the sponge on the board [m/s]."""
    touch_speed: float = 0.1
    """At which the sponge meets the board, at most [m/s]."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: One is not positive and finite.
        """
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value > 0.0):
                raise InvalidValueError(name, value, "positive and finite")


def add_board(spec: mujoco.MjSpec) -> None:
    """Add the board, a body that the program places, its frame in the middle of its surface."""
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
    for i in range(MARKS):
        spot = spec.worldbody.add_body(name=mark(i), mocap=True)
        spot.add_geom(
            name=mark(i),
            type=disc,
            size=[0.005, 2e-4, 0.0],
            rgba=[0.25, 0.16, 0.10, 1.0],
            contype=0,
            conaffinity=0,
        )


class Notes:
    """What becomes of the marks, and how well the force is held, while the sponge slides."""

    def __init__(self, simulation: Simulation, sponge: Sponge, wish: Wish) -> None:
        """Nothing has been seen yet."""
        self._simulation, self._sponge, self._wish = simulation, sponge, wish
        self.sliding = self.outside = 0
        """How often the sponge was seen sliding, and how often with a force out of its band."""
        self.worst = wish.force
        """The force then that was furthest from the one asked for [N]."""

    def pressed(self) -> float:
        """Force of the sponge on the board [N]: that on the hand without the sponge's weight."""
        force = float(self._simulation.last_tool_force()[2])
        return force + 9.81 * self._sponge.mass

    def take(self) -> None:
        """Look once: wipe marks off, and take note of the force while the sponge slides."""
        simulation, wish = self._simulation, self._wish
        force = self.pressed()
        if force >= wish.force_least:
            self._wipe_off()
        twist = simulation.object_twist(self._sponge.name)
        if np.hypot(twist[0], twist[1]) > 5e-3 and force > 0.1 * wish.force:
            self.sliding += 1
            off = abs(force - wish.force)
            self.outside += off > wish.band * wish.force
            if off > abs(self.worst - wish.force):
                self.worst = force

    def against_force(self) -> Failure | None:
        """What speaks against the force having been held; None where it was."""
        if self.sliding and self.outside <= 0.01 * self.sliding:
            return None
        share = 100.0 * self.outside / max(1, self.sliding)
        evidence = (
            f"the force was off by more than {100 * self._wish.band:.0f} % for {share:.1f} % of "
            f"the time of sliding, {self.worst:.2f} N at worst; allowed is 1 %"
        )
        return Failure(cause=Cause.PLACE, evidence=evidence)

    def _wipe_off(self) -> None:
        simulation, sponge = self._simulation, self._sponge
        T_sponge_world = simulation.object_pose(sponge.name).inverse()
        for i in marks_left(simulation):
            at = T_sponge_world @ simulation.marker_pose(mark(i)).translation()
            if (np.abs(at[:2]) <= 0.5 * np.array(sponge.foam)).all():
                gone = SE3.from_translation(np.array([0.0, 0.0, -1.0]))
                simulation.place_marker(mark(i), gone)


def mark(i: int) -> str:
    """Name of a mark."""
    return f"mark{i}"


def marks_left(simulation: Simulation) -> list[int]:
    """Numbers of the marks on the board; those that are wiped off are below the floor."""
    return [i for i in range(MARKS) if simulation.marker_pose(mark(i)).translation()[2] > 0.0]
