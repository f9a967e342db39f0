"""Distances of chosen pairs of geoms, in any configuration of a robot."""

from collections.abc import Sequence
from math import inf

import mujoco
import numpy as np

from robo47_qp._core.library import Structure, backend, functions, pointer
from robo47_qp._core.mujoco_functions import function, structure
from robo47_qp.arrays import Matrix, Vector, contiguous
from robo47_qp.collision.broad_phase import BroadPhase
from robo47_qp.collision.distance import FAR, GeomDistance


class PairDistances:
    """Measures pairs of geoms as `GeomDistance` does; what bounding boxes tell apart is skipped.

    MuJoCo's contacts are no measure of what is apart: of a capsule and a cylinder they tell up to
    20 mm too much, and two boxes can be near each other without any.
    """

    def __init__(
        self,
        m: mujoco.MjModel,
        joints: Sequence[int],
        pairs: Sequence[tuple[int, int]],
        reach: Matrix,
    ) -> None:
        """Choose joints and pairs.

        Args:
            m: The model; all other joints stay where they are by default.
            joints: Numbers of the joints of a configuration.
            pairs: Numbers of two geoms each, one of which moves.
            reach: By how much each joint brings a pair closer, at most (pairs, joints) [m per rad].
        """
        self.model, self.data = m, mujoco.MjData(m)
        self.pairs = list(pairs)
        self.reach = np.ascontiguousarray(reach)
        self._addresses = m.jnt_qposadr[list(joints)]
        self.joints = len(self._addresses)
        """How many numbers a configuration has."""
        self._measure = GeomDistance(m, self.data)
        self._broad = BroadPhase(m, tuple(self.pairs)) if self.pairs else None
        compiled = bool(self.pairs) and backend() == "compiled"
        self.core = self._in_core() if compiled else None
        """The structure `r47_approach`, where the backend is compiled and there are pairs."""

    def place(self, q: Vector) -> None:
        """Move the joints."""
        self.data.qpos[self._addresses] = q
        mujoco.mj_kinematics(self.model, self.data)

    def between(self, pair: int, seen: float = inf) -> float:
        """Return the signed distance of a pair where the joints are, `seen` at most [m]."""
        return self._measure.between(*self.pairs[pair], seen)

    def at(self, q: Vector, seen: float = inf) -> Vector:
        """Return the signed distances at a configuration, `seen` at most (pairs,) [m].

        Raises:
            InvalidValueError: The configuration is of another size.
        """
        q = contiguous("q", q, self.joints)
        apart = np.full(len(self.pairs), seen)
        if self.core is not None:
            doubtful = np.empty(len(self.pairs), np.uint8)
            arrays = pointer(apart), pointer(doubtful)
            functions().r47_approach_at(self.core.pointer, pointer(q), seen, *arrays)
            near = np.flatnonzero(doubtful)
        else:
            self.place(q)
            near = np.arange(len(self.pairs))
            if self._broad is not None and seen < inf:
                near = np.flatnonzero(self._broad.bounds(self.data) < seen)
        for i in near.tolist():
            apart[i] = self.between(i, seen)
        return apart

    def _in_core(self) -> Structure:
        m, d = self.model, self.data
        capsule, box = np.transpose([self._measure.capsule_and_box(*pair) for pair in self.pairs])
        first, second = np.transpose(self.pairs)
        return Structure(
            "r47_approach",
            model=structure(m),
            data=structure(d),
            kinematics=function("mj_kinematics"),
            distance=function("mj_geomDistance"),
            qpos=d.qpos,
            joints=self.joints,
            address=self._addresses.astype(np.int32),
            xpos=d.geom_xpos,
            xmat=d.geom_xmat,
            size=m.geom_size,
            rbound=m.geom_rbound,
            aabb=m.geom_aabb,
            pairs=len(self.pairs),
            first=first.astype(np.int32),
            second=second.astype(np.int32),
            capsule=capsule.astype(np.int32),
            box=box.astype(np.int32),
            far=FAR,
            reach=self.reach,
        )
