"""SmoothStream: streaming inverse kinematics without steps in acceleration."""

from collections.abc import Sequence

import numpy as np
from mink import SE3
from numpy.lib.stride_tricks import sliding_window_view

from robo47_qp.arrays import Range
from robo47_qp.ik.stream.settings import StreamTick
from robo47_qp.ik.stream.stream import StreamSolver
from robo47_qp.model.arm import JointReference
from robo47_qp.motion.trajectory import Trajectory


class SmoothStream:
    """Moving average of the commands of an IK stream.

    The acceleration of a stream may jump from one bound to the other within a tick, and the
    torque with it, faster than motors can follow. The mean of q, v and a over w ticks of length dt
    lags by (w - 1) dt / 2. It keeps every bound on q, v and a that the stream keeps, and its jerk
    is at most 2 a_max / (w dt).
    """

    def __init__(self, stream: StreamSolver, window: int) -> None:
        """Keep the stream to smooth.

        Args:
            stream: It is reset before its first tick here.
            window: w, at least 1.

        Raises:
            InvalidValueError: The window is no such number.
        """
        Range(at_least=1, whole=True, single=True).check("window", window)
        self._stream, self._window = stream, window
        self._now = JointReference(*np.full((3, stream.arm.n), np.nan))
        self.ticks: Sequence[StreamTick] = ()
        """What the stream told in the last block, before the mean."""

    def reset(self, now: JointReference) -> None:
        """Start from a reference in motion, without a step in the mean.

        The previous ticks are assumed to have its acceleration, and its position and velocity as
        their mean; so the stream itself starts half a window ahead.
        """
        dt, w = self._stream.settings.dt, self._window
        t = (np.arange(w) - 0.5 * (w - 1))[:, None] * dt
        q = now.q + now.v * t + 0.5 * now.a * (t * t - np.mean(t * t))
        self._last = np.stack([q, now.v + now.a * t, np.tile(now.a, (w, 1))], axis=1)
        self._now = now
        self._stream.reset(self._last[-1, 0], self._last[-1, 1])

    @property
    def lag(self) -> float:
        """Time by which the mean is behind the stream [s]."""
        return 0.5 * (self._window - 1) * self._stream.settings.dt

    def stands_at(self, now: JointReference) -> bool:
        """Return whether the last tick was this, so that the next one continues it."""
        return all(map(np.array_equal, self._now, now))

    def block(self, targets: Sequence[SE3 | None]) -> Trajectory:
        """Return the next ticks, one per target, from the current reference.

        Args:
            targets: T_world_tcp wanted at each tick; None brakes.
        """
        stream, w = self._stream, self._window
        self.ticks = [stream.tick(target) for target in targets]
        fresh = np.array([(tick.q, tick.v, tick.a) for tick in self.ticks])
        rows = np.concatenate([self._last, fresh])
        means = sliding_window_view(rows[1:], w, axis=0).mean(axis=-1)
        states = np.concatenate([np.stack(self._now)[None], means])
        self._last = rows[-w:]
        arm = stream.arm
        q = np.clip(states[:, 0], arm.q_min, arm.q_max)  # of the rounding of means
        q[0] = self._now.q
        self._now = JointReference(q[-1].copy(), states[-1, 1].copy(), states[-1, 2].copy())
        return Trajectory(dt=stream.settings.dt, q=q, v=states[:, 1], a=states[:, 2])
