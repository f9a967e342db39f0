"""Leg: a planned way to one waypoint."""

from collections.abc import Sequence
from dataclasses import dataclass

from mink import SE3

from robo47_qp.ik.solver import IkResult
from robo47_qp.motion.arc import Arc
from robo47_qp.motion.line import Line
from robo47_qp.motion.trajectory import Trajectory
from robo47_qp.waypoint import Waypoint


@dataclass(frozen=True, kw_only=True, eq=False)
class Leg:
    """A planned way to a waypoint."""

    waypoint: Waypoint
    ik: IkResult
    trajectory: Trajectory
    T_world_start: SE3
    """Tool pose at the start."""
    T_world_goal: SE3
    """Tool pose asked for."""
    way: Line | Arc | None = None
    """What the tool is to stay on; None for PTP motions and where corners are blended."""
    lower_bound: float = 0.0
    """Time that no motion along the same path can beat [s]; 0 where parts of one motion follow
    each other without a stop."""

    @property
    def stops(self) -> bool:
        """True where it ends at rest; with a blend asked for, because a stop is faster."""
        return not self.trajectory.v[-1].any()


def duration(legs: Sequence[Leg]) -> float:
    """Of motions one after the other [s]."""
    return sum(leg.trajectory.duration for leg in legs)
