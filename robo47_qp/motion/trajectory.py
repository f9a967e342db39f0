"""Trajectory: joint references sampled at the control rate."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.model.arm import JointReference


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """Joint references at the instants 0, dt, 2 dt, ..., of which the last is the goal.

    It starts and ends at rest, unless it is a part of a motion without stops.
    A trajectory of N + 1 samples takes N control periods. Its last sample belongs to the
    instant at which the next one starts: that one's first sample repeats it.
    """

    dt: float
    """Time between samples [s]."""
    q: Matrix
    """Positions (N + 1, n) [rad]."""
    v: Matrix
    """Velocities (N + 1, n) [rad/s]."""
    a: Matrix
    """Accelerations (N + 1, n) [rad/s²]."""

    @property
    def steps(self) -> int:
        """Number of control periods, N."""
        return len(self.q) - 1

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return self.steps * self.dt

    @property
    def end(self) -> JointReference:
        """The goal, at rest unless another part follows."""
        return JointReference(self.q[-1].copy(), self.v[-1].copy(), self.a[-1].copy())

    @property
    def still(self) -> bool:
        """True where nothing moves."""
        return not (self.v.any() or self.a.any() or (self.q != self.q[0]).any())

    @property
    def jerk(self) -> Matrix:
        """Mean jerk between samples (N, n) [rad/s³]."""
        return np.diff(self.a, axis=0) / self.dt

    def part(self, first: int, last: int) -> "Trajectory":
        """Return the part from one sample to another, both included."""
        rows = slice(first, last + 1)
        return Trajectory(
            dt=self.dt, q=self.q[rows].copy(), v=self.v[rows].copy(), a=self.a[rows].copy()
        )


class JointCurve(Protocol):
    """A twice differentiable path of all joints over a parameter in [0, 1]."""

    def __call__(self, x: Vector | float, nu: int = 0) -> Matrix:
        """Return the derivative of an order, at one x (n,) or many (N, n)."""
        ...


def along(path: JointCurve, rows: Matrix, dt: float) -> Trajectory:
    """Return the motion along a path: q(t) = path(s(t)), by the chain rule.

    Args:
        path: The path.
        rows: Its parameter s with two derivatives by time, every dt (N + 1, 3).
        dt: Time between samples [s].
    """
    s, (ds, dds) = rows[:, 0], rows.T[1:, :, None]
    dq, ddq = path(s, 1), path(s, 2)
    return Trajectory(dt=dt, q=path(s), v=dq * ds, a=ddq * ds**2 + dq * dds)


def joined(parts: Sequence[Trajectory]) -> Trajectory:
    """Return one trajectory from several, each of which starts where the one before it ends."""
    first, later = parts[0], parts[1:]
    q, v, a = (
        np.vstack([getattr(first, name), *(getattr(part, name)[1:] for part in later)])
        for name in "qva"
    )
    return Trajectory(dt=first.dt, q=q, v=v, a=a)


def hold(q: Vector, steps: int, dt: float) -> Trajectory:
    """Return a trajectory that stays at q for a number of control periods."""
    rest = np.zeros((steps + 1, len(q)))
    return Trajectory(dt=dt, q=np.tile(q, (steps + 1, 1)), v=rest, a=rest.copy())
