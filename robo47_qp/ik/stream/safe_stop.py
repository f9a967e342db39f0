"""A way to rest that keeps all pairs of geoms apart, known before every step of a stream."""

import mujoco
import numpy as np

from robo47_qp._core.library import Structure, backend, functions, pointer
from robo47_qp._core.mujoco_functions import function, structure
from robo47_qp.arrays import Matrix, Vector
from robo47_qp.collision.distance import GeomDistance
from robo47_qp.collision.motion_bounds import approach_speed_bounds
from robo47_qp.ik.stream.joint_bounds import JointBounds, VelocityBox, braked
from robo47_qp.model.chain import MAX_JOINTS

SAMPLES = 8
"""Configurations on the way to rest that are looked at, evenly along it."""
AHEAD = 0.1
"""Beyond what is needed, distances are told apart up to this much further [m]."""


class SafeStop:
    """Lets a stream take a step only if it can still stop after it without coming too close.

    Rows of `ClearanceBounds` are for one pair each: where several pairs want a joint to brake in
    different ways, or at the end of its range, each row can be kept now and all together cannot
    later. So before every step two ways to rest after it are looked at: every joint brakes as
    hard as it may, or all brake in proportion, which keeps their direction. If neither keeps the
    distance, the arm does not take the step; it goes on the way to rest that was found before the
    last one, which is there by induction. (This is a safety filter with a backup manoeuvre: Gurriet
    et al., "An online approach to active set invariance", 2018.)

    A pair is measured again only where its smallest distance on the way may have become too
    small: with L of `approach_speed_bounds` it sinks by no more than L times what any point of
    the present way is off the one before, and that is largest at one of their ends.
    """

    def __init__(
        self,
        m: mujoco.MjModel,
        pairs: tuple[tuple[int, int], ...],
        joints: JointBounds,
        least: float,
    ) -> None:
        """Look at pairs of geoms (`pairs`) of an arm's model, to be kept `least` [m] apart."""
        self._model, self._data, self._ends = m, mujoco.MjData(m), pairs
        self._joints, self._a, self._dt = joints, joints.a_max, joints.dt
        self._least, self._far = least, least + AHEAD
        self._L = approach_speed_bounds(m, pairs)
        measure = GeomDistance(m, self._data)
        self._capsule_and_box = [measure.capsule_and_box(a, b) for a, b in pairs]
        # The way that is left falls with the square of the time that is left.
        self._share = 1.0 - np.sqrt(1.0 - np.arange(1, SAMPLES + 1) / SAMPLES)
        self._q, self._v = np.zeros((2, len(joints.a_max))), np.zeros((2, len(joints.a_max)))
        self._bound = np.full((2, len(pairs)), -np.inf)
        self._together: int | None = None

    def reset(self, q: Vector, v: Vector) -> None:
        """Start from a state (n,) [rad], (n,) [rad/s], from which there may be no safe stop."""
        self._q[:], self._v[:], self._bound[:] = q, v, -np.inf
        self._together = None
        self._is_safe(q, v)

    def step(self, q: Vector, v: Vector, v_next: Vector, box: VelocityBox) -> tuple[Vector, bool]:
        """Return the velocity to take at the next tick, and whether it is another than asked for.

        Args:
            q: Position now (n,) [rad].
            v: Velocity now (n,) [rad/s].
            v_next: Velocity asked for (n,) [rad/s].
            box: Velocities that limits of joints allow.
        """
        before = self._together
        if self._is_safe(self._joints.moved(q, v, v_next), v_next) or before is None:
            return v_next, False
        if before:
            T = self._time(v)
            rest: Vector = v * (1.0 - self._dt / T if self._dt < T else 0.0)
        else:
            rest = braked(v, self._a, self._dt)
        return np.minimum(np.maximum(rest, box.low), box.high), True

    def _is_safe(self, q: Vector, v: Vector) -> bool:
        """Look for a safe stop, of the kind found last at first."""
        first = self._together or 0
        for together in (first, 1 - first):
            if together and not self._ends_inside(q, v):
                continue
            if self._is_clear(together, q, v):
                self._together = together
                return True
        return False

    def _ends_inside(self, q: Vector, v: Vector) -> bool:
        end = q + 0.5 * self._time(v) * v
        return not np.count_nonzero((end < self._joints.q_min) | (end > self._joints.q_max))

    def _time(self, v: Vector) -> float:
        return float((np.abs(v) / self._a).max())

    def _slower(self, together: int, v: Vector) -> Vector:
        """Velocity after a tick of a stop."""
        if not together:
            return braked(v, self._a, self._dt)
        T = self._time(v)
        slower: Vector = v * (1.0 - self._dt / T if self._dt < T else 0.0)
        return slower

    def _way(self, together: int, v: Vector) -> Vector:
        own: float | Vector = self._time(v) if together else np.abs(v) / self._a
        way: Vector = 0.5 * v * own
        return way

    def _is_clear(self, together: int, q: Vector, v: Vector) -> bool:
        self._sink(together, q, v)
        bound, far = self._bound[together], self._far
        todo = np.flatnonzero(bound < self._least)
        if not len(todo):
            return True
        found, T = np.full(len(todo), far), self._time(v)
        for share in self._share[::-1] if T > 0.0 else self._share[-1:]:
            self._place(together, share * T, q, v)
            for k, i in enumerate(todo.tolist()):
                found[k] = min(found[k], self._measured(i))
                if found[k] < self._least:
                    return False
        bound[todo] = found
        return True

    def _sink(self, together: int, q: Vector, v: Vector) -> None:
        q0, v0 = self._q[together], self._v[together]
        end = q0 + self._way(together, v0)
        # A tick further on the way before: its rest has been looked at, too.
        start = self._joints.moved(q0, v0, self._slower(together, v0))
        off = np.maximum(np.abs(q - start), np.abs(q + self._way(together, v) - end))
        self._bound[together] -= self._L @ off
        q0[:], v0[:] = q, v

    def _place(self, together: int, t: float, q: Vector, v: Vector) -> None:
        own = np.full(len(v), self._time(v)) if together else np.abs(v) / self._a
        gone, own = np.minimum(t, own), np.where(own > 0.0, own, 1.0)
        self._data.qpos[:] = q + v * gone * (1.0 - 0.5 * gone / own)
        mujoco.mj_kinematics(self._model, self._data)

    def _measured(self, pair: int) -> float:
        m, d, (a, b) = self._model, self._data, self._ends[pair]
        if m.geom_rbound[a] > 0.0 and m.geom_rbound[b] > 0.0:
            apart = d.geom_xpos[a] - d.geom_xpos[b]
            if apart.dot(apart) > (m.geom_rbound[a] + m.geom_rbound[b] + self._far) ** 2:
                return self._far
        capsule, box = self._capsule_and_box[pair]
        if capsule >= 0 and self._may_cross(capsule, box):
            return 0.0
        return float(mujoco.mj_geomDistance(m, d, a, b, self._far, None))

    def _may_cross(self, capsule: int, box: int) -> bool:
        """Whether a capsule's axis may cross a box, where MuJoCo's distance is not sure."""
        m, d = self._model, self._data
        R: Matrix = d.geom_xmat[box].reshape(3, 3)
        middle = (d.geom_xpos[capsule] - d.geom_xpos[box]) @ R
        axis = d.geom_xmat[capsule].reshape(3, 3)[:, 2] @ R
        reach = m.geom_size[box] + m.geom_size[capsule, 1] * np.abs(axis) + 1e-9
        return bool((np.abs(middle) < reach).all())


class CompiledStop(SafeStop):
    """The same by the compiled core."""

    def __init__(
        self,
        m: mujoco.MjModel,
        pairs: tuple[tuple[int, int], ...],
        joints: JointBounds,
        least: float,
    ) -> None:
        """See `SafeStop`."""
        super().__init__(m, pairs, joints, least)
        first, second = np.transpose(pairs).astype(np.int32)
        capsule, box = np.transpose(self._capsule_and_box).astype(np.int32)
        d = self._data
        self._core = Structure(
            "r47_stop",
            n=len(self._a),
            pairs=len(pairs),
            samples=SAMPLES,
            model=structure(m),
            data=structure(d),
            kinematics=function("mj_kinematics"),
            distance=function("mj_geomDistance"),
            qpos=d.qpos,
            xpos=d.geom_xpos,
            xmat=d.geom_xmat,
            size=m.geom_size,
            rbound=m.geom_rbound,
            first=first.copy(),
            second=second.copy(),
            capsule=capsule.copy(),
            box=box.copy(),
            L=self._L,
            a=self._a.copy(),
            share=self._share,
            dt=self._dt,
            least=self._least,
            far=self._far,
            q=self._q,
            v=self._v,
            bound=self._bound,
            todo=np.zeros(len(pairs), dtype=np.int64),
            found=np.zeros(len(pairs)),
        )
        self._given = np.zeros((2, len(self._a)))
        self._q_and_v = pointer(self._given[0]), pointer(self._given[1])

    def _is_clear(self, together: int, q: Vector, v: Vector) -> bool:
        self._given[:] = q, v
        core = self._core.pointer
        return bool(functions().r47_stop_is_clear(core, together, *self._q_and_v))


def stop_type(n: int) -> type[SafeStop]:
    """Return the class that the chosen backend has for n joints."""
    return CompiledStop if backend() == "compiled" and n <= MAX_JOINTS else SafeStop
