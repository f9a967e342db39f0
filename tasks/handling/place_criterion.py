"""Place criterion: whether items are at their goals in position and orientation, and at rest."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np
from mink import SE3

from robo47_qp.arrays import Checked, Positive
from robo47_qp.run.failure import Cause, Failure
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.heading import heading, tilt
from robo47_qp.tasks.item import Item
from robo47_qp.tasks.task_state import add_task_state, moved_last

_HOME = 0.01
"""Largest distance of a joint from home at the end [rad]."""
_OPEN = 1e-3
"""Largest width by which an open gripper may be less than fully open [m]."""
_ROUNDING = 1e-6
"""Tolerance for sums of control periods [s]."""
END = (
    f"every joint within {_HOME:g} rad of home (slides: m), and grippers open to within "
    f"{1e3 * _OPEN:g} mm of their full width"
)
"""What `unfinished` demands, in words."""


class Miss(NamedTuple):
    """How far an item is from its goal."""

    distance: float
    """Between centre and goal, in 3-D [m]."""
    turn: float
    """Heading error, by the symmetry of the item [rad]."""
    tilt: float
    """Angle between the item's axis that is to point up and the vertical [rad]."""


@dataclass(frozen=True, kw_only=True)
class PlaceCriterion(Checked):
    """The conditions under which an item counts as placed.

    `monitor` must be called during the run, as it measures for how long the items are at rest.
    """

    distance: Positive = 5e-3
    """Largest distance of the centre from its goal, in 3-D [m]."""
    turn: Positive = float(np.radians(5.0))
    """Largest heading error, by the symmetry of the item [rad]."""
    tilt: Positive = float(np.radians(3.0))
    """Largest angle of the item's axis from the vertical [rad]."""
    speed: Positive = 1e-3
    """Speed below which an item is at rest [m/s]."""
    spin: Positive = 0.02
    """Angular speed below which an item is at rest [rad/s]."""
    seconds: Positive = 0.5
    """Time for which all items must have been at rest at the end, without interruption [s]."""

    @staticmethod
    def add_state(spec: mujoco.MjSpec, count: int = 0) -> None:
        """Reserve task state for `monitor`, and for `count` numbers of the task."""
        add_task_state(spec, count)

    def monitor(self, simulation: Simulation, names: Sequence[str]) -> None:
        """Note the time if one of the objects moves, or did since the last call.

        Call it every few control periods.
        """
        moved, now = moved_last(simulation), simulation.time
        still = min(self.speed, self.spin) / np.sqrt(3.0)
        for name in names:
            if self._moves(simulation, name):
                moved[0] = now
            elif simulation.lately is not None:
                twists = simulation.lately(f"motion/{name} velocity")
                if np.abs(twists).max(initial=0.0) <= still:
                    continue
                v, w = ((part**2).sum(axis=1) for part in np.hsplit(twists, 2))
                rows = np.flatnonzero((v > self.speed**2) | (w > self.spin**2))
                if len(rows):
                    moved[0] = max(moved[0], simulation.lately("time")[rows[-1], 0])

    def against(self, simulation: Simulation, item: Item, T_world_goal: SE3) -> str | None:
        """Return why an item is not placed; None if it is.

        Args:
            simulation: The world.
            item: The item, which must be among those that are monitored.
            T_world_goal: T_world_item of the placed item, with z up.
        """
        off = miss(item, simulation.object_pose(item.name), T_world_goal)
        pose = told(f"the {item.name}", self.against_pose(off))
        return pose or self.against_rest(simulation, (item.name,))

    def against_pose(self, off: Miss) -> list[str]:
        """Return which of the tolerances of the pose are exceeded, in words."""
        reasons = []
        if off.distance > self.distance:
            reasons.append(
                f"is {1e3 * off.distance:.1f} mm from its goal "
                f"(allowed are {1e3 * self.distance:g} mm)"
            )
        for angle, most, how in (
            (off.turn, self.turn, "is turned by {:.1f}° from its heading"),
            (off.tilt, self.tilt, "is tilted by {:.1f}°"),
        ):
            if angle > most:
                words = how.format(np.degrees(angle))
                reasons.append(f"{words} (allowed are {np.degrees(most):.3g}°)")
        return reasons

    def against_rest(self, simulation: Simulation, names: Sequence[str]) -> str | None:
        """Return why objects are not at rest, or were not for long enough; None if they were."""
        for name in names:
            twist = simulation.object_twist(name)
            speed, spin = (float(np.linalg.norm(part)) for part in (twist[:3], twist[3:]))
            if speed > self.speed or spin > self.spin:
                return (
                    f"the {name} moves at {1e3 * speed:.1f} mm/s and turns at {spin:.3f} rad/s "
                    f"(allowed are {1e3 * self.speed:g} mm/s, {self.spin:g} rad/s)"
                )
        rest = simulation.time - float(moved_last(simulation)[0])
        if rest < self.seconds - _ROUNDING:
            which = f"the {names[0]} has" if len(names) == 1 else "not all that is judged has"
            return f"{which} been at rest for {self.seconds:g} s, but for {rest:.2f} s"
        return None

    @property
    def pose_words(self) -> str:
        """What the pose must be, in words."""
        return (
            f"its centre within {1e3 * self.distance:g} mm of the goal in 3-D, its heading within "
            f"{np.degrees(self.turn):.3g}° by its symmetry, and its axis within "
            f"{np.degrees(self.tilt):.3g}° of the vertical, with its top up"
        )

    @property
    def rest_words(self) -> str:
        """What being at rest means, in words."""
        return (
            f"at rest for {self.seconds:g} s: at most {1e3 * self.speed:g} mm/s and "
            f"{self.spin:g} rad/s"
        )

    def _moves(self, simulation: Simulation, name: str) -> bool:
        vx, vy, vz, wx, wy, wz = simulation.object_twist(name).tolist()
        fast = vx * vx + vy * vy + vz * vz > self.speed**2
        return bool(fast or wx * wx + wy * wy + wz * wz > self.spin**2)


def miss(item: Item, T_world_item: SE3, T_world_goal: SE3) -> Miss:
    """Return how far an item is from its goal, whose z points up."""
    off = T_world_item.translation() - T_world_goal.translation()
    return Miss(
        distance=float(np.linalg.norm(off)),
        turn=abs(item.same_heading(heading(T_world_item) - heading(T_world_goal))),
        tilt=tilt(T_world_item),
    )


def told(subject: str, reasons: Sequence[str]) -> str | None:
    """Return a sentence with all reasons; None if there is none."""
    return f"{subject} {', and '.join(reasons)}" if reasons else None


def unfinished(simulation: Simulation) -> Failure | None:
    """Return the failure that the robot is not home with all grippers open; None if it is."""
    off = simulation.from_home()
    reasons = []
    if off.max() > _HOME:
        unit = simulation.robot.units[int(off.argmax())]
        reasons.append(
            f"a joint is {off.max():.3f} {unit} from home (allowed are {_HOME:g} {unit})"
        )
    for i, (label, tool) in enumerate(simulation.robot.tool_labels()):
        if tool.gripper is None:
            continue
        width, least = simulation.width(i), tool.gripper.width_max - _OPEN
        if width < least:
            which = f"gripper of {tool.name}" if label else "gripper"
            reasons.append(
                f"the {which} is open {1e3 * width:.1f} mm (it must be at least "
                f"{1e3 * least:.1f} mm)"
            )
    if not reasons:
        return None
    return Failure(cause=Cause.PLACE, evidence=", and ".join(reasons))
