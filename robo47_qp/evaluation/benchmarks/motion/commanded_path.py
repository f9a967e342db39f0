"""Commanded path: the tool path that waypoints define, computed without the planner."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.model.tool_poses import one_pose
from robo47_qp.motion.waypoint import Motion, Place, Waypoint

_BLEND_SHARE = 0.98
"""Blends that take more of a line than this leave no line between them."""
_FLAT = 1e-5
"""Height of a triangle, as a part of its longest side, below which it makes no circle."""
_STILL = 1e-6
"""A way and a turn below which there is none [m and rad]."""
_UNEVEN = 1e-5
"""Difference of the distances to a centre that is no centre [m]."""


class CommandedPath:
    """Lines and circles between points, with spheres around the blended corners."""

    def __init__(self, start: Vector, waypoints: Sequence[Waypoint], home: Vector) -> None:
        """From a pose through waypoints.

        Args:
            start: Where the tool starts: wxyz, xyz (7,).
            waypoints: What is asked for.
            home: Where the tool is at home (7,).
        """
        self._waypoints = tuple(waypoints)
        poses = [start]
        for waypoint in waypoints:
            target = waypoint.target
            poses.append(home if isinstance(target, Place) else one_pose(target).wxyz_xyz)
        self._points = [pose[4:] for pose in poses]
        self._turns = [
            2.0 * np.arccos(min(1.0, float(abs(a[:4] @ b[:4])))) for a, b in pairwise(poses)
        ]

    @property
    def specified(self) -> bool:
        """True if the whole path is commanded, not only points on it."""
        passed = any(not w.rests and w.blend == 0.0 for w in self._waypoints)
        return not passed and all(w.prescribes_path for w in self._waypoints)

    def distance(self, points: Matrix) -> Vector:
        """Return the distance of points (N, 3) from the path; 0 within the blends (N,) [m]."""
        away = np.full(len(points), np.inf)
        for i, waypoint in enumerate(self._waypoints):
            a, b = self._points[i : i + 2]
            if waypoint.motion is Motion.CIRC:
                away = np.minimum(away, _from_circle(points, _circle(waypoint, a, b)))
            else:
                away = np.minimum(away, _from_line(points, a, b))
        for waypoint, corner in zip(self._waypoints, self._points[1:], strict=True):
            away[np.linalg.norm(points - corner, axis=1) <= waypoint.blend] = 0.0
        return away

    def missed(self, points: Matrix) -> Vector:
        """Return the least distance of points (N, 3) from the blend of each waypoint (n,) [m]."""
        least = [
            max(0.0, float(np.linalg.norm(points - corner, axis=1).min()) - waypoint.blend)
            for waypoint, corner in zip(self._waypoints, self._points[1:], strict=True)
        ]
        thirds = [w.through for w in self._waypoints if w.through is not None]
        least += [float(np.linalg.norm(points - third, axis=1).min()) for third in thirds]
        return np.array(least)

    def shape_error(self) -> str | None:
        """Return why the waypoints define no path; None if they seem to define one."""
        for i, waypoint in enumerate(self._waypoints):
            a, b = self._points[i : i + 2]
            if waypoint.motion is Motion.CIRC:
                if _circle(waypoint, a, b) is None:
                    return f"{waypoint.name}: its points make no circle"
                continue
            before = self._waypoints[i - 1].blend if i else 0.0
            length = float(np.linalg.norm(b - a))
            if max(length, self._turns[i]) < _STILL:
                return f"{waypoint.name}: it is where the one before is"
            if before + waypoint.blend > _BLEND_SHARE * length and before + waypoint.blend > 0.0:
                return f"{waypoint.name}: {length:.4f} m are no room for its blends"
        return None


_Circle = tuple[Vector, Vector, float]
"""Centre [m], unit normal and radius [m]."""


def _circle(waypoint: Waypoint, a: Vector, b: Vector) -> _Circle | None:
    """On which an arc from a to b lies; None where there is none."""
    third = waypoint.through if waypoint.centre is None else waypoint.centre
    if third is None:
        return None
    sides = np.array([b - a, third - a])
    normal = np.cross(*sides)
    if np.linalg.norm(normal) < _FLAT * float((sides**2).sum(axis=1).max()):
        return None
    normal /= np.linalg.norm(normal)
    if waypoint.centre is None:
        # The centre is in the plane and as far from a as from the two others.
        rows = np.vstack([sides, normal])
        sums = [0.5 * (b @ b - a @ a), 0.5 * (third @ third - a @ a), normal @ a]
        centre: Vector = np.linalg.solve(rows, sums)
    else:
        centre = waypoint.centre
        if abs(np.linalg.norm(a - centre) - np.linalg.norm(b - centre)) > _UNEVEN:
            return None
    return centre, normal, float(np.linalg.norm(a - centre))


def _from_circle(points: Matrix, circle: _Circle | None) -> Vector:
    if circle is None:
        return np.full(len(points), np.inf)
    centre, normal, radius = circle
    height = (points - centre) @ normal
    across = np.linalg.norm(points - centre - height[:, None] * normal, axis=1)
    away: Vector = np.hypot(height, across - radius)
    return away


def _from_line(points: Matrix, a: Vector, b: Vector) -> Vector:
    size = float((b - a) @ (b - a))
    along = np.clip((points - a) @ (b - a) / size, 0.0, 1.0) if size else np.zeros(len(points))
    beside: Vector = np.linalg.norm(points - a - along[:, None] * (b - a), axis=1)
    return beside
