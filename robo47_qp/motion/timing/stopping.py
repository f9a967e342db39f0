"""Stopping: from a reference in motion to rest as fast as the joints can."""

from collections.abc import Sequence

import numpy as np

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import InvalidValueError, PlanError, RefusalReason, Rejection
from robo47_qp.model.arm import Arm, JointReference
from robo47_qp.model.robot import MotionProfile
from robo47_qp.motion.timing.state_to_state import Transition, to_rest, to_state
from robo47_qp.motion.trajectory import Trajectory

_STRAIGHT = 1e-9
"""Share of the acceleration across the velocity that counts as a rounding error."""
_ROUNDING = 1e-9
_NEGLIGIBLE = 1e-10
"""Share of the jerk bound that is ignored."""
_HALVINGS = 30


class _LineStop:
    """A stop along a straight line of the joint space."""

    def __init__(self, q: Vector, way: Vector, along: Transition) -> None:
        self._q, self._way, self._along = q, way, along
        self.duration = along.duration
        ends = q + along.reach * way
        self.reach: Matrix = np.sort(ends, axis=0)

    def at(self, time: float) -> Matrix:
        s, ds, dds = self._along.at(time)
        return np.stack([self._q + s * self._way, ds * self._way, dds * self._way])


class _JointStops:
    """A stop of each joint by itself."""

    def __init__(self, joints: Sequence[Transition]) -> None:
        self._transitions = joints
        self.duration = max(transition.duration for transition in joints)
        self.reach: Matrix = np.hstack([transition.reach for transition in joints])

    def at(self, time: float) -> Matrix:
        return np.stack([one.at(min(time, one.duration)) for one in self._transitions], axis=1)


_Stop = Transition | _LineStop | _JointStops


def stop(arm: Arm, now: JointReference, profile: MotionProfile, dt: float) -> Trajectory:
    """Stop from a reference in motion, with bounded acceleration and jerk.

    The first sample is the reference itself. Three ways are tried, and the first that stays
    inside the joint limits is taken:

    - straight on, where the acceleration lies along the velocity (on any PTP motion): the
      fastest stop on that line. Where it does not, all joints as fast as the slowest of them
      needs, ending together;
    - each joint on its own, as fast as it can;
    - the same, but joints that would still leave their limits brake beyond that and come back.

    Args:
        arm: The arm.
        now: What the joints are doing. Where a joint is outside its limits already, the stop
            leads it no further out.
        profile: Bounds of the joints; a reference that exceeds them is brought back first.
        dt: Time between samples [s].

    Raises:
        InvalidValueError: A number is not finite, dt is not positive, or the profile is of other
            joints.
        PlanError: No stop within the bounds keeps a joint inside its limits; the joint and
            the time at which it leaves them are named.
    """
    if not (np.isfinite(dt) and dt > 0.0):
        raise InvalidValueError("dt", dt, "positive and finite [s]")
    profile.check_joints(arm.n)
    names = ("position", "velocity", "acceleration")
    checked = (arm.checked_q(f"{n} of the reference", x) for n, x in zip(names, now, strict=True))
    start = np.stack(list(checked))
    low = np.minimum(arm.q_min, start[0]) - _ROUNDING
    high = np.maximum(arm.q_max, start[0]) + _ROUNDING
    together = _together(start, profile, dt)
    if _inside(together, low, high):
        return _sampled(together, start, dt)
    apart = _JointStops([_alone(start, i, profile, low[i], high[i]) for i in range(arm.n)])
    if not _inside(apart, low, high):
        raise _refused(arm, _sampled(apart, start, dt), low, high)
    return _sampled(apart, start, dt)


def _together(start: Matrix, profile: MotionProfile, dt: float) -> Transition | _LineStop:
    q, v, a = start
    way = v if v.any() else a
    size = float(np.abs(way).max())
    if size == 0.0:
        return to_rest(start, profile.a_max, profile.j_max)
    way = way / size
    along = float(a @ way / (way @ way))
    beside = np.abs(a - along * way)
    if beside.max() > _STRAIGHT * max(1.0, float(np.abs(a).max())):
        return to_rest(start, profile.a_max, profile.j_max)
    moving = np.abs(way) > _ROUNDING
    # The acceleration across vanishes within the first sample, which takes some of the jerk.
    taken = beside / dt
    j_max = profile.j_max - np.where(taken > _NEGLIGIBLE * profile.j_max, taken, 0.0)
    bounds = [(b[moving] / np.abs(way[moving])).min() for b in (profile.a_max, j_max)]
    state = np.array([[0.0], [size if v.any() else 0.0], [along]])
    return _LineStop(q, way, to_rest(state, bounds[0][None], bounds[1][None]))


def _alone(start: Matrix, i: int, profile: MotionProfile, low: float, high: float) -> Transition:
    """Return the fastest stop of a joint; where that leaves its limits, one that comes back."""
    state = start[:, i : i + 1]
    v_max, a_max, j_max = (b[i : i + 1] for b in (profile.v_max, profile.a_max, profile.j_max))
    fast = to_rest(state, a_max, j_max)
    over, under = fast.reach[1, 0] > high, fast.reach[0, 0] < low
    if not (over or under):
        return fast
    # The further back the goal, the harder it brakes: no further than the limit requires.
    near, far = (high, low) if over else (low, high)

    def back_to(goal: float) -> Transition:
        return to_state(state, np.array([[goal], [0.0], [0.0]]), v_max, a_max, j_max)

    best = back_to(far)
    for _ in range(_HALVINGS if _inside(best, low, high) else 0):
        middle = 0.5 * (near + far)
        back = back_to(middle)
        if _inside(back, low, high):
            best, far = back, middle
        else:
            near = middle
    return best


def _inside(motion: _Stop, low: Vector | float, high: Vector | float) -> bool:
    return bool((motion.reach[0] >= low).all() and (motion.reach[1] <= high).all())


def _sampled(transition: _Stop, start: Matrix, dt: float) -> Trajectory:
    """Return the samples; the last is at the first whole period after the stop."""
    steps = int(np.ceil(transition.duration / dt - _ROUNDING))
    states = np.empty((steps + 1, 3, start.shape[1]))
    for k, state in enumerate(states):
        state[:] = np.reshape(transition.at(min(k * dt, transition.duration)), state.shape)
    states[0] = start
    states[-1, 1:] = 0.0
    q, v, a = states.transpose(1, 0, 2).copy()
    return Trajectory(dt=dt, q=q, v=v, a=a)


def _refused(arm: Arm, motion: Trajectory, low: Vector, high: Vector) -> PlanError:
    excess = np.maximum(motion.q - high, low - motion.q)
    late = excess.max(axis=1) > 0.0
    # A joint that is outside only between two samples is reported at the nearest.
    k = int(late.argmax()) if late.any() else int(excess.max(axis=1).argmax())
    joint, time = arm.robot.joints[int(excess[k].argmax())], k * motion.dt
    rejection = Rejection(
        reason=RefusalReason.JOINT_LIMIT,
        fraction=k / max(1, motion.steps),
        time=time,
        joint=joint,
        q=tuple(motion.q[k].tolist()),
    )
    reason = f"{joint} leaves its limits after {time:.3f} s however hard it brakes"
    return PlanError("stop", reason, rejection)
