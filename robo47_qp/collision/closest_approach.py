"""Closest approach: the smallest distance between a moving robot and its obstacles."""

from collections.abc import Sequence
from functools import lru_cache
from math import inf
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from robo47_qp._core.library import Structure, functions
from robo47_qp.arrays import Matrix, Vector, contiguous
from robo47_qp.collision.distance import GeomDistance
from robo47_qp.collision.motion_bounds import approach_speed_bounds
from robo47_qp.collision.pair_distances import PairDistances
from robo47_qp.collision.pairs import GeomPairs
from robo47_qp.errors import InvalidValueError, ModelError
from robo47_qp.model.arm import Arm
from robo47_qp.model.mjcf import robot_spec
from robo47_qp.model.obstacle import Obstacle, add_obstacle
from robo47_qp.model.robot import Robot

RESOLUTION = 0.1e-3
"""How much closer than the distance found the robot may have been, by default [m]."""
_FIRST_ROWS = 33
_MOUNTED = 1e-4
"""Distance at home up to which a geom is mounted on what is fixed [m]."""


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
    """Measures a robot, with its fingers as recorded, against obstacles, and against itself."""

    def __init__(
        self,
        robot: Robot,
        obstacles: Sequence[Obstacle],
        *,
        own: bool = False,
        mounted: bool = False,
    ) -> None:
        """Compile robot and obstacles into one model.

        Args:
            robot: The robot.
            obstacles: What is around it.
            own: Whether its links are measured against each other, too: the pairs of `GeomPairs`,
                those of its mount and of its other arms included.
            mounted: Whether the robot stands on them: pairs that touch at home are left out.

        Raises:
            InvalidValueError: The name of an obstacle is taken.
            ModelError: No geom of the robot can ever touch an obstacle.
        """
        spec = robot_spec(robot, drawn=False)
        for obstacle in obstacles:
            add_obstacle(spec, obstacle)
        m = spec.compile()
        names = (*robot.joints, *(name for gripper in robot.grippers for name in gripper.joints))
        joints = [m.joint(name).id for name in names]
        self._model = m
        solid = np.flatnonzero((m.geom_contype != 0) | (m.geom_conaffinity != 0))
        around = [m.geom(obstacle.name).id for obstacle in obstacles]
        pairs = [(min(a, b), max(a, b)) for a in solid.tolist() for b in around if a != b]
        if mounted:
            arm = [m.joint(joint).id for joint in robot.joints]
            d = mujoco.MjData(m)
            d.qpos[m.jnt_qposadr[arm]] = robot.home
            mujoco.mj_kinematics(m, d)
            measure = GeomDistance(m, d)
            pairs = [pair for pair in pairs if measure.between(*pair, inf) > _MOUNTED]
        if own:
            pairs += _own_pairs(robot, [geom for geom in solid.tolist() if geom not in around])
        reach = approach_speed_bounds(m, tuple(pairs))[:, joints]
        moves: NDArray[np.bool_] = np.count_nonzero(reach, axis=1) > 0
        self._pairs = [pair for pair, moved in zip(pairs, moves, strict=True) if moved]
        self.pairs = len(self._pairs)
        """How many pairs of geoms are measured; none for links too few to touch each other."""
        if obstacles and not self._pairs:
            raise ModelError(
                f"No geom of robot {robot.name!r} that moves can touch anything: its distance "
                "from obstacles is not known. Give its links collision geoms."
            )
        self.distances = PairDistances(m, joints, self._pairs, reach[moves])
        """Distances of the pairs."""
        self._around = set(around)

    def along(self, q: Matrix, *, resolution: float = RESOLUTION) -> Nearest:
        """Return the smallest distance over all rows.

        The distance of a pair of geoms falls by no more than its bounds times the joint
        displacements, so rows are skipped in which the pair cannot be closer than the smallest
        distance found so far.

        Args:
            q: Joints of the arm, then of its grippers (N, joints) [rad or m].
            resolution: How much smaller it may be than what is found, at most [m]; 0 finds it in
                about twice the time.

        Raises:
            InvalidValueError: There are no rows, or they are of another size.
        """
        q = contiguous("q", q, None, self.distances.joints)
        if not len(q):
            raise InvalidValueError("q", "none", "one row or more")
        travelled = np.cumsum(np.abs(np.diff(q, axis=0, prepend=q[:1])), axis=0)
        rows = np.unique(np.linspace(0, len(q) - 1, _FIRST_ROWS).astype(int)).tolist()
        first = np.array([self.distances.at(q[row]) for row in rows])
        k, which = divmod(int(first.argmin()), len(self._pairs))
        best, at = float(first[k, which]), (rows[k], which)
        order = np.argsort(first.min(axis=0), kind="stable")
        if self.distances.core is not None:
            start = first[0], best, at
            best, at = self._followed(self.distances.core, q, travelled, order, start, resolution)
            return Nearest(best, at[0], *self._names(at[1]))
        for i in order.tolist():
            closed, row, apart = travelled @ self.distances.reach[i], 0, float(first[0, i])
            while True:
                far = closed[row] + apart - best + resolution
                row = max(row + 1, int(np.searchsorted(closed, far, side="right")))
                if row >= len(q):
                    break
                self.distances.place(q[row])
                apart = self.distances.between(i)
                if apart < best:
                    best, at = apart, (row, i)
        return Nearest(best, at[0], *self._names(at[1]))

    def _followed(
        self,
        core: Structure,
        q: Matrix,
        travelled: Matrix,
        order: NDArray[np.intp],
        found: tuple[Vector, float, tuple[int, int]],
        resolution: float,
    ) -> tuple[float, tuple[int, int]]:
        """Return what `along` finds in the compiled core: the smallest distance, its row and pair.

        Args:
            core: The structure `r47_approach`.
            q: As in `along`.
            travelled: How far each joint has come since the first row (N, joints) [rad or m].
            order: Order in which the pairs are followed (pairs,).
            found: Distances in the first row (pairs,), and the smallest so far, with its place [m].
            resolution: As in `along`.
        """
        start, best, (row, pair) = found
        path = Structure(
            "r47_path",
            rows=len(q),
            q=q,
            travelled=travelled,
            start=start,
            order=order.astype(np.int32),
            resolution=resolution,
            best=best,
            best_row=row,
            best_pair=pair,
            row=-1,
        )
        p = path.pointer
        while functions().r47_approach_along(core.pointer, p):
            p.distance = self.distances.between(int(order[p.next]))
        return float(p.best), (int(p.best_row), int(p.best_pair))

    def _names(self, pair: int) -> tuple[str, str]:
        m = self._model
        one, other = sorted(self._pairs[pair], key=lambda geom: geom in self._around)
        if other in self._around:
            return _body(m, one), str(m.geom(other).name)
        return _body(m, one), _body(m, other)


@lru_cache(maxsize=8)
def closest_approach(
    robot: Robot, obstacles: tuple[Obstacle, ...], *, own: bool = False, mounted: bool = False
) -> ClosestApproach:
    """Return a `ClosestApproach`, the same one for the same arguments, as it takes long to make."""
    return ClosestApproach(robot, obstacles, own=own, mounted=mounted)


def _body(m: mujoco.MjModel, geom: int) -> str:
    """Return the name of the body of a geom."""
    body = int(m.geom_bodyid[geom])
    return str(m.body(body).name) or f"body {body}"


def _own_pairs(robot: Robot, own: Sequence[int]) -> list[tuple[int, int]]:
    """Return the pairs of a robot's geoms that are kept apart, as `GeomPairs` has them.

    Args:
        robot: The robot.
        own: Numbers of its geoms that collide, in the order of its file.

    Raises:
        ModelError: The model has other geoms than that of `Arm`.
    """
    arm = Arm(robot)
    theirs = np.flatnonzero((arm.model.geom_contype != 0) | (arm.model.geom_conaffinity != 0))
    if len(own) != len(theirs):
        raise ModelError(
            f"Robot {robot.name!r} has {len(own)} geoms that collide, its arm {len(theirs)}; "
            "they must be the same ones."
        )
    place = dict(zip(theirs.tolist(), own, strict=True))
    return [(place[a], place[b]) for a, b in GeomPairs.of(arm, 0.0, some=False).kept]
