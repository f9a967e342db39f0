"""MotorShare: what part of their torque the motors may spend on a planned motion."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from robo47_qp.arrays import Checked, Ratio, Vector
from robo47_qp.model.arm import Arm
from robo47_qp.model.ratings import inertia_and_gravity
from robo47_qp.model.robot import MotionProfile
from robo47_qp.motion.trajectory import Trajectory

_LEAST = 0.1
"""Share of its limit that counts as left to a motor by gravity, at least [-]."""


class Excess(NamedTuple):
    """How much a motion asks of the motors, relative to what it may; more than 1 is too much."""

    torque: float
    rate: float


@dataclass(frozen=True, kw_only=True)
class MotorShare(Checked):
    """Bounds on torques of planned motions; the rest is for control and for what is carried."""

    torque: Ratio = 0.8
    """Of the torque that gravity leaves, for inertial and velocity forces [-]."""
    rate: Ratio = 0.5
    """Of the largest change of the torque [-]."""

    def smoothed(self, arm: Arm, profile: MotionProfile) -> MotionProfile:
        """Return a profile with jerks that the motors can do on any motion.

        They are reduced in all joints together until Σ_j |M_ij| j_j is no more than the change of
        torque that motor i may make, in configurations all over the joint ranges: for stops and
        streams, of which nothing is known before.
        """
        M, _ = arm.derived(inertia_and_gravity)
        rate = np.abs(M) @ profile.j_max / (self.rate * arm.robot.tau_rate_max)
        return replace(profile, j_max=profile.j_max / max(1.0, float(rate.max())))

    def excess(self, arm: Arm, trajectory: Trajectory, dt: float) -> Excess:
        """Return what a motion asks of the motors, by the inverse dynamics of the arm."""
        still = np.zeros(arm.n)
        robot = arm.robot
        tau, weight = np.empty_like(trajectory.q), np.empty_like(trajectory.q)
        for k, (q, v, a) in enumerate(zip(trajectory.q, trajectory.v, trajectory.a, strict=True)):
            weight[k] = arm.inverse_dynamics(q, still, still)
            tau[k] = arm.inverse_dynamics(q, v, a)
        left = np.maximum(robot.tau_max - np.abs(weight), _LEAST * robot.tau_max)
        moving = np.abs(tau - weight) / (self.torque * left)
        change: Vector = np.abs(np.diff(tau, axis=0)) / (self.rate * robot.tau_rate_max * dt)
        return Excess(float(moving.max(initial=0.0)), float(change.max(initial=0.0)))
