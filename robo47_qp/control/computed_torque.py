"""Computed-torque control: every joint as the same mass, spring and damper."""

from dataclasses import dataclass

import numpy as np

from robo47_qp.arrays import Checked, NotNegative, Ratio, Vector
from robo47_qp.control.controller import add_dry_friction
from robo47_qp.model.arm import Arm, JointReference, JointState


@dataclass(frozen=True, kw_only=True)
class ComputedTorque(Checked):
    """Gives every joint the same natural frequency, whatever the configuration.

    tau = M(q) (a_ref + ω² e + 2 ζ ω (v_ref - v)) + c(q, v) + g(q) - tau_passive(v),  e = q_ref - q

    Without disturbances ë + 2 ζ ω ė + ω² e = 0 in each joint (Luh, Walker and Paul, IEEE Trans.
    Automatic Control 25(3), 1980; Siciliano et al., Robotics: Modelling, Planning and Control,
    2009, sec. 8.5.2). No joint is faster than another, so that a delay which one stands all
    stand: the gains of `JointImpedance` make the fastest of the Panda's joints four to six times
    faster, by its configuration. The stiffness against external forces is ω² M(q).

    A joint of so little inertia that friction decides about it, as in models without rotor
    inertias, keeps a part of the robot's stiffness: K_x = max(0, s K - ω² M_ii) and the damping
    2 ζ √(K_x M_ii) at home are added to it.
    """

    frequency: NotNegative = 30.0
    """ω: natural frequency of every joint [rad/s]."""
    damping_ratio: NotNegative = 1.0
    """ζ: 1 is critically damped [-]."""
    stiffness_share: Ratio = 0.25
    """s: part of the stiffness in the robot's description that no joint falls below [-]."""

    def torque(self, arm: Arm, reference: JointReference, state: JointState) -> Vector:
        """See `Controller.torque`."""
        e = reference.q - state.q
        e_v = reference.v - state.v
        a = e * self.frequency**2
        a += e_v * (2.0 * self.damping_ratio * self.frequency)
        a += reference.a
        tau = arm.inverse_dynamics(state.q, state.v, a)
        springs = self.springs(arm)
        if springs is not None:
            K, D = springs
            tau += K * e
            tau += D * e_v
        if arm.has_dry_friction:
            add_dry_friction(tau, arm, reference.v)
        return tau

    def springs(self, arm: Arm) -> tuple[Vector, Vector] | None:
        """Return stiffness and damping (n,), (n,) that are added; None where none are."""
        return arm.derived(_springs, self.frequency, self.damping_ratio, self.stiffness_share)


def _springs(
    arm: Arm, frequency: float, ratio: float, share: float
) -> tuple[Vector, Vector] | None:
    """Return stiffness and damping (n,), (n,) of joints with little inertia; None without any."""
    M = np.diag(arm.mass_matrix(arm.home))
    K = np.maximum(0.0, share * arm.robot.stiffness - frequency**2 * M)
    return (K, 2.0 * ratio * np.sqrt(K * M)) if K.any() else None
