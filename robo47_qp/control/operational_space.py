"""Operational space control: the tool as a unit mass along each axis."""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np

from robo47_qp.arrays import Checked, NotNegative, Numbers, Range, Vector
from robo47_qp.control.controller import add_dry_friction
from robo47_qp.control.tool_space import ToolSpace
from robo47_qp.model.arm import Arm, JointReference, JointState


@dataclass(frozen=True, kw_only=True)
class OperationalSpace(Checked):
    """Shapes the inertia: each axis of the tool behaves as a mass, a spring and a damper.

    tau = M(q) a_ref + c(q, v) + g(q) - tau_passive(v)
          + Jᵀ Λ (ω² e + 2 ζ ω J (v_ref - v) + J̇ (v_ref - v)) + N M (ω_n² (q_ref - q) + ...)

    Without external forces, ë + 2 ζ ω ė + ω² e = 0 on every axis in every configuration (Khatib
    1987, see `ToolSpace`; written with the joints' reference accelerations). Errors decay alike
    on all axes, but the stiffness ω² Λ(q) against external forces grows with the inertia; to
    choose it, use `CartesianImpedance`. Close to a singularity Λ is bounded (see `ToolSpace`):
    the tool does not follow in the lost direction, and the joints keep to the posture.
    """

    frequency: NotNegative = 25.0
    """ω: natural frequency of the tool's translation and rotation [rad/s]."""
    damping_ratio: NotNegative = 1.0
    """ζ: 1 is critically damped [-]."""
    error_max: Annotated[tuple[float, float], Numbers(2, Range(at_least=0.0))] = (0.1, 0.5)
    """Largest error that counts, per axis [m, twice the sine of half the angle]."""
    posture_frequency: NotNegative = 8.0
    """ω_n: natural frequency of the posture in the null space; 0 lets it drift [rad/s]."""
    posture_damping: NotNegative = 16.0
    """Rate at which a motion in the null space decays [1/s]."""

    def torque(self, arm: Arm, reference: JointReference, state: JointState) -> Vector:
        """See `Controller.torque`."""
        space = arm.derived(ToolSpace)
        e_v = reference.v - state.v
        posture = reference.q - state.q
        posture *= self.posture_frequency**2
        posture += self.posture_damping * e_v
        space.set_reference(reference.q)
        arm.place(state.q)
        space.update(in_tool=False)
        tau = arm.inverse_dynamics_here(state.v, reference.a + posture)
        a = np.empty(6)
        np.subtract(space.position_ref, space.position, out=a[:3])
        _, x, y, z = space.orientation_error(in_tool=False)
        a[3:] = (2.0 * x, 2.0 * y, 2.0 * z)
        np.minimum(a, self._bounds, out=a)
        np.maximum(a, -self._bounds, out=a)
        a *= self.frequency**2
        a += 2.0 * self.damping_ratio * self.frequency * space.J.dot(e_v)
        a += space.jacobian_rate_times(e_v)
        a -= space.J.dot(posture)
        tau += space.J_T.dot(space.inertia.dot(a))
        if arm.has_dry_friction:
            add_dry_friction(tau, arm, reference.v)
        return tau

    @cached_property
    def _bounds(self) -> Vector:
        return np.repeat(self.error_max, 3)
