"""Through: a smooth motion of the tool through poses."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from mink import SE3, SO3
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from robo47_qp.arrays import Vector
from robo47_qp.motion.paths.line import Line
from robo47_qp.motion.paths.speed_limits import PathProfile

_FINE = 200
"""Steps in which the length is summed, per pose."""


class Through:
    """Position and orientation on cubic splines, each twice continuously differentiable.

    The position is a natural spline (de Boor, A Practical Guide to Splines, 1978, ch. 4); the
    orientation one with a continuous angular acceleration (scipy's RotationSpline).
    """

    def __init__(self, poses: Sequence[SE3], profile: PathProfile) -> None:
        """Through poses T_world_tcp, at least two, no two in a row the same.

        Args:
            poses: The first is the start, the last the goal.
            profile: Bounds of the tool: what takes longer between two poses gets more of s.
        """
        ways = [Line(a, b) for a, b in pairwise(poses)]
        times = np.array([profile.least_time(way.length, way.angle) for way in ways])
        self.places: Vector = np.concatenate([[0.0], np.cumsum(times)]) / times.sum()
        """Where on the way the poses are, in [0, 1]."""
        points = np.array([pose.translation() for pose in poses])
        quats = np.array([np.roll(pose.rotation().wxyz, -1) for pose in poses])
        self._position = CubicSpline(self.places, points, bc_type="natural")
        self._rotation = RotationSpline(self.places, Rotation.from_quat(quats))
        fine = np.linspace(0.0, 1.0, _FINE * len(ways) + 1)
        steps = np.diff(self._position(fine), axis=0)
        self.length = float(np.linalg.norm(steps, axis=1).sum())
        """[m]"""
        rates = np.linalg.norm(self._rotation(fine, 1), axis=1)
        self.angle = float(rates.mean())
        """How far it turns, there and back counted [rad]."""

    @property
    def cuts(self) -> Vector:
        """Where poses are passed, the ends included, in [0, 1]."""
        return self.places.copy()

    @property
    def corners(self) -> Vector:
        """Where the poses between start and goal are, in [0, 1]."""
        return self.places[1:-1].copy()

    def at(self, s: float) -> SE3:
        """T_world_tcp at s in [0, 1]."""
        wxyz = np.roll(self._rotation(s).as_quat(), 1)
        return SE3.from_rotation_and_translation(SO3(wxyz), np.asarray(self._position(s)))

    def segment_at(self, s: float) -> int:
        """Between which two poses s is, counted from 0."""
        return int(np.searchsorted(self.places[1:-1], s, side="right"))
