"""Time-optimal motion between states with bounded jerk, by Ruckig.

Berscheid and Kröger, "Jerk-limited real-time trajectory generation with arbitrary target
states", RSS 2021. Everything is computed here: Ruckig's waypoint planner, which calls a remote
service, is not used.
"""

from math import sqrt

import numpy as np
import ruckig

from robo47_qp.arrays import Matrix, Vector
from robo47_qp.errors import InvalidValueError

_NOTHING = 1e-9
"""Longest duration of a phase that is ignored [s]."""
_HAIR = 1e-9
"""Part by which a bound is raised where Ruckig fails for the last digit of a speed at it."""


class Transition:
    """A motion of one or several coordinates from one state to another."""

    def __init__(self, plan: ruckig.Trajectory) -> None:
        """Wrap a trajectory of Ruckig."""
        self._plan = plan
        self.duration = float(plan.duration)
        """[s]"""

    def at(self, time: float) -> Matrix:
        """Return position, velocity and acceleration at a time (3, n); (3,) for one coordinate."""
        state = np.array(self._plan.at_time(time))
        return state[:, 0] if state.shape[1] == 1 else state

    def along(self, times: Vector) -> Matrix:
        """Return position, velocity and acceleration of the one coordinate at times (N, 3)."""
        profile = self._plan.profiles[0][0]
        phases = np.array([*profile.brake.t, *profile.t, *profile.accel.t])
        starts = np.concatenate([[0.0], np.cumsum(phases)[:-1]])[phases > 0.0]
        states = np.array([self._plan.at_time(float(t)) for t in starts])[:, :, 0]
        ends = np.append(starts[1:], self.duration)
        last = self._plan.at_time(self.duration)[2][0]
        jerks = np.diff(np.append(states[:, 2], last)) / (ends - starts)
        k = np.clip(np.searchsorted(starts, times, side="right") - 1, 0, len(starts) - 1)
        (x, v, a), j, t = states[k].T, jerks[k], np.minimum(times, self.duration) - starts[k]
        rows = (x + t * (v + t * (a / 2 + t * j / 6)), v + t * (a + t * j / 2), a + t * j)
        return np.column_stack(rows)

    def from_rest(self, times: Vector) -> Matrix:
        """Return what `at` does for the one coordinate, from rest, at times (N, 3), to the bit."""
        profile = self._plan.profiles[0][0]
        ends = np.cumsum(profile.t)
        k = np.minimum(np.searchsorted(ends, times, side="right"), len(ends) - 1)
        x, v, a, j = (
            np.array(values)[k] for values in (profile.p, profile.v, profile.a, profile.j)
        )
        t = times - np.append(0.0, ends)[k]
        rows = (x + t * (v + t * (a / 2 + t * j / 6)), v + t * (a + t * j / 2), a + t * j)
        return np.column_stack(rows)

    @property
    def reach(self) -> Matrix:
        """Least and largest position of each coordinate, between samples too (2, n).

        Where the speed is zero in phases of constant jerk; Ruckig's own extrema are not to be
        trusted (0.19.4: those of motions by speed are left at zero).
        """
        ends = []
        for i, profile in enumerate(self._plan.profiles[0]):
            phases = [*profile.brake.t, *profile.t, *profile.accel.t]
            places, time = [self._plan.at_time(0.0)[0][i]], 0.0
            for phase in phases:
                places += self._turns(i, time, phase)
                time += phase
                # Where it reverses between two phases, neither has it within.
                places.append(self._plan.at_time(min(time, self.duration))[0][i])
            places.append(self._plan.at_time(self.duration)[0][i])
            ends.append((min(places), max(places)))
        return np.array(ends).T

    def _turns(self, i: int, start: float, phase: float) -> list[float]:
        """Return the positions at which a coordinate reverses within a phase."""
        if phase <= _NOTHING:
            return []
        v, a = (self._plan.at_time(start)[order][i] for order in (1, 2))
        j = (self._plan.at_time(min(start + phase, self.duration))[2][i] - a) / phase
        root = a * a - 2.0 * j * v
        if root < 0.0:
            return []
        # v + a t + j t² / 2 = 0, solved for 1 / t, which allows a jerk of zero; from a speed of
        # zero, t = 0 is one solution.
        slopes = (-a - sqrt(root), -a + sqrt(root))
        times = [2.0 * v / slope for slope in slopes if slope] if v else [-2.0 * a / j] if j else []
        return [self._plan.at_time(start + t)[0][i] for t in times if 0.0 < t < phase]


def speed_change(length: float, v_start: float, v_goal: float, bounds: Vector) -> Transition:
    """Plan one coordinate from 0 to a length, time-optimal, with no acceleration at both ends.

    Args:
        length: Positive.
        v_start: Speed at the start, at least 0.
        v_goal: Speed at the end, at least 0; to be reached within the length.
        bounds: On speed, acceleration and jerk (3,), positive.

    Raises:
        InvalidValueError: Ruckig finds no such motion.
    """
    start, goal = np.zeros(3)[:, None], np.array([length, v_goal, 0.0])[:, None]
    start[1] = v_start
    # Speeds at the bound itself must not fail for their last digit.
    cap = np.array([max(float(bounds[0]), v_start, v_goal)])
    try:
        return to_state(start, goal, cap, bounds[1:2], bounds[2:3])
    except InvalidValueError:
        return to_state(start, goal, cap * (1.0 + _HAIR), bounds[1:2], bounds[2:3])


def to_state(
    start: Matrix,
    goal: Matrix,
    v_max: Vector,
    a_max: Vector,
    j_max: Vector,
    period: float | None = None,
) -> Transition:
    """Plan the time-optimal motion from one state to another; all coordinates end together.

    Args:
        start: Position, velocity and acceleration now (3, n).
        goal: The same at the end (3, n).
        v_max: Bounds on the velocity (n,), positive; exceeded only while the start does.
        a_max: Bounds on the acceleration (n,), positive.
        j_max: Bounds on the jerk (n,), positive.
        period: The duration is the shortest that is a multiple of this [s]; None leaves it.

    Raises:
        InvalidValueError: A number is not finite, a bound not positive, or there is no motion.
    """
    n = len(v_max)
    step = 1.0 if period is None else period
    check_motion(np.ravel(start), np.ravel(goal), v_max, a_max, j_max, step)
    request, plan = ruckig.InputParameter(n), ruckig.Trajectory(n)
    now, then = start.tolist(), goal.tolist()
    request.current_position, request.current_velocity, request.current_acceleration = now
    request.target_position, request.target_velocity, request.target_acceleration = then
    request.max_velocity, request.max_acceleration = v_max.tolist(), a_max.tolist()
    request.max_jerk = j_max.tolist()
    if period is not None:
        request.duration_discretization = ruckig.DurationDiscretization.Discrete
    try:
        ruckig.Ruckig(n, step).calculate(request, plan)
    except ruckig.RuckigError as error:
        expected = "one that Ruckig can plan"
        raise InvalidValueError("motion", f"{now} to {then} ({error})", expected) from error
    return Transition(plan)


def to_rest(start: Matrix, a_max: Vector, j_max: Vector) -> Transition:
    """Plan the time-optimal motion from a state to rest at any position, ending together.

    Args:
        start: Position, velocity and acceleration now (3, n).
        a_max: Bounds on the acceleration (n,), positive; exceeded only while the start does.
        j_max: Bounds on the jerk (n,), positive.

    Raises:
        InvalidValueError: A number is not finite, a bound not positive, or there is no motion.
    """
    n = len(a_max)
    check_motion(np.ravel(start), np.zeros(1), np.ones(1), a_max, j_max, 1.0)
    request, plan = ruckig.InputParameter(n), ruckig.Trajectory(n)
    request.control_interface = ruckig.ControlInterface.Velocity
    now = start.tolist()
    request.current_position, request.current_velocity, request.current_acceleration = now
    request.target_velocity = request.target_acceleration = [0.0] * n
    request.max_acceleration, request.max_jerk = a_max.tolist(), j_max.tolist()
    try:
        ruckig.Ruckig(n).calculate(request, plan)
    except ruckig.RuckigError as error:
        expected = "one that Ruckig can stop"
        raise InvalidValueError("motion", f"{now} ({error})", expected) from error
    return Transition(plan)


def s_curve(length: float, bounds: Vector, dt: float) -> Matrix:
    """Move one coordinate from 0 to a length.

    Args:
        length: Positive.
        bounds: On velocity, acceleration and jerk (3,), positive.
        dt: Time between samples [s].

    Returns:
        Position, velocity and acceleration at 0, dt, 2 dt, ... (N + 1, 3); the duration is the
        shortest that is a multiple of dt, the last sample is the goal, at rest.

    Raises:
        InvalidValueError: A number is not finite, a bound or dt is not positive, or Ruckig
            finds no motion.
    """
    goal = np.array([[length], [0.0], [0.0]])
    v_max, a_max, j_max = bounds[:, None]
    motion = to_state(np.zeros((3, 1)), goal, v_max, a_max, j_max, dt)
    steps = round(motion.duration / dt)
    return np.vstack([motion.from_rest(dt * np.arange(steps, dtype=np.float64)), goal.T])


def check_motion(
    start: Vector, goal: Vector, v_max: Vector, a_max: Vector, j_max: Vector, dt: float
) -> None:
    """Check the numbers of a motion.

    Raises:
        InvalidValueError: A position is not finite, a bound or dt is not positive.
    """
    for name, point in (("start position", start), ("goal position", goal)):
        if not np.isfinite(point).all():
            raise InvalidValueError(name, point.tolist(), "finite")
    bounds = {"velocity": v_max, "acceleration": a_max, "jerk": j_max}
    for name, bound in bounds.items():
        if not (bound > 0.0).all() or np.isnan(bound).any():
            raise InvalidValueError(f"{name} bound", bound.tolist(), "positive")
    if not (np.isfinite(dt) and dt > 0.0):
        raise InvalidValueError("dt", dt, "positive and finite [s]")
