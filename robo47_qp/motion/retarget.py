"""Retargeting: a new goal while the arm moves, without a jump in acceleration."""

import numpy as np

from robo47_qp.arrays import Vector
from robo47_qp.errors import PlanError, RefusalReason, Rejection
from robo47_qp.model.arm import Arm, JointReference
from robo47_qp.model.robot import MotionProfile
from robo47_qp.motion.timing.state_to_state import to_state
from robo47_qp.motion.trajectory import Trajectory

_ROUNDING = 1e-9


def retarget(
    arm: Arm, now: JointReference, q_goal: Vector, profile: MotionProfile, dt: float
) -> Trajectory:
    """From a reference in motion to rest at a goal, time-optimal, velocity to jerk bounded.

    The first sample is the reference itself: position, velocity and acceleration go on from
    it. All joints arrive together; their path is no line. Where the reference is faster than
    the profile allows, it is slowed down first. Time is stretched by nothing: the last sample
    falls on the first whole period after the arrival.

    Args:
        arm: The arm.
        now: What the joints are doing.
        q_goal: Where to come to rest (n,) [rad].
        profile: Bounds of the joints.
        dt: Time between samples [s].

    Raises:
        InvalidValueError: A number is not finite.
        PlanError: The goal is outside the joint limits, or the arm cannot turn round inside
            them; joint and time are named.
    """
    goal = arm.checked_q("q_goal", q_goal)
    start, rest = np.stack(now), np.stack([goal, np.zeros(arm.n), np.zeros(arm.n)])
    leap = to_state(start, rest, profile.v_max, profile.a_max, profile.j_max)
    steps = int(np.ceil(leap.duration / dt - _ROUNDING))
    states = np.array([leap.at(min(k * dt, leap.duration)) for k in range(steps + 1)])
    states = states.reshape(steps + 1, 3, arm.n)
    states[0], states[-1] = (start, rest) if steps else (rest, rest)
    q = states[:, 0].copy()
    outside = (q < arm.q_min) | (q > arm.q_max)
    if outside.any():
        k, i = (int(x) for x in np.argwhere(outside)[0])
        joint = arm.robot.joints[i]
        rejection = Rejection(
            reason=RefusalReason.JOINT_LIMIT,
            segment="retarget",
            fraction=k / max(1, steps),
            time=k * dt,
            joint=joint,
            q=tuple(q[k].tolist()),
        )
        raise PlanError("retarget", f"{joint} leaves its limits after {k * dt:.3f} s", rejection)
    return Trajectory(dt=dt, q=q, v=states[:, 1].copy(), a=states[:, 2].copy())


class Pursuit:
    """Follows a goal that changes whenever it likes, one control period at a time."""

    def __init__(self, arm: Arm, q_start: Vector, profile: MotionProfile, dt: float) -> None:
        """At rest at q_start.

        Args:
            arm: The arm.
            q_start: Configuration (n,) [rad].
            profile: Bounds of the joints.
            dt: Control period [s].

        Raises:
            InvalidValueError: `q_start` is not finite.
        """
        self._arm, self._profile, self._dt = arm, profile, dt
        q = arm.checked_q("q_start", q_start)
        self._plan = Trajectory(dt=dt, q=q[None], v=np.zeros((1, arm.n)), a=np.zeros((1, arm.n)))
        self._at = 0
        self._goal = q

    @property
    def reference(self) -> JointReference:
        """What the joints should do now."""
        plan, k = self._plan, self._at
        return JointReference(plan.q[k].copy(), plan.v[k].copy(), plan.a[k].copy())

    @property
    def goal(self) -> Vector:
        """Where it is going (n,) [rad]."""
        return self._goal.copy()

    def aim(self, q_goal: Vector) -> None:
        """Go to another goal from now on; where that is refused, the old one stays.

        Raises:
            InvalidValueError: `q_goal` is not finite.
            PlanError: See `retarget`.
        """
        goal = self._arm.checked_q("q_goal", q_goal)
        self._plan = retarget(self._arm, self.reference, goal, self._profile, self._dt)
        self._at, self._goal = 0, goal

    def step(self) -> JointReference:
        """One period on; stays at the goal once there."""
        self._at = min(self._at + 1, self._plan.steps)
        return self.reference
