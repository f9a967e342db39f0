"""Shortcut: motions from rest to rest with their corners cut in the least time."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm
from robo47_qp.model.robot import MotionProfile
from robo47_qp.motion.paths.blended import BlendError
from robo47_qp.motion.timing.state_to_state import to_state
from robo47_qp.motion.tool_motion import tool_places
from robo47_qp.motion.trajectory import Trajectory

_SHARES = np.linspace(1.0, 0.1, 10)
"""Parts of the way inside the radius that are tried as the way of a cut, the longest first."""
_ROUNDING = 1.0 + 1e-9


class Corner(NamedTuple):
    """What holds where one motion gives way to the next."""

    radius: float
    """How far from the waypoint the tool may be on the cut [m]."""
    bounds: MotionProfile
    """Of the joints on it; a jerk may be infinite."""


class _Cut(NamedTuple):
    left: int
    """Periods of the first motion that are left out at its end."""
    zone: Trajectory
    skipped: int
    """Periods of the second motion that are left out at its start."""


def cut_corners(
    arm: Arm, motions: Sequence[Trajectory], corners: Sequence[Corner]
) -> tuple[Trajectory, list[int]]:
    """One motion from several, and the samples at which the waypoints between them are passed.

    Where the tool is within its radius of a corner, the joints leave the first motion and go
    in the least time to a state of the second, velocity and acceleration continued (Ruckig).
    A cut that saves no time is not made: then the arm stops at the corner, so that the motion
    never takes longer than with stops.

    Args:
        arm: The arm.
        motions: Each from rest where the one before it ends, to rest.
        corners: One less than motions.

    Raises:
        BlendError: The tool does not leave a radius on the way to the next waypoint.
    """
    _check_room(arm, motions, corners)
    whole, passes, used = motions[0], list[int](), 0
    for i, (motion, corner) in enumerate(zip(motions[1:], corners, strict=True)):
        cut = _cut(arm, (whole, motion), motions[i].steps - used, corner)
        start = whole.steps - cut.left
        zone = np.abs(cut.zone.q - motion.q[0]).max(axis=1)
        passes.append(start + int(zone.argmin()))
        whole, used = _joined(whole, cut, motion), cut.skipped
    return whole, passes


def _check_room(arm: Arm, motions: Sequence[Trajectory], corners: Sequence[Corner]) -> None:
    for i, corner in enumerate(corners):
        place = arm.pose(motions[i].q[-1]).translation()
        for k, row in ((i, 0), (i + 1, -1)):
            far = np.linalg.norm(arm.pose(motions[k].q[row]).translation() - place)
            if far <= corner.radius:
                reason = f"it ends within the blend radius of {1e3 * corner.radius:.1f} mm"
                raise BlendError(k, reason)


def _cut(arm: Arm, pair: tuple[Trajectory, Trajectory], free: int, corner: Corner) -> _Cut:
    """The best of those tried; `free` periods at the end of the first motion may be cut."""
    before, after = pair
    place = arm.pose(after.q[0]).translation()
    back = _within(arm, before.q[::-1][: free + 1], place, corner.radius)
    # Half of the next motion is left to the next corner.
    ahead = _within(arm, after.q[: after.steps // 2 + 1], place, corner.radius)
    best = _Cut(0, after.part(0, 0), 0)
    saved = 0
    for share in _SHARES:
        left, skipped = round(share * back), round(share * ahead)
        if left + skipped <= saved:
            break
        try:
            zone = _leapt(before, before.steps - left, after, skipped, corner.bounds)
        except InvalidValueError:
            # Ruckig finds nothing between some states that use their bounds to the last digit.
            continue
        gain = left + skipped - zone.steps
        if gain > saved and _fits(arm, zone, corner, place):
            best, saved = _Cut(left, zone, skipped), gain
    return best


def _leapt(
    before: Trajectory, leave: int, after: Trajectory, enter: int, bounds: MotionProfile
) -> Trajectory:
    """In whole periods from a sample of one motion to a sample of another."""
    ends = [
        np.stack([one.q[k], one.v[k], one.a[k]]) for one, k in ((before, leave), (after, enter))
    ]
    dt = before.dt
    leap = to_state(ends[0], ends[1], bounds.v_max, bounds.a_max, bounds.j_max, dt)
    steps = max(1, round(leap.duration / dt))
    states = np.array([leap.at(k * dt) for k in range(steps + 1)]).reshape(steps + 1, 3, -1)
    states[0], states[-1] = ends
    q, v, a = states.transpose(1, 0, 2).copy()
    return Trajectory(dt=dt, q=q, v=v, a=a)


def _fits(arm: Arm, zone: Trajectory, corner: Corner, place: Vector) -> bool:
    within = _within(arm, zone.q, place, corner.radius) == zone.steps
    return within and _bounded(arm, zone, corner.bounds)


def _joined(before: Trajectory, cut: _Cut, after: Trajectory) -> Trajectory:
    end = before.steps - cut.left

    def joined(name: str) -> Matrix:
        parts = (getattr(before, name)[:end], getattr(cut.zone, name))
        return np.vstack([*parts, getattr(after, name)[cut.skipped + 1 :]])

    return Trajectory(dt=before.dt, q=joined("q"), v=joined("v"), a=joined("a"))


def _bounded(arm: Arm, zone: Trajectory, bounds: MotionProfile) -> bool:
    return bool(
        (np.abs(zone.v) <= bounds.v_max * _ROUNDING).all()
        and (np.abs(zone.a) <= bounds.a_max * _ROUNDING).all()
        and (np.abs(zone.jerk) <= bounds.j_max * _ROUNDING).all()
        and (zone.q >= arm.q_min).all()
        and (zone.q <= arm.q_max).all()
    )


def _within(arm: Arm, q: Matrix, place: Vector, radius: float) -> int:
    """After how many periods the tool is for the last time within a radius, from the first on."""
    away = np.linalg.norm(tool_places(arm, q)[0] - place, axis=1)
    out = away > radius
    return int(out.argmax()) - 1 if out.any() else len(q) - 1
