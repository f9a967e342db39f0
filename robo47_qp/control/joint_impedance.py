"""Joint impedance control with the full dynamics of the arm as feed-forward."""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from robo47_qp.arrays import Checked, NotNegative, Vector
from robo47_qp.control.controller import add_dry_friction
from robo47_qp.model.arm import Arm, JointReference, JointState


class FeedForward(Enum):
    """How much of its dynamics the arm is fed forward; each member adds to the one before."""

    NONE = "none"
    """Nothing: spring and damper alone."""
    GRAVITY = "gravity"
    """g(q): the arm is held up."""
    CORIOLIS = "coriolis"
    """c(q, v) and the friction and damping of the joints."""
    FULL = "full"
    """M(q) a_ref: the arm follows its reference without an error of the spring."""


@dataclass(frozen=True, kw_only=True)
class JointImpedance(Checked):
    """A spring and a damper in each joint, on top of the arm's own dynamics.

    tau = K (q_ref - q) + D (v_ref - v) + M(q) a_ref + c(q, v) + g(q) - tau_passive(v)

    with K the stiffness of the robot times `stiffness_scale` and D_i = 2 ζ √(K_i M_ii) at
    home. The last four terms make the arm follow a_ref without error; what remains for the
    spring is what the belief does not know (Siciliano et al., Robotics: Modelling, Planning
    and Control, 2009, sec. 8.5; Albu-Schäffer, Ott and Hirzinger, IJRR 26(1), 2007).
    """

    stiffness_scale: NotNegative = 1.0
    """Factor on the stiffness that the robot's description names [-]."""
    damping_ratio: NotNegative = 1.0
    """ζ: 1 is critically damped at home [-]."""
    feed_forward: FeedForward = FeedForward.FULL
    """Which of the arm's dynamics are added to spring and damper."""

    def torque(self, arm: Arm, reference: JointReference, state: JointState) -> Vector:
        """See `Controller.torque`."""
        K, D = self.springs(arm)
        if self.feed_forward is FeedForward.FULL:
            tau = arm.inverse_dynamics(state.q, state.v, reference.a)
        else:
            tau = _feed_forward(arm, self.feed_forward, state)
        if arm.has_dry_friction and self.feed_forward in _WITH_FRICTION:
            add_dry_friction(tau, arm, reference.v)
        tau += K * (reference.q - state.q)
        tau += D * (reference.v - state.v)
        return tau

    def springs(self, arm: Arm) -> tuple[Vector, Vector]:
        """Return stiffness and damping of the joints (n,), (n,)."""
        return arm.derived(_gains, self.stiffness_scale, self.damping_ratio)


def _feed_forward(arm: Arm, terms: FeedForward, state: JointState) -> Vector:
    still = np.zeros(arm.n)
    if terms is FeedForward.CORIOLIS:
        return arm.inverse_dynamics(state.q, state.v, still)
    if terms is FeedForward.GRAVITY:
        return arm.inverse_dynamics(state.q, still, still)
    return still


_WITH_FRICTION = (FeedForward.CORIOLIS, FeedForward.FULL)


def _gains(arm: Arm, stiffness_scale: float, damping_ratio: float) -> tuple[Vector, Vector]:
    K = stiffness_scale * arm.robot.stiffness
    return K, 2.0 * damping_ratio * np.sqrt(K * np.diag(arm.mass_matrix(arm.home)))
