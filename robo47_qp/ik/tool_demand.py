"""What of a tool's pose a target asks for: all of it, an axis, a direction, or the position."""

from dataclasses import dataclass
from math import atan2, pi, sqrt
from typing import Any, ClassVar

import mujoco
import numpy as np
from mink import SE3, SO3
from numpy.typing import NDArray

from robo47_qp.arrays import Matrix, Vector, checked_vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm
from robo47_qp.model.tool_poses import Target, ToolPoses

_SMALL = 1e-12
"""Sine of an angle below which two directions define no axis between them."""


@dataclass(frozen=True)
class ToolDemand:
    """The whole pose of the tool is asked for."""

    position: ClassVar[bool] = True
    """Whether the tool point has to be where the target is."""
    free: ClassVar[int] = 0
    """Degrees of freedom of a pose that are left free."""

    def turn(self, w: Vector, R_axes_tool: Matrix) -> Vector:
        """Return the rotation vector that is still asked for (3,) [rad].

        Args:
            w: Rotation vector from the tool to the target (3,) [rad].
            R_axes_tool: Rotation of the tool in the axes of `w` (3, 3).
        """
        return w

    def turning(self, J: Matrix, R_axes_tool: Matrix) -> Matrix:
        """Return the part of an angular Jacobian (3, n) that changes what is asked for."""
        return J

    def feature(self, feature: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return what is asked for of `seeds.feature_of` of poses (..., 12), as (..., k)."""
        return feature

    def nearest(self, start: SE3, goal: SE3) -> SE3:
        """Return the pose nearest to a start that is as good as a goal; both T_world_tcp."""
        return goal

    def aimed(self, start: Target, goal: Target) -> Target:
        """Return `nearest` of a target, tool by tool."""
        if isinstance(goal, ToolPoses) and isinstance(start, ToolPoses):
            poses = start
            return goal.each(lambda name, pose: self.nearest(poses[name], pose))
        if isinstance(goal, SE3) and isinstance(start, SE3):
            return self.nearest(start, goal)
        return goal

    def distance(self, arm: Arm, T_world_target: Target, q: Vector) -> tuple[float, float]:
        """Return distance [m] and angle [rad] that are left at q; of several tools the largest."""
        if type(self) is ToolDemand:
            return arm.pose_distance(T_world_target, q)
        parts = self.error(arm, T_world_target, q).reshape(-1, 6)
        p, w = (
            np.linalg.norm(parts[:, :3], axis=1).max(),
            np.linalg.norm(parts[:, 3:], axis=1).max(),
        )
        return float(p), float(w)

    def error(self, arm: Arm, T_world_target: Target, q: Vector) -> Vector:
        """Return displacement [m] and rotation vector [rad] left, in the tool frame (6 tools,)."""
        e = arm.pose_error(T_world_target, q)
        if type(self) is not ToolDemand:
            for part in e.reshape(-1, 6):
                part[:3] *= self.position
                part[3:] = self.turn(part[3:].copy(), np.eye(3))
        return e

    def jacobian(self, arm: Arm, T_world_target: Target, q: Vector) -> Matrix:
        """Return how `error` falls per joint (6 tools, n); rows of what is free are zero."""
        J = arm.error_jacobian(T_world_target, q)
        if type(self) is not ToolDemand:
            for part in J.reshape(-1, 6, arm.n):
                part[:3] *= self.position
                part[3:] = self.turning(part[3:].copy(), np.eye(3))
        return J


@dataclass(frozen=True)
class FreeAxis(ToolDemand):
    """Position and the direction of an axis of the tool; turning about the axis is free."""

    free: ClassVar[int] = 1
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Axis in the tool frame, of any length; as a pair with the same axis of the target."""

    def __post_init__(self) -> None:
        """Make the axis a unit vector.

        Raises:
            InvalidValueError: It is not three finite numbers, or has no length.
        """
        axis = checked_vector("axis", self.axis, 3)
        if not axis.any():
            raise InvalidValueError("axis", axis.tolist(), "a vector with a length")
        # The largest component becomes 1 first, so that no square is too large or too small.
        axis /= np.abs(axis).max()
        object.__setattr__(self, "axis", tuple((axis / np.linalg.norm(axis)).tolist()))

    def turn(self, w: Vector, R_axes_tool: Matrix) -> Vector:
        """Return the least rotation that turns the axis to where the target has it."""
        a = R_axes_tool @ self.axis
        d = _rotated(w, a)
        across, along = _cross(a, d), float(a.dot(d))
        sine = sqrt(across.dot(across))
        if sine > _SMALL:
            least: Vector = across * (atan2(sine, along) / sine)
            return least
        if along > 0.0:
            return across
        # Opposite directions: the target is half a turn away, about an axis across this one.
        aside = w - a.dot(w) * a
        half: Vector = aside * (pi / sqrt(aside.dot(aside)))
        return half

    def turning(self, J: Matrix, R_axes_tool: Matrix) -> Matrix:
        """Return J without the turning about the axis."""
        a = R_axes_tool @ self.axis
        return J - np.outer(a, a.dot(J))

    def feature(self, feature: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the position and the weighted direction of the axis (..., 6)."""
        rotation = feature[..., 3:].reshape(*feature.shape[:-1], 3, 3)
        direction = rotation @ np.array(self.axis, dtype=np.float32)
        parts = [feature[..., :3], direction] if self.position else [direction]
        return np.ascontiguousarray(np.concatenate(parts, axis=-1))

    def nearest(self, start: SE3, goal: SE3) -> SE3:
        """Return the goal, turned about its axis as little as the start needs."""
        R_start, w = start.rotation().as_matrix(), np.empty(3)
        # mink's logarithm is zero at half a turn; MuJoCo's is not.
        mujoco.mju_subQuat(w, goal.wxyz_xyz[:4], start.wxyz_xyz[:4])
        turn = SO3.exp(self.turn(R_start @ w, R_start))
        place = goal if self.position else start
        return SE3.from_rotation_and_translation(turn @ start.rotation(), place.translation())


@dataclass(frozen=True)
class Direction(FreeAxis):
    """The direction of an axis of the tool only: to point with it."""

    position: ClassVar[bool] = False
    free: ClassVar[int] = 4


@dataclass(frozen=True)
class PositionOnly(ToolDemand):
    """The position of the tool only."""

    free: ClassVar[int] = 3

    def turn(self, w: Vector, R_axes_tool: Matrix) -> Vector:
        """Return no rotation."""
        return np.zeros(3)

    def turning(self, J: Matrix, R_axes_tool: Matrix) -> Matrix:
        """Return zero: no turning matters."""
        return np.zeros_like(J)

    def feature(self, feature: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the position (..., 3)."""
        return np.ascontiguousarray(feature[..., :3])

    def nearest(self, start: SE3, goal: SE3) -> SE3:
        """Return the position of the goal with the orientation of the start."""
        return SE3.from_rotation_and_translation(start.rotation(), goal.translation())


FULL, POSITION = ToolDemand(), PositionOnly()
"""The whole pose, and the position alone."""


def check_demand(demand: Any) -> None:
    """Check that something is a demand.

    Raises:
        InvalidValueError: It is not.
    """
    if not isinstance(demand, ToolDemand):
        known = "FULL, FreeAxis(axis), Direction(axis) or POSITION"
        raise InvalidValueError("demand", repr(demand), known)


def _rotated(w: Vector, a: Vector) -> Vector:
    """Return exp([w]×) a, by Rodrigues' formula."""
    angle = sqrt(w.dot(w))
    if angle < _SMALL:
        return a + _cross(w, a)
    u = w / angle
    turned: Vector = a * np.cos(angle) + _cross(u, a) * np.sin(angle)
    turned += u * (u.dot(a) * (1.0 - np.cos(angle)))
    return turned


def _cross(a: Vector, b: Vector) -> Vector:
    (a0, a1, a2), (b0, b1, b2) = a.tolist(), b.tolist()
    return np.array([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0])
