"""ToolPoses: poses of several tools of one robot at the same time."""

from collections.abc import Callable, Iterator, Mapping
from typing import TypeAlias

from mink import SE3

from robo47_qp.arrays import check_pose
from robo47_qp.errors import InvalidValueError


def check_se3(name: str, pose: object) -> None:
    """Check that something is a pose.

    Raises:
        InvalidValueError: It is no `mink.SE3`, has NaN, or its quaternion is not of length 1.
    """
    if not isinstance(pose, SE3):
        raise InvalidValueError(name, repr(pose), "a mink.SE3")
    check_pose(name, pose)


class ToolPoses(Mapping[str, SE3]):
    """A pose for each of some tools of a robot, by the tool's name; it cannot be changed."""

    def __init__(self, poses: Mapping[str, SE3]) -> None:
        """Keep the poses in the order given.

        Raises:
            InvalidValueError: There is none, or one of them is no finite pose.
        """
        if not isinstance(poses, Mapping):
            expected = "a mapping from the names of tools to poses"
            raise InvalidValueError("poses of tools", repr(poses), expected)
        if not poses:
            raise InvalidValueError("poses of tools", "none", "at least one, by the tool's name")
        for name, pose in poses.items():
            check_se3(f"pose of tool {name!r}", pose)
        self._poses = dict(poses)

    def __getitem__(self, name: str) -> SE3:
        """Return the pose of a tool."""
        return self._poses[name]

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names of the tools."""
        return iter(self._poses)

    def __len__(self) -> int:
        """Return the number of tools."""
        return len(self._poses)

    def __repr__(self) -> str:
        """Show the poses."""
        return f"ToolPoses({self._poses!r})"

    def each(self, change: Callable[[str, SE3], SE3]) -> "ToolPoses":
        """Return the poses that a function of name and pose makes of these."""
        return ToolPoses({name: change(name, pose) for name, pose in self._poses.items()})


Target: TypeAlias = SE3 | ToolPoses
"""Where tools are to be: a pose T_world_tcp of the main tool, or poses of several tools."""


def one_pose(pose: Target) -> SE3:
    """Return the pose of the main tool where it alone is asked for.

    Raises:
        InvalidValueError: There are several.
    """
    if not isinstance(pose, SE3):
        raise InvalidValueError("start and goal of a path", list(pose), "poses of the same tools")
    return pose
