"""Closest approach: the smallest distance between a moving robot and its obstacles."""

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.collision.distance import GeomDistance
from robo47_qp.collision.motion_bounds import approach_speed_bounds
from robo47_qp.errors import ModelError
from robo47_qp.model.mjcf import robot_spec
from robo47_qp.model.obstacle import Obstacle, add_obstacle
from robo47_qp.model.robot import Robot

RESOLUTION = 0.1e-3
"""How much closer than the distance found the robot may have been, at most [m]."""
_FIRST_ROWS = 33


class Nearest(NamedTuple):
    """The smallest distance during a motion."""

    distance: float
    """Signed: negative where body and obstacle overlap [m]."""
    row: int
    """Row of the motion at which it occurs."""
    body: str
    """Body of the robot."""
    obstacle: str


class ClosestApproach:
    """Measures a robot, with its fingers as recorded, against obstacles."""

    def __init__(self, robot: Robot, obstacles: Sequence[Obstacle]) -> None:
        """Compile robot and obstacles into one model.

        Raises:
            InvalidValueError: The name of an obstacle is taken.
            ModelError: No geom of the robot can ever touch one.
        """
        spec = robot_spec(robot)
        for obstacle in obstacles:
            add_obstacle(spec, obstacle)
        m = spec.compile()
        names = (*robot.joints, *(name for gripper in robot.grippers for name in gripper.joints))
        joints = [m.joint(name).id for name in names]
        self._model, self._data = m, mujoco.MjData(m)
        self._addresses = m.jnt_qposadr[joints]
        self._measure = GeomDistance(m, self._data)
        solid = np.flatnonzero((m.geom_contype != 0) | (m.geom_conaffinity != 0))
        around = [m.geom(obstacle.name).id for obstacle in obstacles]
        pairs = [(min(a, b), max(a, b)) for a in solid.tolist() for b in around if a != b]
        reach = approach_speed_bounds(m, tuple(pairs))[:, joints]
        moves: NDArray[np.bool_] = np.count_nonzero(reach, axis=1) > 0
        self._pairs = [pair for pair, moved in zip(pairs, moves, strict=True) if moved]
        if not self._pairs:
            raise ModelError(
                f"No geom of robot {robot.name!r} that moves can touch anything: its distance "
                "from obstacles is not known. Give its links collision geoms."
            )
        self._reach = reach[moves]
        self._around = set(around)

    def along(self, q: Matrix) -> Nearest:
        """Return the smallest distance over all rows, found to within `RESOLUTION`.

        The distance of a pair of geoms falls by no more than its bounds times the joint
        displacements, so rows are skipped in which the pair cannot be closer than the smallest
        distance found so far.

        Args:
            q: Joints of the arm, then of its grippers (N, joints) [rad or m].
        """
        travelled = np.cumsum(np.abs(np.diff(q, axis=0, prepend=q[:1])), axis=0)
        rows = np.unique(np.linspace(0, len(q) - 1, _FIRST_ROWS).astype(int)).tolist()
        first = np.array([self._distances(q[row]) for row in rows])
        k, which = divmod(int(first.argmin()), len(self._pairs))
        best, at = float(first[k, which]), (rows[k], which)
        for i in np.argsort(first.min(axis=0), kind="stable").tolist():
            closed, row, apart = travelled @ self._reach[i], 0, float(first[0, i])
            while True:
                far = closed[row] + apart - best + RESOLUTION
                row = max(row + 1, int(np.searchsorted(closed, far, side="right")))
                if row >= len(q):
                    break
                self._place(q[row])
                a, b = self._pairs[i]
                apart = self._measure.between(a, b, inf)
                if apart < best:
                    best, at = apart, (row, i)
        return Nearest(best, at[0], *self._names(at[1]))

    def _distances(self, q: Vector) -> list[float]:
        self._place(q)
        return [self._measure.between(a, b, inf) for a, b in self._pairs]

    def _place(self, q: Vector) -> None:
        self._data.qpos[self._addresses] = q
        mujoco.mj_kinematics(self._model, self._data)

    def _names(self, pair: int) -> tuple[str, str]:
        m = self._model
        own, other = sorted(self._pairs[pair], key=lambda geom: geom in self._around)
        body = m.body(m.geom_bodyid[own]).name
        return str(body) or f"body {m.geom_bodyid[own]}", str(m.geom(other).name)
