"""Curves of the tool without a stop: segments with rounded corners, and splines through poses."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from mink import SE3, SO3
from scipy.interpolate import BPoly, CubicSpline
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation, RotationSpline

from robo47_qp.arrays import Vector
from robo47_qp.errors import Robo47Error
from robo47_qp.motion.paths.segments import Line, PathProfile, Segment

_ROOM = 0.99
"""Largest share of a segment that the blends at its ends may take together."""


class BlendError(Robo47Error):
    """Blends that do not fit on their segment, which has the index `segment`."""

    def __init__(self, segment: int, reason: str) -> None:
        """Tell which segment is too short and by how much."""
        super().__init__(reason)
        self.segment = segment


def check_room(zones: Sequence[float] | Vector, times: Vector) -> None:
    """Check that the blends at both ends of each segment leave some of it.

    Args:
        zones: Time that each corner takes of both its segments [s].
        times: Of the segments, one more [s].

    Raises:
        BlendError: They do not.
    """
    for i, time in enumerate(times):
        taken = sum(zones[max(0, i - 1) : i + 1])
        if taken > _ROOM * time:
            share = 100.0 * taken / time
            raise BlendError(i, f"the blends at its ends would take {share:.0f} % of it")


class ToolCurve:
    """Segments with rounded corners, twice continuously differentiable.

    Each segment is given the time that its tool bounds allow at full speed, and the corner
    between two takes equal times a of both. With x in [0, 2a] there, the position is the
    polynomial of degree 5 that continues value, slope and curvature of both segments, and
    the orientation is R_corner exp(f(x) w_1) exp(g(x) w_2): w_1 and w_2 are the rates of the
    segments, f runs from -a to 0 and g from 0 to a, both of degree 5, with slopes 1 to 0 and
    0 to 1 and no second derivative at the ends.
    """

    def __init__(
        self, segments: Sequence[Segment], radii: Sequence[float], profile: PathProfile
    ) -> None:
        """Join segments, each of which starts where the one before it ends.

        Args:
            segments: At least one.
            radii: How far from each corner the tool may leave its segments [m].
            profile: Bounds of the tool, which weigh moving against turning.

        Raises:
            BlendError: A radius takes more of a segment than there is.
        """
        self._segments = tuple(segments)
        self._times = np.array([profile.least_time(s.length, s.angle) for s in segments])
        self._zones = np.array([self._zone(i, r) for i, r in enumerate(radii)])
        check_room(self._zones, self._times)
        starts = np.concatenate([[0.0], np.cumsum(self._times)])
        corners = starts[1:-1]
        edges = np.ravel([corners - self._zones, corners + self._zones], order="F")
        self._total = float(starts[-1])
        self._starts = starts
        self.cuts: Vector = np.concatenate([[0.0], edges, [self._total]]) / self._total
        """Where straight parts, arcs and corners begin and end, in [0, 1]."""
        self.length = float(sum(s.length for s in segments))
        """Sum of the lengths of the segments [m]."""
        self.angle = float(sum(s.angle for s in segments))
        """[rad]"""
        self._bends = [self._bend(i, zone) for i, zone in enumerate(self._zones)]

    @property
    def corners(self) -> Vector:
        """Parameters at which segments meet, in [0, 1]."""
        middle: Vector = self._starts[1:-1] / self._total
        return middle

    def segment_at(self, s: float) -> int:
        """Return the index of the segment at s in [0, 1]."""
        return int(np.searchsorted(self.corners, s, side="right"))

    def at(self, s: float) -> SE3:
        """Return T_world_tcp at s in [0, 1]."""
        x = s * self._total
        for i, zone in enumerate(self._zones):
            into = x - (self._starts[i + 1] - zone)
            if 0.0 < into < 2.0 * zone:
                return self._in_corner(i, into)
        i = self.segment_at(s)
        return self._segments[i].at(min(1.0, (x - self._starts[i]) / float(self._times[i])))

    def _zone(self, i: int, radius: float) -> float:
        """Return the time that a corner takes of both segments, such that it keeps its radius."""
        zones = []
        corner = self._segments[i].position(1.0, 0)
        for k, end in ((i, 1.0), (i + 1, 0.0)):
            segment = self._segments[k]

            def beyond(u: float, segment: Segment = segment, end: float = end) -> float:
                at = segment.position(end + u if end == 0.0 else end - u, 0)
                return float(np.linalg.norm(at - corner)) - radius

            far = 1.0 if beyond(1.0) > 0.0 else 0.5
            if beyond(far) <= 0.0:
                raise BlendError(k, f"it ends within the blend radius of {1e3 * radius:.1f} mm")
            zones.append(float(brentq(beyond, 0.0, far, xtol=1e-12)) * float(self._times[k]))
        return min(zones)

    def _bend(self, i: int, zone: float) -> BPoly:
        ends = []
        for k, end, sign in ((i, 1.0, -1.0), (i + 1, 0.0, 1.0)):
            time = float(self._times[k])
            u = end + sign * zone / time
            ends.append([self._segments[k].position(u, n) / time**n for n in range(3)])
        return BPoly.from_derivatives([0.0, 2.0 * zone], ends)

    def _in_corner(self, i: int, into: float) -> SE3:
        zone = float(self._zones[i])
        x = into / (2.0 * zone)
        # Degree 5 with these ends has no x⁵ left: f' falls as 1 - 3x² + 2x³.
        f = -zone + 2.0 * zone * (x - x**3 + 0.5 * x**4)
        g = 2.0 * zone * (x**3 - 0.5 * x**4)
        before, after = self._segments[i], self._segments[i + 1]
        turn = SO3.exp(f / float(self._times[i]) * before.turn)
        turn = turn @ SO3.exp(g / float(self._times[i + 1]) * after.turn)
        return SE3.from_rotation_and_translation(
            before.at(1.0).rotation() @ turn, np.asarray(self._bends[i](into))
        )


_FINE = 200
"""Number of steps per pose in which the length is summed."""


class PoseSpline:
    """Position and orientation on cubic splines, each twice continuously differentiable.

    The position is a natural spline (de Boor, A Practical Guide to Splines, 1978, ch. 4); the
    orientation one with a continuous angular acceleration (scipy's RotationSpline).
    """

    def __init__(self, poses: Sequence[SE3], profile: PathProfile) -> None:
        """Fit poses T_world_tcp, at least two, no two in a row the same.

        Args:
            poses: The first is the start, the last the goal.
            profile: Bounds of the tool: what takes longer between two poses gets more of s.
        """
        ways = [Line(a, b) for a, b in pairwise(poses)]
        times = np.array([profile.least_time(way.length, way.angle) for way in ways])
        self.places: Vector = np.concatenate([[0.0], np.cumsum(times)]) / times.sum()
        """Parameters of the poses, in [0, 1]."""
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
        """Total angle that the tool turns through [rad]."""

    @property
    def cuts(self) -> Vector:
        """Parameters of the poses, ends included, in [0, 1]."""
        return self.places.copy()

    @property
    def corners(self) -> Vector:
        """Parameters of the poses between start and goal, in [0, 1]."""
        return self.places[1:-1].copy()

    def at(self, s: float) -> SE3:
        """Return T_world_tcp at s in [0, 1]."""
        wxyz = np.roll(self._rotation(s).as_quat(), 1)
        return SE3.from_rotation_and_translation(SO3(wxyz), np.asarray(self._position(s)))

    def segment_at(self, s: float) -> int:
        """Return the index of the interval between poses at s."""
        return int(np.searchsorted(self.places[1:-1], s, side="right"))
