"""Tracking: the joint path along a tool path, in the IK branch in which it starts."""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from robo47_qp.arrays import Checked, CountOrZero, Matrix, NotNegative, Positive, Vector
from robo47_qp.errors import RefusalReason
from robo47_qp.ik.composing import deviation, exact_rows, without_lasting
from robo47_qp.ik.solver import IkResult, IkSolver
from robo47_qp.model.arm import Arm
from robo47_qp.model.tool_poses import Target
from robo47_qp.motion.following.small_steps import (
    block_reason,
    deviation_reason,
    follow_in_small_steps,
    single_start,
)
from robo47_qp.motion.paths.segments import ToolPath
from robo47_qp.motion.refusals import AT_LIMIT, PathError, check_spline_limits

_TASK = 6
"""Degrees of freedom of a pose; an arm with more joints is redundant."""
_STEEPEST = 1.875
"""Slope of a quintic transition in its middle, over its mean."""
_POLISHES = 2
"""Number of Newton steps after IK."""


class IkEffort(NamedTuple):
    """Effort of IK on a path."""

    iterations: int
    seconds: float


@dataclass(frozen=True, kw_only=True)
class Tracking(Checked):
    """Follows tool paths. Its fields are settings.

    IK solves the path at knots, each started from the one before; a spline of degree 5
    joins them, so that the jerk is bounded; the knots are doubled until the spline keeps to
    the path. Where a joint of a redundant arm runs into its limit, the path is followed
    again with the joints led away from their limits as far as the tool allows.
    """

    deviation: Positive = 5e-6
    """Largest deviation of the tool from the path [m] and [rad]."""
    knot_spacing: Positive = 0.01
    """First spacing of the knots [m] and [rad]."""
    doublings: CountOrZero = 4
    """Largest number of times that the knots are doubled."""
    jump: Positive = 0.3
    """Change of a joint between knots that counts as a change of IK branch [rad]."""
    retreat: NotNegative = 3.0
    """Rate at which a redundant arm moves away from joint limits where it would reach one
    [rad per m or rad of the path]; 0 refuses the path there."""
    polish: bool = False
    """Bring the knots to the path as closely as rounding allows. Needed where they are dense:
    what IK leaves shows in the jerk."""

    def joint_path(
        self, arm: Arm, ik: IkSolver, q_start: Vector, path: ToolPath
    ) -> tuple[BSpline, IkEffort]:
        """Return the joint path over s in [0, 1] that keeps to a tool path.

        Raises:
            PathError: IK fails on the path or changes branch, the path leaves the joint
                limits, or no number of knots keeps it on the tool path.
        """
        try:
            return self._path(arm, ik, q_start, path, False)
        except PathError as error:
            at_limit = error.reason is RefusalReason.JOINT_LIMIT or (
                error.q is not None and arm.limit_margin(error.q) < AT_LIMIT
            )
            if arm.n <= _TASK - ik.tolerance.demand.free or not at_limit or self.retreat == 0.0:
                raise
        return self._path(arm, ik, q_start, path, True)

    def _path(
        self, arm: Arm, ik: IkSolver, q_start: Vector, path: ToolPath, away: bool
    ) -> tuple[BSpline, IkEffort]:
        knots = max(8, int(np.ceil(max(path.length, path.angle) / self.knot_spacing)))
        iterations, seconds, doublings = 0, 0.0, 0
        while True:
            q, results = self._solved(arm, ik, q_start, path, knots, away)
            iterations += sum(result.iterations for result in results)
            seconds += sum(result.seconds for result in results)
            spline = make_interp_spline(np.linspace(0.0, 1.0, knots + 1), q, k=5)
            off, fraction = _worst_deviation(arm, ik, path, spline, knots)
            if off <= self.deviation:
                check_spline_limits(arm, spline)
                return spline, IkEffort(iterations, seconds)
            if doublings == self.doublings:
                reason = f"{knots} knots leave the tool {1e6 * off:.0f} µm off"
                where = spline(fraction), path.at(fraction)
                why = deviation_reason(arm, q, *where, ik.tolerance.demand)
                raise PathError(fraction, reason, *why)
            knots, doublings = 2 * knots, doublings + 1

    def _solved(
        self, arm: Arm, ik: IkSolver, q_start: Vector, path: ToolPath, knots: int, away: bool
    ) -> tuple[Matrix, list[IkResult]]:
        """Return the configurations at the knots (knots + 1, n), and all IK results."""
        s = np.linspace(0.0, 1.0, knots + 1)
        q, results = [q_start], list[IkResult]()
        spacing = max(path.length, path.angle) / knots
        near = single_start(ik)
        plain = without_lasting(near)
        lasting = None
        if plain is not None:
            lasting, near = _Lasting(arm, near, path, q_start, self), plain
        for before, fraction in pairwise(s.tolist()):
            seed, target = q[-1], path.at(fraction)
            if away:
                seed = np.clip(
                    seed + spacing * self.retreat * _away(arm, near, seed, target),
                    arm.q_min,
                    arm.q_max,
                )
            if lasting is not None:
                seed = lasting.seed(target, fraction, q[-1], results)
            result = near.solve(arm, target, seed)
            results.append(result)
            found, moved = result.q, float(np.abs(result.q - q[-1]).max())
            if not result.converged or moved > self.jump:
                found = self._by_small_steps(arm, near, q[-1], path, (before, fraction), results)
            q.append(_polished(arm, near, target, found) if self.polish else found)
        return np.array(q), results

    def _by_small_steps(
        self,
        arm: Arm,
        ik: IkSolver,
        q: Vector,
        path: ToolPath,
        ends: tuple[float, float],
        results: list[IkResult],
    ) -> Vector:
        """Return the configuration at the second end, by small steps from q at the first.

        Raises:
            PathError: No continuous joint motion leads there; the reason is named.
        """
        low, high = ends
        steps = follow_in_small_steps(arm, ik, q, lambda x: path.at(low + x * (high - low)))
        results += steps.results
        if steps.stuck is None:
            return steps.q
        last = steps.results[-1]
        refusal, joint = block_reason(arm, steps.q, steps.stuck, ik.tolerance)
        moved = np.abs(last.q - steps.q)
        how = f"{arm.robot.joints[int(moved.argmax())]} would jump by {moved.max():.2f} rad"
        reason = how if last.converged else last.explanation
        at = low + steps.at * (high - low)
        told = f"{reason} ({refusal.value}, {joint})"
        raise PathError(at, told, refusal, joint, steps.q, steps.stuck)


class _Lasting:
    """Where objectives that last are at their best along a path, and the way there.

    A path seldom starts at the best configuration: from the start the joints go over to it, by
    an offset that fades out towards the end of the path, with two continuous derivatives. On a
    path that is too short for that, a part of it stays.
    """

    def __init__(
        self, arm: Arm, ik: IkSolver, path: ToolPath, q_start: Vector, settings: Tracking
    ) -> None:
        self._arm, self._ik, self._settings = arm, ik, settings
        self._size = max(path.length, path.angle)
        self._best = ik.solve(arm, path.at(0.0), q_start).q
        self._go_over(q_start - self._best, 0.0)

    def _go_over(self, offset: Vector, since: float) -> None:
        """Let an offset fade out from a fraction of the path on, as far as there is path for it."""
        self._offset, self._since = offset, since
        longest = self._settings.retreat * (1.0 - since) * self._size / _STEEPEST
        size = float(np.abs(offset).max())
        self._share = 1.0 if size <= longest else longest / size

    def seed(self, target: Target, at: float, q_before: Vector, results: list[IkResult]) -> Vector:
        """Return where to search for a pose at a fraction of the path (n,) [rad]."""
        found = self._ik.solve(self._arm, target, self._best)
        results.append(found)
        if np.abs(found.q - self._best).max() > self._settings.jump:
            # The best is suddenly elsewhere: go over to it on the rest of the path.
            self._go_over(q_before - found.q, min(at, 1.0 - 1e-6))
        self._best = found.q
        x = (at - self._since) / (1.0 - self._since)
        fading = 1.0 - self._share * x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
        arm = self._arm
        return np.clip(self._best + fading * self._offset, arm.q_min, arm.q_max)


def _worst_deviation(
    arm: Arm, ik: IkSolver, path: ToolPath, spline: BSpline, knots: int
) -> tuple[float, float]:
    """Return the largest pose error between the knots [m or rad], and where it is."""
    s = (np.arange(2 * knots) + 0.5) / (2 * knots)
    off = [deviation(ik, arm, path.at(x), q) for x, q in zip(s, spline(s), strict=True)]
    worst = int(np.argmax(off))
    return off[worst], float(s[worst])


def _polished(arm: Arm, ik: IkSolver, target: Target, q: Vector) -> Vector:
    """Return q after Newton steps of least motion: q + J⁺ e."""
    for _ in range(_POLISHES):
        e, J = exact_rows(ik, arm, target, q)
        q = q + np.linalg.lstsq(J, e, rcond=1e-4)[0]
    return q


def _away(arm: Arm, ik: IkSolver, q: Vector, target: Target) -> Vector:
    """Return null-space motion away from joint limits: N(q) times -x³ per joint, x in [-1, 1].

    The gradient projection of Liégeois (1977) with the fourth power of the distance from the
    middle of each range.
    """
    half = 0.5 * (arm.q_high - arm.q_low)
    x = np.where(arm.free, 0.0, (q - 0.5 * (arm.q_low + arm.q_high)) / half)
    _, J = exact_rows(ik, arm, target, q)
    # Joints that move no tool of the path stand still.
    wish = -(x**3) * arm.joints_of(target)
    way: Vector = wish - np.linalg.lstsq(J, J @ wish, rcond=1e-4)[0]
    return way
