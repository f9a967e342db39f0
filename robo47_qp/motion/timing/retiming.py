"""Timing: how fast a joint path may be run under bounds of the joints and of the tool."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, sqrt
from typing import Annotated

import numpy as np

from robo47_qp.arrays import Checked, Count, Matrix, Range, Vector
from robo47_qp.errors import InvalidValueError, RefusalReason
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import MotionProfile
from robo47_qp.motion.paths.segments import PathProfile
from robo47_qp.motion.refusals import PathError
from robo47_qp.motion.timing.state_to_state import Transition, speed_change
from robo47_qp.motion.tool_motion import tool_rates
from robo47_qp.motion.trajectory import JointCurve, Trajectory, along

_HALVINGS = 60
_CAREFUL = 1.0 - 1e-6
"""A section that is exactly long enough may be too short by a rounding error: then the only motion
between the two speeds goes back and forth."""


class SectionedProfile:
    """A path parameter over time with speed, acceleration and jerk bounded by section.

    Between sections the acceleration is zero and the speed the largest that both allow and
    that can be reached from the ends: passes forward and backward over the sections, as in
    time-optimal control along paths (Bobrow, Dubowsky and Gibson, 1985), here with bounded
    jerk. Within a section it is time-optimal.
    """

    def __init__(self, lengths: Vector, bounds: Matrix) -> None:
        """Plan the profile.

        Args:
            lengths: Of the K sections (K,), positive.
            bounds: Speed, acceleration and jerk in each (K, 3), positive.
        """
        speeds = np.concatenate([[0.0], np.minimum(bounds[:-1, 0], bounds[1:, 0]), [0.0]])
        for k in range(len(lengths)):
            most = _reachable(speeds[k], lengths[k], *bounds[k, 1:])
            speeds[k + 1] = min(speeds[k + 1], most)
        for k in reversed(range(len(lengths))):
            most = _reachable(speeds[k + 1], lengths[k], *bounds[k, 1:])
            speeds[k] = min(speeds[k], most)
        self._starts = np.concatenate([[0.0], np.cumsum(lengths)])
        self._transitions: Sequence[Transition] = [
            speed_change(float(length), float(v0), float(v1), bound)
            for length, v0, v1, bound in zip(lengths, speeds[:-1], speeds[1:], bounds, strict=True)
        ]
        self._times = np.concatenate(
            [[0.0], np.cumsum([one.duration for one in self._transitions])]
        )

    @property
    def duration(self) -> float:
        """[s]."""
        return float(self._times[-1])

    def sampled(self, dt: float) -> Matrix:
        """Return the parameter and its first two derivatives every dt (N + 1, 3).

        Time is stretched to a whole number of periods, which violates no bound.
        """
        periods = max(1, ceil(self.duration / dt - 1e-9))
        pace = self.duration / (periods * dt)
        t = np.minimum(np.arange(periods + 1) * dt * pace, self.duration)
        section = np.clip(
            np.searchsorted(self._times, t, side="right") - 1, 0, len(self._transitions) - 1
        )
        rows = np.empty((periods + 1, 3))
        for k in np.unique(section).tolist():
            mine = section == k
            rows[mine] = self._transitions[k].along(t[mine] - self._times[k])
            rows[mine, 0] += self._starts[k]
        rows[-1] = self._starts[-1], 0.0, 0.0
        return rows * pace ** np.arange(3)


def _reachable(v: float, length: float, a_max: float, j_max: float) -> float:
    """Return the largest speed after a length from speed v, with no acceleration at both ends."""

    def way(rise: float) -> float:
        fast = rise > a_max**2 / j_max
        time = rise / a_max + a_max / j_max if fast else 2.0 * sqrt(rise / j_max)
        return (v + 0.5 * rise) * time

    low, high = 0.0, a_max
    while way(high) < length:
        high *= 2.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if way(middle) <= length else (low, middle)
    return v + low * _CAREFUL


_FINE = 48
"""Number of points per section at which the path is evaluated."""
_COARSE = 8
"""Factor of the sampling period while the paces are improved."""
_EASING = 0.6
"""Inverse of the largest factor by which a section is made faster at once."""
_TRIES = 12
_NEAR = 0.998
"""Used share of the bounds at which a motion counts as fastest."""
_MORE = 1.0 + 2e-4
"""Extra scaling, since the samples of a scaled motion lie elsewhere."""
_SPAN = 2
_NOTHING = 1e-12
_LONGEST = 600.0
"""Longest duration of a motion [s]."""


def limits(
    joints: MotionProfile, tools: Sequence[PathProfile | None], paces: Sequence[float]
) -> Matrix:
    """Return bounds on the derivatives of joints and tool in each section (3, K, n or n + 2).

    Args:
        joints: Bounds of the joints.
        tools: Those of the tool in each section; None where it moves as the joints can. Where
            it does in all, the bounds have no columns for it.
        paces: Pace in each section, in (0, 1].
    """
    rows = np.stack([joints.v_max, joints.a_max, joints.j_max])
    kinds = []
    for tool in tools:
        free = np.full((3, 2), np.inf)
        own = free if tool is None else np.stack([tool.linear, tool.angular], axis=1)
        kinds.append(np.hstack([rows, own] if any(tools) else [rows]))
    slowed = np.array(paces)[None, :, None] ** np.arange(1, 4)[:, None, None]
    return np.stack(kinds, axis=1) * slowed


@dataclass(frozen=True, kw_only=True)
class Timing(Checked):
    """Times a joint path. Its fields are settings.

    In each section of the path, speed V, acceleration A and jerk J of the path parameter are
    bounded such that for every joint and for the tool, with x(s) its place,

    |x'| V <= v_max,  |x''| V² <= η a_max,  |x'''| V³ <= η j_max,
    |x'| A + |x''| V² <= a_max,  |x'| J + 3 |x''| V A + |x'''| V³ <= j_max,

    which bounds the derivatives of x(s(t)) by the chain rule. These sums are more careful than
    they need to be: the pace of each section is raised and lowered in some rounds by how much
    of the bounds its samples use, several η are tried, and time is scaled for the whole path
    until one bound is just reached and none exceeded. The quickest motion is taken.
    """

    shares: Annotated[tuple[float, ...], Range(above=0.0, at_most=1.0)] = (0.2, 0.35, 0.55, 0.75)
    """Values of η to try: share of the bounds that the curvature of the path may take."""
    rounds: Count = 3
    """Number of rounds that improve the paces of the sections, per η."""

    def __post_init__(self) -> None:
        """Check the settings.

        Raises:
            InvalidValueError: One is out of range, or there is no η.
        """
        super().__post_init__()
        if not len(self.shares):
            raise InvalidValueError("shares", self.shares, "one number at least")

    def timed(
        self, arm: Arm, path: JointCurve, cuts: Vector, bounds: Matrix, dt: float
    ) -> Trajectory:
        """Return the motion from rest at s = 0 to rest at s = 1.

        Args:
            arm: The arm.
            path: Its path.
            cuts: Ends of the K sections (K + 1,), from 0 to 1.
            bounds: On joints and tool in each section; see `limits`.
            dt: Time between samples [s].

        Raises:
            PathError: A bound leaves next to no motion.
        """
        best, quickest = (cuts, bounds, np.empty((0, 3))), np.inf
        whole = (cuts[[0, -1]], bounds.min(axis=1, keepdims=True))
        for ends, limit in ((cuts, bounds), whole):
            bend, lengths = _bends(arm, path, ends, limit), np.diff(ends)
            for share in self.shares:
                caps = _caps(bend, limit, share)
                for _ in range(self.rounds if len(lengths) > 1 else 1):
                    rows = SectionedProfile(lengths, caps).sampled(_COARSE * dt)
                    coarse = along(path, rows, _COARSE * dt)
                    excess = _excess(arm, coarse, rows[:, 0], ends, limit)
                    scaled = caps / excess.max() ** np.arange(1, 4)
                    duration = SectionedProfile(lengths, scaled).duration
                    if duration < quickest:
                        best, quickest = (ends, limit, scaled), duration
                    caps = caps / np.maximum(excess, _EASING)[:, None] ** np.arange(1, 4)
        return _fitted(arm, path, *best, dt)


def _fitted(
    arm: Arm, path: JointCurve, cuts: Vector, bounds: Matrix, caps: Matrix, dt: float
) -> Trajectory:
    """Scale time until a bound is just reached and none is exceeded."""
    best: Trajectory | None = None
    for _ in range(_TRIES):
        rows = SectionedProfile(np.diff(cuts), caps).sampled(dt)
        motion = along(path, rows, dt)
        excess = float(_excess(arm, motion, rows[:, 0], cuts, bounds).max())
        if excess <= 1.0:
            # Durations are whole periods: a short motion may not come closer to its bounds.
            if best is not None and motion.steps >= best.steps:
                break
            best = motion
            if excess >= _NEAR:
                break
        caps = caps / (excess * _MORE) ** np.arange(1, 4)
    if best is None or best.steps * dt > _LONGEST:
        raise PathError(0.0, "the bounds leave next to no motion", RefusalReason.PACE)
    return best


def _excess(arm: Arm, motion: Trajectory, s: Vector, cuts: Vector, bounds: Matrix) -> Vector:
    """Return factors by which to stretch time in each section (K,); below 1 it may shrink."""
    section = np.clip(np.searchsorted(cuts, s, side="right") - 1, 0, len(cuts) - 2)
    # Differences span several samples: they are as quick as the quickest of them allows.
    limit = _largest_around(bounds[:, section])
    kinds = [(motion.v, motion.a, motion.jerk)]
    if bounds.shape[2] > arm.n:
        kinds.append(tool_rates(arm, motion.q, motion.dt))
    first, worst = 0, np.full(len(cuts) - 1, _NOTHING)
    for kind in kinds:
        columns = slice(first, first + kind[0].shape[1])
        for order, rate in enumerate(kind, start=1):
            at = np.linspace(0, len(section) - 1, len(rate)).round().astype(int)
            use = np.abs(rate) / limit[order - 1, at, columns]
            np.maximum.at(worst, section[at], use.max(axis=1) ** (1.0 / order))
        first = columns.stop
    return worst


def _bends(arm: Arm, path: JointCurve, cuts: Vector, bounds: Matrix) -> Matrix:
    """Return the largest derivatives by s of joints and tool per section (3, K, n or n + 2)."""
    sections = []
    for low, high in pairwise(cuts):
        s = np.linspace(low, high, _FINE + 1)
        orders = [np.abs(path(s, order)).max(axis=0) for order in (1, 2, 3)]
        if bounds.shape[2] > arm.n:
            # The section's ends are no rest: what is seen before and after them is left out.
            rates = tool_rates(arm, path(s), float(s[1] - s[0]))
            inner = (rates.v, rates.a[2:-2], rates.j[3:-3])
            orders = [
                np.concatenate([joints, tool.max(axis=0)])
                for joints, tool in zip(orders, inner, strict=True)
            ]
        sections.append(orders)
    return np.array(sections).transpose(1, 0, 2)


def _caps(bend: Matrix, bounds: Matrix, share: float) -> Matrix:
    """Return bounds on the first three derivatives of the parameter per section (K, 3)."""
    d1, d2, d3 = np.maximum(bend, _NOTHING)
    v, a, j = bounds
    fastest = np.minimum(v / d1, (share * a / d2) ** (1 / 2))
    V = np.minimum(fastest, (share * j / d3) ** (1 / 3)).min(axis=1)[:, None]
    A = ((a - d2 * V**2) / d1).min(axis=1)[:, None]
    A = np.minimum(A, ((1.0 - share) * j / (6.0 * d2 * V)).min(axis=1)[:, None])
    J = ((j - d3 * V**3 - 3.0 * d2 * V * A) / d1).min(axis=1)[:, None]
    return np.hstack([V, A, J])


def _largest_around(rows: Matrix) -> Matrix:
    """Return the largest of each row (3, N, n) and those within `_SPAN` of it, to either side."""
    padded = np.pad(rows, ((0, 0), (_SPAN, _SPAN), (0, 0)), mode="edge")
    largest: Matrix = np.maximum.reduce(
        [padded[:, k : k + rows.shape[1]] for k in range(2 * _SPAN + 1)]
    )
    return largest
