"""Independent evaluation of IK results by MuJoCo, on the robot's own file."""

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from mink import SE3
from numpy.typing import ArrayLike

from robo47_qp.arrays import Vector
from robo47_qp.ik.solver import Tolerance
from robo47_qp.model.mjcf import compiled, robot_spec
from robo47_qp.model.obstacle import Obstacle, add_obstacle
from robo47_qp.model.robot import Robot

LOOSE = Tolerance(position=1e-3, orientation=float(np.radians(0.1)))
"""Errors that count as success: 1 mm and 0.1 degrees."""
TIGHT = Tolerance(position=1e-4, orientation=1e-3)
"""Tighter errors: 0.1 mm and 1 mrad."""


class IkVerdict(NamedTuple):
    """Measured errors, limit violation and collision of a configuration."""

    position_error: float
    """Distance of the tool from the target [m]; infinite where there is no configuration."""
    orientation_error: float
    """Angle between the tool and the target [rad]; infinite where there is no configuration."""
    limit_excess: float
    """Largest violation of a joint limit; 0 where there is none [rad or m]."""
    penetration: float
    """Depth of the deepest contact; 0 where nothing touches [m]."""
    pair: tuple[str, str] | None
    """Bodies of the deepest contact."""

    def within(self, tolerance: Tolerance) -> bool:
        """Return True if the errors are within the tolerance and all joints within their limits."""
        return (
            self.position_error <= tolerance.position
            and self.orientation_error <= tolerance.orientation
            and self.limit_excess <= 0.0
        )

    @property
    def free(self) -> bool:
        """True where nothing collides."""
        return self.penetration <= 0.0


def joint_limits(model: mujoco.MjModel, names: Sequence[str]) -> tuple[Vector, Vector]:
    """Return the least and the largest configuration (n,) [rad or m], infinite without limits."""
    joints = [model.joint(name) for name in names]
    limited = [bool(model.jnt_limited[joint.id]) for joint in joints]
    ranges = np.array([joint.range for joint in joints])
    low, high = np.where(limited, ranges.T, [[-np.inf], [np.inf]])
    return low, high


_NO_ANSWER = IkVerdict(np.inf, np.inf, 0.0, 0.0, None)


class Judge:
    """Evaluates configurations by forward kinematics, limits and contacts, without solver code.

    Contacts are those of the robot with itself and with the obstacles. Geoms that touch at home by
    construction do not count. Joints that the arm does not drive, such as fingers, are at zero.
    """

    def __init__(self, robot: Robot, obstacles: Sequence[Obstacle] = ()) -> None:
        """Compile the robot's own file with obstacles."""
        spec = robot_spec(robot)
        for obstacle in obstacles:
            add_obstacle(spec, obstacle)
        self._model = compiled(spec, robot.mjcf)
        self._data = mujoco.MjData(self._model)
        joints = [self._model.joint(name) for name in robot.joints]
        self._q = [int(joint.qposadr[0]) for joint in joints]
        self._low, self._high = joint_limits(self._model, robot.joints)
        self._tcp = self._model.site(robot.tcp).id
        self._built_in: frozenset[tuple[int, int]] = frozenset()
        self._place(np.asarray(robot.home))
        self._built_in = frozenset(pair for pair, _ in self._contacts())

    def verdict(self, T_world_target: SE3, q: ArrayLike) -> IkVerdict:
        """Evaluate a configuration; what is no finite vector of n joints counts as no result."""
        values = np.asarray(q, dtype=np.float64)
        target = np.asarray(getattr(T_world_target, "wxyz_xyz", ()), dtype=np.float64)
        if values.shape != self._low.shape or not np.isfinite(values).all():
            return _NO_ANSWER
        self._place(values)
        position, angle = self._errors(target)
        excess = float(np.maximum(self._low - values, values - self._high).max())
        depth, pair = 0.0, None
        for geoms, distance in self._contacts():
            if -distance > depth:
                depth, pair = -distance, self._bodies(geoms)
        return IkVerdict(position, angle, max(0.0, excess), depth, pair)

    def _place(self, q: Vector) -> None:
        self._data.qpos[:] = self._model.qpos0
        self._data.qpos[self._q] = q
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_collision(self._model, self._data)

    def _errors(self, target: Vector) -> tuple[float, float]:
        """Return distance and angle between the tool and a target; infinite if it is no pose."""
        if target.shape != (7,) or not np.isfinite(target).all() or not target[:4].any():
            return np.inf, np.inf
        wxyz = target[:4] / np.linalg.norm(target[:4])
        R_target, R_turn = np.empty(9), self._data.site_xmat[self._tcp].reshape(3, 3)
        mujoco.mju_quat2Mat(R_target, wxyz)
        R = R_turn.T @ R_target.reshape(3, 3)
        # Sine and cosine of the angle: exact near zero and near half a turn.
        sine = np.linalg.norm([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
        angle = float(np.arctan2(sine, np.trace(R) - 1.0))
        return float(np.linalg.norm(target[4:] - self._data.site_xpos[self._tcp])), angle

    def _contacts(self) -> list[tuple[tuple[int, int], float]]:
        """Return the geoms in collision and their distances, built-in contacts left out [m]."""
        d = self._data
        pairs = np.sort(d.contact.geom, axis=1)
        found = [
            ((int(a), int(b)), float(distance))
            for (a, b), distance in zip(pairs, d.contact.dist, strict=True)
            if distance < 0.0
        ]
        return [contact for contact in found if contact[0] not in self._built_in]

    def _bodies(self, geoms: tuple[int, int]) -> tuple[str, str]:
        first, second = (self._model.body(int(self._model.geom_bodyid[g])).name for g in geoms)
        return first, second
