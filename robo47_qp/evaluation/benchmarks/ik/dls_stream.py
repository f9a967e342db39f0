"""Damped least squares at a fixed rate, with what is usually added: the rival of `StreamIk`."""

from dataclasses import dataclass

import numpy as np

from robo47_qp.arrays import Vector
from robo47_qp.collision.clearance import Clearance
from robo47_qp.ik.stream.clearance_bounds import ClearanceBounds
from robo47_qp.ik.stream.joint_bounds import JointBounds, braked
from robo47_qp.ik.stream.stream import StreamIk
from robo47_qp.ik.stream.target_velocity import DampedInverse, TargetVelocity
from robo47_qp.ik.stream.targets import targets_of
from robo47_qp.model.arm import Arm


@dataclass(frozen=True, kw_only=True)
class DlsStream:
    """v_ref of `StreamIk`, damped as there, with a gradient of clearance in its null space.

    The gradient of Σ_i k (d_0 - d_i)² / (2 d_0) over the pairs closer than d_0 repels them as far
    as the tool allows (Liegeois, "Automatic supervisory control of the configuration and behavior
    of multibody mechanisms", 1977; Maciejewski and Klein, "Obstacle avoidance for kinematically
    redundant manipulators in dynamically varying environments", 1985). The velocity is then
    brought into the same box of joint limits as the QP has, by scaling or by clamping. Clearances
    are no constraints of it.
    """

    settings: StreamIk
    """Those of the stream that it is compared with."""
    repulsion: float = 2.0
    """k: speed of parting at no distance [m/s, along the gradient]."""
    influence: float = 0.1
    """d_0 [m]. Pairs that part or rest have rows only where they are nearer than
    `clearance_bounds.NEAR`: for them, repulsion begins there."""

    clamped: bool = False
    """How a velocity comes into the box. False: the joints of each arm are scaled together, between
    full braking and what is wanted, so that the tool keeps its direction, and waits where a joint
    is at its limit. True: each joint is clamped by itself, and the tool leaves its direction."""

    def build(self, arm: Arm) -> "DlsStreamSolver":
        """Return a stream for one arm, at rest at its home."""
        return DlsStreamSolver(self, arm)


class DlsStreamSolver:
    """The commanded state of one arm."""

    def __init__(self, stream: DlsStream, arm: Arm) -> None:
        """See `DlsStream.build`."""
        settings = stream.settings
        self.arm, self._stream, self._dt = arm, stream, settings.dt
        self.profile = arm.robot.profile if settings.profile is None else settings.profile
        bounds = JointBounds(arm.q_min, arm.q_max, self.profile, settings.dt, settings.margin)
        self.bounds = bounds
        self._wanted = TargetVelocity(settings, arm, self.profile)
        self.q, self.v = arm.home.copy(), np.zeros(arm.n)
        moved = np.array([arm.tool_joints(i) for i in range(len(arm.robot.tools))])
        self._arms = [(tools == moved.T).all(axis=1) for tools in np.unique(moved.T, axis=0)]
        """Joints that move the same tools, of which one scale is asked (n,)."""
        clearance = settings.clearance or 0.0
        self._near = ClearanceBounds(
            arm.derived(Clearance, clearance),
            self._wanted.data,
            bounds.a_max,
            settings.dt,
            d_min=clearance,
            braking_share=settings.braking_share,
            max_pairs=settings.max_pairs * len(arm.robot.tools) ** 2,
        )
        self._wanted.update(self.q)
        self._near.reset(self.q)

    def tick(self, target: object) -> tuple[Vector, Vector, Vector, float]:
        """Return q, v and a at the next tick, and the tool's error now [m]."""
        found = self._wanted.objective(targets_of(self.arm, target), self.q)
        rows = self._near.rows(self.q, self.v)
        lacking = np.maximum(self._stream.influence - rows.room, 0.0) / self._stream.influence
        away = -self._stream.repulsion * lacking.dot(rows.A)
        v_max = self.profile.v_max
        away /= max(1.0, float(np.abs(away / v_max).max()))
        inverse = DampedInverse(found.way.rows, self._stream.settings.singular_threshold)
        wanted = found.v_ref + inverse.null(away)
        box = self.bounds.box(self.q, self.v)
        v = np.clip(wanted, box.low, box.high)
        if not self._stream.clamped:
            v = self._scaled(wanted, box.low, box.high)
        a = (v - self.v) / self._dt
        self.q, self.v = self.bounds.moved(self.q, self.v, v), v
        return self.q.copy(), v.copy(), a, found.position_error

    def _scaled(self, wanted: Vector, low: Vector, high: Vector) -> Vector:
        """Return the velocity nearest to the wanted one on the way from full braking to it."""
        slow = np.clip(braked(self.v, self.bounds.a_max, self._dt), low, high)
        change = wanted - slow
        room = np.where(change > 0.0, high - slow, low - slow)
        shares = np.divide(room, change, out=np.ones_like(room), where=np.abs(change) > 1e-12)
        for joints in self._arms:
            shares[joints] = min(1.0, float(shares[joints].min()))
        v: Vector = np.clip(slow + shares * change, low, high)
        return v
