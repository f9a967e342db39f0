"""Board: marks that a sponge wipes off, and the force of wiping."""

from dataclasses import dataclass

import mujoco
import numpy as np

from robo47_qp.arrays import Checked, Positive
from robo47_qp.errors import InvalidValueError
from robo47_qp.sim.sensed import Sensed
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.handling.place_criterion import PlaceCriterion
from robo47_qp.tasks.table import SURFACE_FRICTION, TABLE_TOP
from robo47_qp.tasks.task_state import hide_marker, task_state
from robo47_qp.tasks.wipe.sponge import FOAM, Sponge

SURFACE = TABLE_TOP + 0.03
"""Nominal height of the board's surface, which the robot knows [m]."""
HEIGHT_ERROR = 5e-3
"""Largest error of that height [m]."""
BOARD = (0.19, 0.29)
"""Lengths of the board along its x and y [m]."""
DIRTY = (0.065, 0.085)
"""Largest distances of marks from the board's centre, along its x and y [m]."""
MARKS = 8
"""Number of marks."""
OUTSIDE = 0.01
"""Largest share of the time of sliding with a force outside its band [-]."""
SLIDING = 5e-3
"""Speed above which the sponge counts as sliding [m/s]."""
PRESSED = 0.1
"""Share of the force above which it counts as sliding [-]."""
_TOUCHING = 2e-3
"""Height above a mark below which the foam touches it [m]."""
_PRESSED = "foam on the board"
_NET_FORCE = [1 << 1, 3, 1]
"""Of MuJoCo's contact sensor: the force field, reduced to the net force, in one slot."""
_SLID, _OUTSIDE, _WORST, _LAST = range(4)
"""Indices of the task state: time of sliding [s], time of sliding with a force outside the band
[s], largest force error [N], and time of the last update [s]."""


@dataclass(frozen=True, kw_only=True)
class WipeSettings(Checked):
    """Force and speed of a sponge on a board."""

    force: Positive = 10.0
    """Contact force of the sponge [N]."""
    force_least: Positive = 5.0
    """Least force that wipes off a mark [N]."""
    band: Positive = 0.05
    """Largest error of the force, relative to it [-]."""
    speed: Positive = 0.06
    """Speed of the sponge on the board [m/s]."""
    touch_speed: Positive = 0.1
    """Largest speed at which the sponge meets the board [m/s]."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: One is not positive, or the force wipes nothing off.
        """
        super().__post_init__()
        if self.force < self.force_least:
            raise InvalidValueError("force", self.force, f"at least {self.force_least:g} N")


def add_board(spec: mujoco.MjSpec) -> None:
    """Add the board, a body that the task places, its frame at the centre of its surface.

    The scene needs a sponge, too: a sensor tells the force of its foam on the board.
    """
    PlaceCriterion.add_state(spec, 4)
    box, disc = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER
    board = spec.worldbody.add_body(name="board", mocap=True)
    x, y = BOARD
    board.add_geom(
        name="board",
        type=box,
        pos=[0.0, 0.0, -0.015],
        size=[0.5 * x, 0.5 * y, 0.015],
        friction=SURFACE_FRICTION,
        rgba=[0.93, 0.94, 0.96, 1.0],
    )
    spec.add_sensor(
        name=_PRESSED,
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=mujoco.mjtObj.mjOBJ_GEOM,
        objname=FOAM,
        reftype=mujoco.mjtObj.mjOBJ_GEOM,
        refname="board",
        intprm=_NET_FORCE,
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


class WipeMonitor:
    """Wipes off the marks below the sponge, and records the force error while the sponge slides.

    Its state is kept in the simulation: see `tasks.task_state`.
    """

    def __init__(self, simulation: Simulation, sponge: Sponge, settings: WipeSettings) -> None:
        """Continue from the state in the simulation."""
        self._simulation, self._sponge, self._settings = simulation, sponge, settings

    def pressed(self) -> float:
        """Return the force of the foam on the board, along the board's normal [N]."""
        normal = self._simulation.marker_pose("board").rotation().as_matrix()[:, 2]
        # MuJoCo reports the force of the foam on the board.
        return -float(normal @ self._simulation.data.sensor(_PRESSED).data)

    def update(self) -> None:
        """Wipe marks off, and record the force error if the sponge slides."""
        simulation, settings, note = self._simulation, self._settings, task_state(self._simulation)
        passed, note[_LAST] = simulation.time - note[_LAST], simulation.time
        force = self.pressed()
        if force >= settings.force_least:
            self._wipe_off()
        if force > PRESSED * settings.force and self._slides():
            note[_SLID] += passed
            off = force - settings.force
            if abs(off) > settings.band * settings.force:
                note[_OUTSIDE] += passed
            if abs(off) > abs(note[_WORST]):
                note[_WORST] = off

    def against_force(self) -> str | None:
        """Return why the force was not within its band; None if it was."""
        slid, outside, worst, _ = task_state(self._simulation)
        if slid == 0.0:
            return "the sponge has not been led over the board"
        if outside <= OUTSIDE * slid:
            return None
        return (
            f"the force was off by more than {100 * self._settings.band:.0f} % for "
            f"{100 * outside / slid:.2f} % of the time of sliding, "
            f"{self._settings.force + worst:.2f} N at worst; allowed is "
            f"{100 * OUTSIDE:g} %"
        )

    def _slides(self) -> bool:
        """Return True if the sponge slides on the board."""
        twist = self._simulation.object_twist(self._sponge.name)
        if np.hypot(twist[0], twist[1]) <= SLIDING:
            return False
        T_world_board = self._simulation.marker_pose("board")
        sponge = self._simulation.object_pose(self._sponge.name).translation()
        R = T_world_board.rotation().as_matrix()
        x, y, _ = (sponge - T_world_board.translation()) @ R
        return bool(abs(x) <= 0.5 * BOARD[0] and abs(y) <= 0.5 * BOARD[1])

    def _wipe_off(self) -> None:
        """Hide the marks that the foam touches, which is compressed, as large as it is."""
        positions, foam = _positions(self._simulation), self._simulation.model.geom(FOAM)
        T_world_sponge = self._simulation.object_pose(self._sponge.name)
        R = T_world_sponge.rotation().as_matrix()
        at = (positions - T_world_sponge.translation()) @ R
        further = np.array([0.0, 0.0, 0.5 * _TOUCHING])
        middle, half = foam.pos - further, foam.size + further
        for i in np.flatnonzero((np.abs(at - middle) <= half).all(axis=1)):
            hide_marker(self._simulation, mark(int(i)))


def mark(i: int) -> str:
    """Return the name of a mark."""
    return f"mark{i}"


def marks_left(simulation: Simulation) -> list[int]:
    """Return the indices of the marks on the board; those wiped off are below the floor."""
    return [int(i) for i in np.flatnonzero(_positions(simulation)[:, 2] > 0.0)]


def marks_seen(sensed: Sensed) -> list[int]:
    """Return the indices of the marks that the camera sees on the board."""
    return [i for i in range(MARKS) if not sensed.is_hidden(mark(i))]


def _positions(simulation: Simulation) -> np.ndarray:
    """Return the positions of all marks in the world (MARKS, 3) [m]."""
    first = simulation.markers.index(mark(0))
    return simulation.data.mocap_pos[first : first + MARKS]
