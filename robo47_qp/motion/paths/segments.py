"""Segments of a tool path: straight lines and arcs of circles, and how fast the tool may go."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Annotated, Protocol, TypeAlias

import mujoco
import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Checked, Matrix, Range, Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.tool_poses import Target

_Bounds: TypeAlias = Annotated[tuple[float, float, float], Range(above=0.0)]

_FLAT = 1e-6
"""Sine of an angle below which three points lie on one line."""
_ROUND = 1e-4
"""Relative difference of the distances to a centre that rounding may cause."""


class ToolPath(Protocol):
    """A path of the tool, or of several tools together, over a parameter s in [0, 1]."""

    @property
    def length(self) -> float:
        """Length of the path of the tool point [m]."""
        ...

    @property
    def angle(self) -> float:
        """Angle that the tool turns through [rad]."""
        ...

    def at(self, s: float) -> Target:
        """Return T_world_tcp at s."""
        ...


class Segment(ToolPath, Protocol):
    """A path of one tool that can be joined to others; it turns steadily about one axis."""

    def at(self, s: float) -> SE3:
        """Return T_world_tcp at s."""
        ...

    @property
    def turn(self) -> Vector:
        """Rotation vector from start to goal in the frame of the start [rad]."""
        ...

    def position(self, s: float, order: int) -> Vector:
        """Return the derivative of the position by s, of an order of 0 or more (3,) [m]."""
        ...

    def distances(self, positions: Matrix, free: Vector | None = None) -> Vector:
        """Return the distances of points from the path (N,) [m].

        Args:
            positions: The points (N, 3) [m].
            free: Direction in which they may be anywhere, a unit vector (3,); for an arc, along
                the axis of its circle.
        """
        ...


class _SteadyTurn(ABC):
    """From one tool pose to another, turning steadily about one axis, the shorter way."""

    def __init__(self, start: SE3, goal: SE3) -> None:
        self._start = start
        # mink's logarithm is zero at half a turn; MuJoCo's is not.
        self._turn = np.zeros(3)
        mujoco.mju_subQuat(self._turn, goal.wxyz_xyz[:4], start.wxyz_xyz[:4])
        self.angle = float(np.linalg.norm(self._turn))
        """See `ToolPath.angle`."""

    @property
    def turn(self) -> Vector:
        """See `Segment.turn`."""
        return self._turn.copy()

    def at(self, s: float) -> SE3:
        """See `ToolPath.at`."""
        return SE3.from_rotation_and_translation(
            self._start.rotation() @ SO3.exp(s * self._turn), self.position(s, 0)
        )

    @abstractmethod
    def position(self, s: float, order: int) -> Vector:
        """See `Segment.position`."""


class Line(_SteadyTurn):
    """A straight line, at a steady speed."""

    def __init__(self, start: SE3, goal: SE3) -> None:
        """From `start` to `goal`, both T_world_tcp."""
        super().__init__(start, goal)
        self._shift = goal.translation() - start.translation()
        self.length = float(np.linalg.norm(self._shift))
        """See `ToolPath.length`."""

    def position(self, s: float, order: int) -> Vector:
        """See `Segment.position`."""
        if order == 0:
            place: Vector = self._start.translation() + s * self._shift
            return place
        return self._shift.copy() if order == 1 else np.zeros(3)

    def distances(self, positions: Matrix, free: Vector | None = None) -> Vector:
        """See `Segment.distances`."""
        offset: Matrix = positions - self._start.translation()
        offset, shift = _across(offset, free), _across(self._shift, free)
        if size := float(shift @ shift):
            offset = offset - np.clip(offset @ shift / size, 0.0, 1.0)[:, None] * shift
        distance: Vector = np.linalg.norm(offset, axis=1)
        return distance


class Arc(_SteadyTurn):
    """An arc of a circle, at a steady speed."""

    def __init__(self, start: SE3, goal: SE3, centre: Vector, turn: Vector) -> None:
        """From `start` to `goal`, both T_world_tcp.

        Args:
            start: Where it starts, on the circle.
            goal: Where it ends; only the orientation is used.
            centre: Centre of the circle [m].
            turn: Rotation vector about the centre, from start to goal [rad].
        """
        super().__init__(start, goal)
        self._centre = centre
        self._sweep = float(np.linalg.norm(turn))
        self._x = start.translation() - centre
        self._y = np.cross(turn / self._sweep, self._x)
        self.radius = float(np.linalg.norm(self._x))
        """[m]"""
        self.length = self.radius * self._sweep
        """See `ToolPath.length`."""

    def position(self, s: float, order: int) -> Vector:
        """See `Segment.position`."""
        angle = s * self._sweep + 0.5 * np.pi * order
        point: Vector = np.cos(angle) * self._x + np.sin(angle) * self._y
        return self._centre + point if order == 0 else self._sweep**order * point

    def distances(self, positions: Matrix, free: Vector | None = None) -> Vector:
        """See `Segment.distances`."""
        offset = positions - self._centre
        x, y = offset @ self._x / self.radius, offset @ self._y / self.radius
        angle = np.mod(np.arctan2(y, x), 2.0 * np.pi)
        # Points beside the arc belong to its nearer end.
        beyond = angle > self._sweep
        back = np.where(angle - self._sweep < 2.0 * np.pi - angle, self._sweep, 0.0)
        angle = np.where(beyond, back, angle)
        nearest = np.cos(angle)[:, None] * self._x + np.sin(angle)[:, None] * self._y
        distance: Vector = np.linalg.norm(_across(offset - nearest, free), axis=1)
        return distance


def _across(vectors: Matrix, direction: Vector | None) -> Matrix:
    """Return the parts of vectors (..., 3) that are normal to a direction, if there is one."""
    if direction is None:
        return vectors
    return vectors - (vectors @ direction)[..., None] * direction


def arc_through(start: SE3, goal: SE3, through: Vector) -> Arc:
    """Return the arc from start to goal through a point between them.

    Raises:
        InvalidValueError: The three points lie on a line, or two of them coincide.
    """
    a, b = through - start.translation(), goal.translation() - start.translation()
    normal = np.cross(a, b)
    size, spread = float(normal @ normal), float(np.linalg.norm(a) * np.linalg.norm(b))
    apart = float(np.linalg.norm(b - a))
    flat = size**0.5 <= _FLAT * spread or apart <= _FLAT * np.linalg.norm(a)
    if spread == 0.0 or flat:
        raise InvalidValueError(
            "the point that an arc goes through",
            through.tolist(),
            f"off the line through start {start.translation().tolist()} and goal "
            f"{goal.translation().tolist()}",
        )
    # Centre of the circle through 0, a and b.
    c = (b @ b * np.cross(normal, a) + a @ a * np.cross(b, normal)) / (2.0 * size)
    axis = normal / size**0.5
    x, z = -c, b - c
    sweep = float(np.arctan2(axis @ np.cross(x, z), x @ z)) % (2.0 * np.pi)
    return Arc(start, goal, start.translation() + c, sweep * axis)


def arc_about(start: SE3, goal: SE3, centre: Vector) -> Arc:
    """Return the shorter arc from start to goal about a centre.

    Raises:
        InvalidValueError: Start and goal are not at one distance from the centre, or lie on
            one line with it.
    """
    x, z = start.translation() - centre, goal.translation() - centre
    near, far = float(np.linalg.norm(x)), float(np.linalg.norm(z))
    if abs(near - far) > _ROUND * max(near, far) or near == 0.0:
        raise InvalidValueError(
            "centre of an arc",
            f"{near:.6f} m from the start and {far:.6f} m from the goal",
            "equally far from both",
        )
    normal = np.cross(x, z)
    size = float(np.linalg.norm(normal))
    if size <= _FLAT * near * far:
        raise InvalidValueError(
            "centre of an arc",
            f"{centre.tolist()} in line with start and goal",
            "off the line between them; give a point that the arc goes through instead",
        )
    # A centre with rounding errors is moved to where both distances are the same.
    chord = z - x
    across = x + 0.5 * chord
    across -= (across @ chord) / (chord @ chord) * chord
    exact = start.translation() + 0.5 * chord - across
    x, z = start.translation() - exact, goal.translation() - exact
    sweep = float(np.arctan2(np.linalg.norm(np.cross(x, z)), x @ z))
    return Arc(start, goal, exact, sweep * normal / size)


@dataclass(frozen=True, kw_only=True)
class PathProfile(Checked):
    """Bounds on speed, acceleration and jerk of the tool along a straight path."""

    linear: _Bounds = (0.25, 0.75, 5.0)
    """[m/s, m/s², m/s³]"""
    angular: _Bounds = (1.0, 3.0, 20.0)
    """[rad/s, rad/s², rad/s³]"""

    def along(self, length: float, angle: float, pace: float) -> Vector:
        """Return bounds on the first three derivatives of the path parameter in [0, 1].

        Args:
            length: Length of the path [m].
            angle: Angle turned on the way [rad].
            pace: Ratio in (0, 1]; stretches time by its inverse.

        Returns:
            Shape (3,) [1/s, 1/s², 1/s³].
        """
        bounds = np.full(3, np.inf)
        if length > 0.0:
            bounds = np.minimum(bounds, np.array(self.linear) / length)
        if angle > 0.0:
            bounds = np.minimum(bounds, np.array(self.angular) / angle)
        bounds *= pace ** np.arange(1, 4)
        return bounds

    def least_time(self, length: float, angle: float) -> float:
        """Return the time to move a length and turn an angle at full speed [s]."""
        return max(length / self.linear[0], angle / self.angular[0])

    def gentler(self, torque: float, rate: float) -> "PathProfile":
        """Return the bounds with accelerations and jerks that are smaller by these factors."""
        (v, a, j), (w, b, k) = self.linear, self.angular
        linear, angular = (v, a / torque, j / rate), (w, b / torque, k / rate)
        return PathProfile(linear=linear, angular=angular)

    def slowed(self, pace: float) -> "PathProfile":
        """Return the bounds for the same paths at `pace` times the full speed."""
        v, a, j = self.linear
        w, b, k = self.angular
        return PathProfile(
            linear=(v * pace, a * pace**2, j * pace**3),
            angular=(w * pace, b * pace**2, k * pace**3),
        )
