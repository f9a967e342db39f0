"""Differential inverse kinematics at a fixed rate: a command for every tick and any target."""

from collections import Counter
from dataclasses import dataclass
from math import inf

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from robo47_qp.arrays import Vector, checked_vector
from robo47_qp.collision.clearance import Clearance
from robo47_qp.ik.stream.clearance_bounds import ClearanceBounds, VelocityRows
from robo47_qp.ik.stream.compiled_bounds import bounds_type
from robo47_qp.ik.stream.compiled_velocity import velocity_type
from robo47_qp.ik.stream.joint_bounds import JointBounds, VelocityBox, braked
from robo47_qp.ik.stream.safe_stop import SafeStop, stop_type
from robo47_qp.ik.stream.settings import Event, StreamSettings, StreamTick
from robo47_qp.ik.stream.target_velocity import VelocityObjective
from robo47_qp.ik.stream.targets import targets_of
from robo47_qp.ik.stream.user_parts import UserParts, null_space
from robo47_qp.ik.stream.velocity_qp import Kept, VelocityQp
from robo47_qp.model.arm import Arm

_STOPS_WITHIN = 0.15
"""Part of the buffer that is left at the end of a stop, against what lies between samples."""


@dataclass(frozen=True, kw_only=True)
class StreamIk(StreamSettings):
    """Differential IK for a target that moves. It is its settings and one method.

    Each tick asks for the joint velocity v_ref = J⁺ V + φ J⁺ e + (I - J⁺ J) v_home: the
    target's own velocity V, the way e to it at a pace φ at which every joint can stop in time
    (`approach_rate`), and in what is left of the arm's freedom a slow return home. The next
    velocity v' is then

        min over v' of ½ ‖J (v' - v_ref)‖² + ½ μ ‖v' - v_ref‖²   subject to v' in the box

    of `JointBounds`: limits of position, velocity and acceleration, with the room to brake. Where
    a clearance is asked for, it is also subject to the rows A v' <= upper of `ClearanceBounds`,
    the speeds at which pairs of geoms may approach. What gives way is, in this order:

    1. the null-space motion;
    2. the user's `objectives`, the highest numbers of priority first: each level moves the arm in
       what the levels before leave free (`Event.OBJECTIVE_RELAXED`);
    3. the way of the tools to their targets, with the objectives of priority 0: costs decide;
    4. the user's `limits`, where no velocity in the box meets all rows (`Event.LIMIT_RELAXED`);
    5. the user's `constraints`, where there is none either (`Event.CONSTRAINT_RELAXED`);
    6. the rows of clearances: pairs with much room first, those without any last (`VelocityQp`),
       told by `Event.CLEARANCE_RELAXED`;
    7. all of these where the arm could not stop after the step without coming too close: it brakes
       instead (`SafeStop`, `Event.STOPPING`);
    8. never a limit of q, v or a, nor a frozen joint. The box is not empty, so there is always an
       answer.

    A part of the user's that raises or is not finite is left out of that tick and counted
    (`UserParts`). Several tools are followed at once, each with its joints at its own pace.

    It descends along the way to the target and does not plan. An arm that meets a joint limit
    or an obstacle on that way can stop there though another configuration would reach the
    target: for far targets find the configuration first, by `MultiStart`.
    """

    def build(self, arm: Arm) -> "StreamSolver":
        """A stream for one arm, at rest at its home.

        Raises:
            UnknownNameError: No QP solver is called `backend`; an objective is for a frame that is
                not there.
            InvalidValueError: The profile is for another number of joints; an objective or a limit
                of the user's is none, see `composed`.
            ModelError: A clearance is asked for and the arm has no geoms to keep apart.
        """
        return StreamSolver(self, arm)


class StreamSolver:
    """The commanded state of one arm, advanced tick by tick. Same targets, same commands."""

    def __init__(self, settings: StreamIk, arm: Arm) -> None:
        """See `StreamIk.build`."""
        self.settings = settings
        self.arm = arm
        profile = arm.robot.profile if settings.profile is None else settings.profile
        self.profile = profile
        """Limits of velocity and acceleration that are kept."""
        self.bounds = JointBounds(arm.q_min, arm.q_max, profile, settings.dt, settings.margin)
        self._qp = VelocityQp(settings.backend, arm.n)
        self._target_velocity = velocity_type(settings, arm.n)(settings, arm, profile)
        data, a_max = self._target_velocity.data, self.bounds.a_max
        self._clearance_bounds = _clearance_bounds(settings, arm, data, a_max)
        self._stop = _safe_stop(settings, arm, self.bounds)
        composes = settings.objectives or settings.limits or settings.constraints
        parts = UserParts(settings, arm, profile) if composes or settings.frozen else None
        self._user = parts if composes else None
        self._frozen = [] if parts is None else [*parts.composed.frozen]
        self._target_velocity.freeze(self._frozen)
        self._least = -inf if settings.clearance is None else settings.clearance
        self._counts: Counter[Event] = Counter()
        self.reset(arm.home)

    @property
    def counts(self) -> dict[Event, int]:
        """Number of ticks with each condition since the last reset."""
        return {event: self._counts[event] for event in Event}

    @property
    def q(self) -> Vector:
        """Commanded position now (n,) [rad]."""
        return self._q.copy()

    @property
    def v(self) -> Vector:
        """Commanded velocity now (n,) [rad/s]."""
        return self._v.copy()

    def reset(self, q: ArrayLike, v: ArrayLike | None = None) -> None:
        """Start from a state of the arm, inside its limits or not; at rest where v is None.

        Raises:
            InvalidValueError: q or v is not a finite vector of shape (n,).
        """
        n = self.arm.n
        self._q = checked_vector("q", q, n)
        self._v = np.zeros(n) if v is None else checked_vector("v", v, n)
        self._target_velocity.reset()
        self._counts.clear()
        if self._clearance_bounds is not None:
            self._target_velocity.update(self._q)
            self._clearance_bounds.reset(self._q)
        if self._stop is not None:
            self._stop.reset(self._q, self._v)

    def tick(self, T_world_target: object) -> StreamTick:
        """Move the command on by one tick, towards where the target is now.

        Args:
            T_world_target: Wanted T_world_tcp (SE3) of the main tool, or `ToolPoses` of several.
                Anything else brakes the arm; what is no pose in a mapping holds that tool still.
        """
        events: set[Event] = set()
        targets = targets_of(self.arm, T_world_target)
        objective = self._target_velocity.objective(targets, self._q)
        events.update(objective.events)
        box = self.bounds.box(self._q, self._v)
        if box.recovering:
            events.add(Event.RECOVERING)
        if self._frozen:
            self._hold(box)
        rows, clearance = None, inf
        if self._clearance_bounds is not None:
            rows = self._clearance_bounds.rows(self._q, self._v)
            clearance = self._clearance_bounds.measured
            if clearance < self._least:
                events.add(Event.TOO_CLOSE)
        if self._user is None:
            v_next, told = self._qp.nearest(objective.H, objective.v_ref, box, rows)
            if told is not None:
                events.add(told)
        else:
            v_next = self._composed(self._user, objective, box, rows, events)
        if self._stop is not None:
            v_next, stopping = self._stop.step(self._q, self._v, v_next, box)
            if stopping:
                events.add(Event.STOPPING)
        q_next = self.bounds.moved(self._q, self._v, v_next)
        a = (v_next - self._v) / self.settings.dt
        self._q, self._v = q_next, v_next
        if events:
            self._counts.update(events)
        return StreamTick(
            q=q_next.copy(),
            v=v_next.copy(),
            a=a,
            position_error=objective.position_error,
            orientation_error=objective.orientation_error,
            clearance=clearance,
            rows=0 if rows is None else len(rows.upper),
            events=tuple(e for e in Event if e in events) if events else (),
        )

    def _hold(self, box: VelocityBox) -> None:
        """Narrow the box so that frozen joints brake to rest, and stay there."""
        braking, at = braked(self._v, self.bounds.a_max, self.settings.dt), self._frozen
        box.low[at] = box.high[at] = np.clip(braking, box.low, box.high)[at]

    def _composed(
        self,
        user: UserParts,
        objective: VelocityObjective,
        box: VelocityBox,
        rows: VelocityRows | None,
        events: set[Event],
    ) -> Vector:
        """Return the next velocity with the objectives and limits of the user."""
        user.move(self._q)
        beside, *levels = user.levels(events)
        kept, equal = user.rows(self._v, events), user.equalities(self._v, events)
        way = objective.way
        H = objective.H + sum((cost.H for cost in beside), np.zeros_like(objective.H))
        pull = objective.H.dot(way.whole) - sum((cost.c for cost in beside), np.zeros(len(H)))
        paces = [user.pace(H, pull) if beside else 0.0]
        moved = paces[0] * pull if beside else objective.H.dot(way.paced)
        f = -objective.H.dot(objective.v_ref - way.paced) - moved
        if equal is not None and not beside:
            threshold = self.settings.singular_threshold
            f = -H.dot(user.within(equal, objective.v_ref, way, threshold))
        if kept is None and equal is None:
            v, told = self._qp.nearest(H, np.linalg.solve(H, -f), box, rows)
            events.update(() if told is None else (told,))
        else:
            v, relaxed = self._qp.nearest_within(H, f, box, Kept(rows, kept, equal))
            events.update(relaxed)
        held = [way.rows, *(cost.W for cost in beside), np.eye(len(H))[self._frozen]]
        if equal is not None:
            held.append(equal.J)
        every = [part for part in (rows, kept) if part is not None]
        A = np.vstack([np.zeros((0, self.arm.n)), *(part.A for part in every)])
        upper = np.concatenate([np.zeros(0), *(part.upper for part in every)])
        for level in levels:
            H = sum((cost.H for cost in level), np.zeros_like(H))
            c = sum((cost.c for cost in level), np.zeros(len(H)))
            N = null_space(held, self.arm.n)
            paces.append(user.pace(N @ N.T @ H @ N @ N.T, -N @ N.T @ c))
            if level and N.shape[1]:
                v = self._qp.improved(v, (H, paces[-1] * c), N, box, (A, upper))
            held += [cost.W for cost in level]
        asked = zip((beside, *levels), paces, strict=True)
        if any(cost.unmet(v, pace) for level, pace in asked for cost in level):
            events.add(Event.OBJECTIVE_RELAXED)
        return v


def _safe_stop(settings: StreamIk, arm: Arm, bounds: JointBounds) -> SafeStop | None:
    if settings.clearance is None:
        return None
    pairs = arm.derived(Clearance, settings.clearance).pairs.kept
    least = settings.clearance + _STOPS_WITHIN * settings.buffer
    return stop_type(arm.n)(arm.model, pairs, bounds, least)


def _clearance_bounds(
    settings: StreamIk, arm: Arm, data: mujoco.MjData, a_max: Vector
) -> ClearanceBounds | None:
    if settings.clearance is None:
        return None
    return bounds_type(arm.n)(
        arm.derived(Clearance, settings.clearance),
        data,
        a_max,
        settings.dt,
        d_min=settings.clearance + settings.buffer,
        braking_share=settings.braking_share,
        max_pairs=settings.max_pairs * len(arm.robot.tools) ** 2,
    )
