"""Cartesian impedance control: the tool on a spring, the elbow free to give way."""

from dataclasses import dataclass, field
from functools import cached_property
from math import sqrt
from typing import Literal

import numpy as np

from robo47_qp.arm import Arm, JointReference, JointState
from robo47_qp.arrays import Vector, frozen_vector
from robo47_qp.controllers.dry_friction import add_dry_friction
from robo47_qp.controllers.tool_space import ToolSpace, tool_space
from robo47_qp.errors import InvalidValueError


@dataclass(frozen=True, kw_only=True, eq=False)
class CartesianImpedance:
    """A spring and a damper between the tool and its reference, on top of the arm's dynamics.

    tau = M(q) a_ref + c(q, v_ref) + g(q) - tau_passive(v_ref)
          + Jᵀ (f(e) + D J (v_ref - v)) + N M (ω² (q_ref - q) + d (v_ref - v))

    The tool's reference is that of the joints. A force F on the tool displaces it by F/K along
    each axis and the inertia that it meets is the arm's own: no inertia is shaped, so no force
    sensor is needed and nothing is inverted on the way from spring to torque (Albu-Schäffer,
    Ott, Frese and Hirzinger, ICRA 2003; Ott, Cartesian Impedance Control of Redundant and
    Flexible-Joint Robots, 2008, ch. 3). Coriolis and friction terms are those of the reference:
    what the arm does beyond it meets its own. So at a reference at rest the stored energy
    ½ vᵀMv + U(e) only falls, by D, d and the friction of the joints, while ω = 0 (Takegaki and
    Arimoto, J. Dynamic Systems, Measurement and Control 103(2), 1981). U(e) = ½ eᵀKe, for
    rotations 2 εᵀKε with ε the vector part of
    the error's quaternion (Caccavale, Siciliano and Villani, IEEE/ASME Trans. Mechatronics
    4(3), 1999): its torque falls to zero at half a turn instead of jumping there.

    D_ii = 2 ζ √(K_ii Λ_ii(q)). N = I - Jᵀ Λ J M⁻¹ lets the posture act without the tool feeling
    it (Khatib 1987; Dietrich, Ott and Albu-Schäffer, IJRR 34(11), 2015). Close to a singularity
    (see `ToolSpace`) the joints that do not move the tool any more follow the posture; spring
    and damper stay bounded there, since Jᵀ needs no inverse.
    """

    stiffness: Vector = field(default_factory=lambda: np.array([800.0] * 3 + [40.0] * 3))
    """K (6,), linear part first, along the axes of `frame` [N/m, N·m/rad]."""
    damping_ratio: float = 1.0
    """ζ: 1 is critically damped for the inertia along each axis [-]."""
    frame: Literal["world", "tool"] = "world"
    """Whose axes the stiffness has: the world's, or those of the tool at its reference."""
    error_max: Vector = field(default_factory=lambda: np.array([0.1] * 3 + [0.5] * 3))
    """Largest error that a spring answers, per axis (6,); beyond, its force stays
    [m, twice the sine of half the angle]."""
    posture_frequency: float = 8.0
    """ω: natural frequency of the posture in the null space; 0 lets it drift [rad/s]."""
    posture_damping: float = 16.0
    """d: rate at which a motion in the null space decays [1/s]."""

    def __post_init__(self) -> None:
        """Check and freeze the gains.

        Raises:
            InvalidValueError: A gain is negative, not finite or of the wrong shape; the frame
                is unknown.
        """
        for name in ("stiffness", "error_max"):
            values = frozen_vector(name, getattr(self, name), 6)
            if (values < 0.0).any():
                raise InvalidValueError(name, values.tolist(), "six numbers, none negative")
            object.__setattr__(self, name, values)
        for name in ("damping_ratio", "posture_frequency", "posture_damping"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise InvalidValueError(name, value, "finite and not negative")
        if self.frame not in ("world", "tool"):
            raise InvalidValueError("frame", repr(self.frame), "'world' or 'tool'")

    def torque(self, arm: Arm, reference: JointReference, state: JointState) -> Vector:
        """See `Controller.torque`."""
        space, in_tool = tool_space(arm), self.frame == "tool"
        e_v = reference.v - state.v
        posture = reference.q - state.q
        posture *= self.posture_frequency**2
        posture += self.posture_damping * e_v
        space.ask(reference.q)
        arm.place(state.q)
        space.update(in_tool=in_tool)
        twist = space.J.dot(e_v)
        unfelt = space.unfelt(e_v, twist)
        tau = arm.inverse_dynamics_here(reference.v - unfelt, reference.a + posture)
        a = space.J.dot(posture)
        a -= space.jacobian_rate_times(unfelt, in_tool=in_tool)
        wrench = self._spring_and_damper(space, twist, in_tool=in_tool)
        wrench -= space.inertia.dot(a)
        tau += space.J_T.dot(wrench)
        if arm.slips:
            add_dry_friction(tau, arm, reference.v)
        return tau

    def _spring_and_damper(self, space: ToolSpace, twist: Vector, *, in_tool: bool) -> Vector:
        """f(e) + D J (v_ref - v) (6,), along the axes of the frame.

        Scalars, because numpy takes twice the time for so few numbers.
        """
        way = space.position_ref - space.position
        if in_tool:
            way = way.dot(space.rotation_ref)
        w, x, y, z = space.turn(in_tool=in_tool)
        e = (*way.tolist(), 2.0 * x, 2.0 * y, 2.0 * z)
        springs = zip(e, self._springs, strict=True)
        f = [k * (m if d > m else -m if d < -m else d) for d, (k, m) in springs]
        a, b, c = f[3:]
        # The gradient of the potential 2 εᵀKε: 2 (η Kε - ε × Kε).
        f[3:] = (w * a + z * b - y * c, w * b + x * c - z * a, w * c + y * a - x * b)
        dampers = zip(f, self._dampers, space.inertias.tolist(), twist.tolist(), strict=True)
        return np.array([force + d * sqrt(i) * v for force, d, i, v in dampers])

    @cached_property
    def _springs(self) -> list[tuple[float, float]]:
        return list(zip(self.stiffness.tolist(), self.error_max.tolist(), strict=True))

    @cached_property
    def _dampers(self) -> list[float]:
        return [2.0 * self.damping_ratio * sqrt(k) for k in self.stiffness.tolist()]
