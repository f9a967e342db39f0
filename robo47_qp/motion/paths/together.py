"""Paths of several tools over one parameter: they move together by construction."""

from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

import numpy as np
from mink import SE3
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from robo47_qp.arrays import Matrix, Vector, checked_vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.tool_poses import Target, ToolPoses, one_pose
from robo47_qp.motion.paths.segments import Line, Segment, ToolPath


class Together:
    """A path for each of several tools; all begin and end at the same time.

    `length` and `angle` are those of the tool that goes farthest: it sets the time.
    """

    def __init__(self, paths: Mapping[str, Segment]) -> None:
        """Join paths, by the names of the tools."""
        self.paths = dict(paths)
        self.length = max(path.length for path in paths.values())
        """[m]"""
        self.angle = max(path.angle for path in paths.values())
        """[rad]"""

    def at(self, s: float) -> ToolPoses:
        """Return the poses of the tools at s in [0, 1]."""
        return ToolPoses({name: path.at(s) for name, path in self.paths.items()})

    def distances(self, name: str, positions: Matrix, quaternions: Matrix) -> Vector:
        """Return the distances of a tool's positions (N, 3) from its path (N,) [m]."""
        return self.paths[name].distances(positions)


class HeldTogether:
    """The paths of tools that hold one body, from the path of the body.

    T_world_tcp(s) = T_world_body(s) T_body_tcp(s). Where tools hold the body as they are to,
    T_body_tcp is constant, and so is the pose of the tools relative to each other; else it goes
    steadily to what was asked for.
    """

    def __init__(self, body: Segment, start: ToolPoses, holding: ToolPoses) -> None:
        """Derive the paths.

        Args:
            body: Path of the body.
            start: T_world_tcp of each tool at its start.
            holding: T_body_tcp of each tool at its end.
        """
        self.body = body
        T_body_world = body.at(0.0).inverse()
        self._grasps = {name: Line(T_body_world @ start[name], holding[name]) for name in holding}
        # A body that turns moves a tool far from it by more than its own point.
        ways = (
            body.angle * max(float(np.linalg.norm(way.position(s, 0))) for s in (0.0, 1.0))
            + way.length
            for way in self._grasps.values()
        )
        self.length = body.length + max(ways)
        """Bound on the way of any tool [m]."""
        self.angle = body.angle + max(grasp.angle for grasp in self._grasps.values())
        """Bound on the angle that any tool turns through [rad]."""

    def at(self, s: float) -> ToolPoses:
        """Return the poses of the tools at s in [0, 1]."""
        T_world_body = self.body.at(s)
        return ToolPoses({name: T_world_body @ way.at(s) for name, way in self._grasps.items()})

    def distances(self, name: str, positions: Matrix, quaternions: Matrix) -> Vector:
        """Return how far a tool would hold the body off its path (N,) [m].

        Args:
            name: The tool.
            positions: Its positions (N, 3) [m].
            quaternions: Its orientations wxyz (N, 4).
        """
        to_body = self._grasps[name].at(1.0).inverse().translation()
        turned = Rotation.from_quat(quaternions, scalar_first=True).apply(to_body)
        return self.body.distances(positions + turned)


ToolsPath: TypeAlias = Together | HeldTogether
"""A path of several tools."""


def path_of_each(
    shape: Callable[[SE3, SE3, Mapping[str, Vector]], Segment],
    points: Mapping[str, Vector],
    own: Mapping[str, Mapping[str, Vector]],
    start: Target,
    goal: Target,
) -> ToolPath:
    """Return the path of one tool, or of several that each keep to one of their own.

    Args:
        shape: Makes the path of one tool; see `MotionType.path`.
        points: What shapes it (3,) [m].
        own: In place of it, by the names of the tools.
        start: T_world_tcp at its start.
        goal: T_world_tcp at its end.

    Raises:
        InvalidValueError: The points make no path; start and goal are of different tools.
    """
    if isinstance(start, SE3) or isinstance(goal, SE3):
        return shape(one_pose(start), one_pose(goal), points)
    return Together({name: shape(start[name], goal[name], own.get(name, points)) for name in goal})


def held_path(
    shape: Callable[[SE3, SE3], Segment],
    T_world_body: SE3,
    holding: ToolPoses,
    start: Target,
    goal: Target,
) -> ToolPath:
    """Return the path of tools that hold one body, which keeps to a path itself.

    Args:
        shape: Makes the path of the body.
        T_world_body: Its pose at the end.
        holding: T_body_tcp of the tools at the end.
        start: T_world_tcp of the tools at the start.
        goal: The same at the end, of the same tools.

    Raises:
        InvalidValueError: The points make no path; start or goal is of one tool alone.
    """
    if isinstance(start, SE3) or isinstance(goal, SE3):
        return shape(one_pose(start), one_pose(goal))
    first = next(iter(holding))
    body = shape(start[first] @ holding[first].inverse(), T_world_body)
    return HeldTogether(body, start, holding)


def points_of(names: Sequence[str], points: Mapping[str, ArrayLike]) -> dict[str, Vector]:
    """Return the points (3,) of tools, checked to be there for each and for no other [m].

    Raises:
        InvalidValueError: They are not.
    """
    if set(names) != set(points):
        raise InvalidValueError("points of an arc for tools", sorted(points), f"one each {names}")
    return {name: checked_vector(f"point of {name!r}", points[name], 3) for name in names}


class OnePath:
    """A path alone, as a curve without corners."""

    def __init__(self, path: ToolPath) -> None:
        """Take the path of one tool or of several."""
        self._path = path
        self.length, self.angle = path.length, path.angle
        self.cuts: Vector = np.array([0.0, 1.0])
        """Where it begins and ends."""
        self.corners: Vector = np.empty(0)
        """Where segments meet: nowhere."""

    def at(self, s: float) -> Target:
        """Return T_world_tcp at s in [0, 1]."""
        return self._path.at(s)

    def segment_at(self, s: float) -> int:
        """Return the index of the segment at s: always 0."""
        return 0
