"""Waypoint: a tool pose to visit, how to get there, and what the gripper does there."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import partial
from typing import Annotated

import numpy as np
from mink import SE3, SO3
from numpy.typing import ArrayLike

from robo47_qp.arrays import (
    Checked,
    NotNegative,
    Ratio,
    Size,
    Vector,
    check_pose,
    checked_vector,
)
from robo47_qp.errors import NO_PATH, InvalidValueError, PlanError
from robo47_qp.ik.objectives import Objective, TaskSource
from robo47_qp.ik.solver import IkResult, IkSolver, composed_ik
from robo47_qp.ik.tool_demand import FULL, ToolDemand, check_demand
from robo47_qp.model.arm import Arm
from robo47_qp.model.gripper import Grip
from robo47_qp.model.payload import Load
from robo47_qp.model.tool_poses import Target, ToolPoses
from robo47_qp.motion.motion_type import MotionType
from robo47_qp.motion.paths.segments import ToolPath
from robo47_qp.motion.paths.together import held_path, path_of_each, points_of
from robo47_qp.motion.request import Request
from robo47_qp.motion.types.circ import CircMotion
from robo47_qp.motion.types.lin import LinMotion
from robo47_qp.motion.types.ptp import PtpMotion


class Motion(Enum):
    """Types of motion to a waypoint."""

    PTP = PtpMotion()
    """All joints together, as fast as the joint limits allow; the path is not a line."""
    LIN = LinMotion()
    """The tool on a straight line, turning at a steady rate."""
    CIRC = CircMotion()
    """The tool on an arc of a circle, turning at a steady rate from start to goal."""

    @property
    def type(self) -> MotionType:
        """Properties and planning of this motion."""
        motion_type: MotionType = self.value
        return motion_type


PRESCRIBED = " or ".join(motion.name for motion in Motion if motion.type.prescribes_path)
"""Names of the motions that prescribe the path of the tool."""
_PASSABLE = " or ".join(motion.name for motion in Motion if motion.type.passable)
_POINTS = ("through", "centre")


class Place(Enum):
    """A target that the robot defines."""

    HOME = "home"


@dataclass(frozen=True, kw_only=True, eq=False)
class Waypoint(Checked):
    """A tool pose to visit; at rest unless it is blended or passed.

    Tools that the target does not name stay where they are.
    """

    name: str
    """What the robot is doing on the way here; shown in recordings and messages."""
    target: Target | Place
    """T_world_tcp to reach (of the main tool, or `ToolPoses` of several tools at once), or a
    place of the robot's own."""
    holding: ToolPoses | None = None
    """T_body_tcp of the tools that hold one body together. The target is then T_world_body, and
    LIN and CIRC prescribe the path of the body, which the tools hold so on all of it."""
    motion: Motion = Motion.PTP
    through: Annotated[Vector, Size(3)] | None = None
    """CIRC: a point on the arc between start and target (3,) [m]."""
    through_each: Mapping[str, ArrayLike] | None = None
    """CIRC of several tools, in place of `through`: such a point for each."""
    centre: Annotated[Vector, Size(3)] | None = None
    """CIRC, in place of `through`: centre of the arc (3,) [m]; the shorter way is taken."""
    blend: NotNegative = 0.0
    """Radius within which the tool may cut the corner to the next waypoint, so as not to stop [m];
    with 0 it comes to rest, or passes exactly through where `stop` is False."""
    stop: bool = True
    """False: pass exactly through without stopping, on a smooth curve through this waypoint and
    its neighbours; in joint space for PTP, of the tool for LIN."""
    pace: Ratio = 1.0
    """Ratio of the speeds on the way here to those of the profiles, in (0, 1]."""
    grip: Grip | None = None
    """What the gripper does on arrival; None leaves it as it is."""
    carried: Load = None
    """What the main tool holds on the way here, or each of several tools, by their names."""
    objectives: Sequence[Objective | TaskSource] = ()
    """Further tasks on the way here and at its end, beside those of the solver; see `MinkIk`."""
    demand: ToolDemand | None = None
    """What of the tool's pose is asked for on the way here; None: what the solver asks for."""
    onward: "tuple[Waypoint, ...]" = ()
    """LIN and CIRC motions that will follow. They are not carried out; the configuration at a PTP
    waypoint is chosen such that they can be."""
    _path: Callable[[Target, Target], ToolPath] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: The pose has NaN, no unit quaternion, the pace is out of range,
                what follows is no motion of the tool, or what shapes the way is amiss.
        """
        super().__post_init__()
        if not isinstance(self.target, SE3 | ToolPoses | Place):
            expected, found = "a pose (mink.SE3), ToolPoses or a Place", repr(self.target)
            raise InvalidValueError(f"target of waypoint {self.name!r}", found, expected)
        bent = [waypoint.name for waypoint in self.onward if not waypoint.prescribes_path]
        if bent:
            raise InvalidValueError(
                f"what follows waypoint {self.name!r}", bent, f"waypoints reached by {PRESCRIBED}"
            )
        self._check_shape()
        if not isinstance(self.holding, ToolPoses | None):
            name, expected = f"holding of waypoint {self.name!r}", "ToolPoses, T_body_tcp by tool"
            raise InvalidValueError(name, repr(self.holding), expected)
        if isinstance(self.target, SE3):
            check_pose(f"target of waypoint {self.name!r}", self.target)
        elif self.holding is not None:
            raise InvalidValueError(
                f"target of waypoint {self.name!r}", self.target, "the pose of the body held"
            )
        if self.holding is not None and not self.prescribes_path:
            raise InvalidValueError(
                f"motion to waypoint {self.name!r} of a body that is held",
                self.motion.name,
                f"{PRESCRIBED}, on which the tools keep their places on it",
            )
        self._check_demand()
        if not self._single and not self.rests:
            raise InvalidValueError(
                f"waypoint {self.name!r} of several tools",
                f"a blend of {self.blend} m, stop {self.stop}",
                "one at which they come to rest",
            )
        object.__setattr__(self, "_path", self._shaped_path())

    def _label(self, field: str) -> str:
        return f"{field} of waypoint {self.name!r}"

    @property
    def rests(self) -> bool:
        """True where the tool comes to rest here."""
        return self.stop and self.blend == 0.0

    @property
    def prescribes_path(self) -> bool:
        """True where the tool keeps to a path on the way here: a line or an arc."""
        return self.motion.type.prescribes_path

    def path(self, start: Target, goal: Target) -> ToolPath:
        """Return the path of the tools from poses T_world_tcp to others of the same tools.

        Raises:
            PlanError: The points that shape it make no path.
        """
        try:
            return self._path(start, goal)
        except InvalidValueError as error:
            raise PlanError(self.name, str(error), NO_PATH) from error

    def solver(self, ik: IkSolver) -> IkSolver:
        """Return a solver with the objectives and the demand of this waypoint.

        Raises:
            InvalidValueError: It takes none.
        """
        return composed_ik(ik, self.objectives, self.demand)

    def request(self, arm: Arm, ik: IkSolver, pace: float, reached: IkResult | None) -> Request:
        """Return the request for the motion to here.

        Args:
            arm: The arm.
            ik: The solver of the planner.
            pace: That of the planner, in (0, 1].
            reached: Configuration to reach; None where following the path leads to one.

        Raises:
            InvalidValueError: The solver does not take objectives or a demand.
        """
        goal, own = goal_pose(arm, self), self.solver(ik)
        aimed = own.tolerance.demand.aimed
        return Request(
            name=self.name,
            T_world_goal=goal,
            ik=own,
            path=(lambda start: self.path(start, aimed(start, goal)))
            if self.prescribes_path
            else None,
            straight=self.motion.type.straight,
            blend=self.blend,
            pace=pace * self.pace,
            goal=reached,
        )

    @property
    def _single(self) -> bool:
        """True where the target is a pose of the main tool alone, or a place."""
        return self.holding is None and not isinstance(self.target, ToolPoses)

    def _shaped_path(self) -> Callable[[Target, Target], ToolPath]:
        """Return what makes the path from a start to a goal.

        Raises:
            InvalidValueError: The points of several tools are not one for each.
        """
        shape = self.motion.type.path
        points = {name: getattr(self, name) for name in self._given}
        if self.holding is not None and isinstance(self.target, SE3):
            return partial(held_path, partial(shape, points=points), self.target, self.holding)
        each = {}
        if self.through_each is not None and isinstance(self.target, ToolPoses):
            own = points_of(list(self.target), self.through_each)
            each = {name: {"through": point} for name, point in own.items()}
        return partial(path_of_each, shape, points, each)

    @property
    def _given(self) -> list[str]:
        return [name for name in _POINTS if getattr(self, name) is not None]

    def _check_demand(self) -> None:
        if self.demand is None:
            return
        check_demand(self.demand)
        if self.holding is not None and self.demand != FULL:
            raise InvalidValueError(
                f"demand of waypoint {self.name!r}", self.demand, "FULL where tools hold a body"
            )

    def _check_shape(self) -> None:
        motion, name = self.motion.type, self.motion.name
        given = len(self._given)
        if self.through_each is not None:
            each = isinstance(self.target, ToolPoses) and "through" in motion.points
            given = given + 1 if each else -1
        if given != min(1, len(motion.points)) or set(self._given) - {*motion.points}:
            wanted = f"one of {' and '.join(motion.points)}" if motion.points else "neither"
            raise InvalidValueError(
                f"shape of the way to waypoint {self.name!r}",
                f"{name} with {self._given or 'neither ' + ' nor '.join(_POINTS)}",
                f"{name} with {wanted}",
            )
        if not self.stop and (self.blend > 0.0 or not motion.passable):
            raise InvalidValueError(
                f"waypoint {self.name!r} that is not to be stopped at",
                f"{name} with a blend of {self.blend} m",
                f"{_PASSABLE} without a blend; other motions go on without stopping by a blend",
            )
        if self.grip is not None and not self.rests:
            raise InvalidValueError(
                f"grip at waypoint {self.name!r}", self.grip, "None where the tool does not stop"
            )


def goal_pose(arm: Arm, waypoint: Waypoint) -> Target:
    """Return T_world_tcp that a waypoint asks for, of one tool or of several."""
    target, holding = waypoint.target, waypoint.holding
    if isinstance(target, Place):
        tools = arm.robot.tools
        if len(tools) == 1:
            return arm.pose(arm.home)
        return ToolPoses({tool.name: arm.pose(arm.home, i) for i, tool in enumerate(tools)})
    if holding is not None and isinstance(target, SE3):
        T_world_body = target
        return holding.each(lambda _, T_body_tcp: T_world_body @ T_body_tcp)
    return target


def tool_down(position: ArrayLike, yaw: float = 0.0) -> SE3:
    """Return the pose of a tool that points straight down (tool z along -z of the world).

    Args:
        position: Tool point in the world, shape (3,) [m].
        yaw: Turn about the world's z axis [rad]; at 0 the tool's x is the world's x.

    Raises:
        InvalidValueError: `position` is not three finite numbers, or `yaw` is not finite.
    """
    if not np.isfinite(yaw):
        raise InvalidValueError("yaw", yaw, "finite [rad]")
    rotation = SO3.from_z_radians(yaw) @ SO3.from_x_radians(np.pi)
    return SE3.from_rotation_and_translation(rotation, checked_vector("position", position, 3))
