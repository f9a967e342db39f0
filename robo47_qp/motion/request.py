"""Request: what has to be known of a waypoint to plan the motion to it, and what is planned."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from robo47_qp.ik.solver import IkResult, IkSolver
from robo47_qp.model.tool_poses import Target
from robo47_qp.motion.paths.segments import ToolPath
from robo47_qp.motion.trajectory import Trajectory

STILL = 1e-6
"""A motion that takes less at full speed is none [s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Request:
    """A motion to a waypoint."""

    name: str
    """Name of the waypoint."""
    T_world_goal: Target
    """Tool pose asked for, or those of several tools."""
    path: Callable[[Target], ToolPath] | None
    """Path of the tool from a start pose T_world_tcp; None where the joints move as they can."""
    straight: bool
    """True where that path is a straight line."""
    blend: float
    """How far from the waypoint the tool may leave the path for the next one [m]."""
    pace: float
    """Ratio of the speeds of joints and tool to those of their profiles, in (0, 1]."""
    goal: IkResult | None
    """Configuration to reach; None where following the path leads to one."""
    ik: IkSolver
    """Solver with what the waypoint adds to it."""


class Planned(NamedTuple):
    """A planned motion to a waypoint."""

    trajectory: Trajectory
    ik: IkResult
    """How the waypoint is reached, with the iterations spent on the way."""
    lower_bound: float = 0.0
    """Time that no motion along the same path can beat [s]; 0 where that is not known."""
    path: ToolPath | None = None
    """What the tool stays on; None where it is not prescribed, or its corners are blended."""
