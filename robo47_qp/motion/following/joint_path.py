"""Joint path: curves in joint space joined without a stop."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BPoly
from scipy.optimize import brentq

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.model.arm import Arm
from robo47_qp.motion.paths.curves import BlendError, check_room
from robo47_qp.motion.trajectory import JointCurve

_LOOKS = 33


@dataclass(frozen=True, kw_only=True, eq=False)
class Stretch:
    """A curve that is run without a stop."""

    curve: JointCurve
    time: float
    """Approximate duration at full speed, which sets the share of the path parameter [s]."""
    cuts: Vector
    """Where its sections begin and end, from 0 to 1."""
    passes: Vector
    """Where waypoints before its end are passed."""


class JointPath:
    """Stretches one after the other over s in [0, 1], twice continuously differentiable.

    Where two meet, equal times of both are replaced by polynomials of degree 5 that continue
    value, slope and curvature; the tool stays within a radius of where they meet.
    """

    def __init__(self, arm: Arm, stretches: Sequence[Stretch], radii: Sequence[float]) -> None:
        """Join stretches, each of which starts where the one before it ends.

        Args:
            arm: The arm, for the place of the tool.
            stretches: At least one.
            radii: How far from each meeting the tool may be when it leaves the stretches [m].

        Raises:
            BlendError: A radius takes more of a stretch than there is.
        """
        self._stretches = tuple(stretches)
        times = np.array([one.time for one in stretches])
        zones = [_zone(arm, stretches, i, r) for i, r in enumerate(radii)]
        check_room(zones, times)
        self._starts = np.concatenate([[0.0], np.cumsum(times)])
        self.time = float(self._starts[-1])
        """Approximate duration at full speed [s]."""
        meets = self._starts[1:-1]
        self._zones = np.array(zones).reshape(-1)
        self._bends = [self._bend(i, zone) for i, zone in enumerate(zones)]
        edges = np.ravel([meets - self._zones, meets + self._zones], order="F")
        limits = np.concatenate([[0.0], edges, [self.time]])
        cuts, passes = [np.zeros(1)], []
        for i, one in enumerate(stretches):
            low, high = limits[2 * i : 2 * i + 2]
            inner = self._starts[i] + one.cuts[1:-1] * one.time
            inner = inner[(inner > low) & (inner < high)]
            cuts += [inner, np.array([high])]
            passes += [self._starts[i] + one.passes * one.time]
            if i + 1 < len(stretches):
                cuts.append(limits[2 * i + 2 : 2 * i + 3])
                passes.append(meets[i : i + 1])
        self.cuts: Vector = np.concatenate(cuts) / self.time
        """Where its sections begin and end, from 0 to 1."""
        self.passes: Vector = np.concatenate(passes) / self.time
        """Where the waypoints before the end are passed."""

    def __call__(self, x: Vector | float, nu: int = 0) -> Matrix:
        """Return the derivative of an order, at one x (n,) or many (N, n)."""
        t = np.atleast_1d(x) * self.time
        out: Matrix | None = None
        i = np.clip(np.searchsorted(self._starts, t, side="right") - 1, 0, len(self._stretches) - 1)
        for k, one in enumerate(self._stretches):
            mine = i == k
            if mine.any():
                u = np.clip((t[mine] - self._starts[k]) / one.time, 0.0, 1.0)
                out = _put(out, mine, np.asarray(one.curve(u, nu)) / one.time**nu)
        for k, bend in enumerate(self._bends):
            into = t - (self._starts[k + 1] - self._zones[k])
            mine = (into > 0.0) & (into < 2.0 * self._zones[k])
            if mine.any():
                out = _put(out, mine, np.asarray(bend(into[mine], nu)))
        scaled: Matrix = np.asarray(out) * self.time**nu
        return scaled if np.ndim(x) else scaled[0]

    def _bend(self, i: int, zone: float) -> BPoly:
        before, after = self._stretches[i : i + 2]
        ends = [
            [np.asarray(one.curve(u, order)) / one.time**order for order in range(3)]
            for one, u in ((before, 1.0 - zone / before.time), (after, zone / after.time))
        ]
        return BPoly.from_derivatives([0.0, 2.0 * zone], ends)


def _put(out: Matrix | None, mine: Vector, values: Matrix) -> Matrix:
    if out is None:
        out = np.empty((len(mine), values.shape[1]))
    out[mine] = values
    return out


def _zone(arm: Arm, stretches: Sequence[Stretch], i: int, radius: float) -> float:
    """Return the time that a bend takes of both stretches, such that the tool keeps the radius."""
    corner = arm.pose(np.asarray(stretches[i].curve(1.0))).translation()
    zones = []
    for k, end in ((i, 1.0), (i + 1, 0.0)):
        one = stretches[k]

        def beyond(u: float, one: Stretch = one, end: float = end) -> float:
            q = np.asarray(one.curve(abs(end - u)))
            return float(np.linalg.norm(arm.pose(q).translation() - corner)) - radius

        # The nearest place at which the tool is that far away.
        looks = np.linspace(0.0, 1.0, _LOOKS)
        out = [u for u in looks if beyond(u) > 0.0]
        if not out:
            raise BlendError(k, f"it ends within the blend radius of {1e3 * radius:.1f} mm")
        before = out[0] - looks[1]
        zones.append(float(brentq(beyond, before, out[0], xtol=1e-9)) * one.time)
    return min(zones)
