"""Cartesian impedance control: a spring at the tool, a compliant null space."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from math import sqrt
from typing import Annotated, Literal, TypeAlias

import numpy as np

from robo47_qp.arrays import Checked, Matrix, NotNegative, Range, Size, Vector
from robo47_qp.control.controller import add_dry_friction
from robo47_qp.control.tool_space import ToolSpace
from robo47_qp.model.arm import Arm, JointReference, JointState

Gains: TypeAlias = Annotated[Vector, Size(6), Range(at_least=0.0)]
"""One number per axis of the tool."""
Wrench: TypeAlias = Callable[[ToolSpace, list[float], list[float]], list[float]]
"""The six forces on the tool from its errors; see `CartesianImpedance.wrench`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CartesianImpedance(Checked):
    """Puts a spring and a damper between the tool and its reference.

    tau = M(q) a_ref + c(q, v_ref) + g(q) - tau_passive(v_ref)
          + Jᵀ (f(e) + D J (v_ref - v)) + N M (ω² (q_ref - q) + d (v_ref - v))

    The tool's reference is that of the joints. A force F displaces the tool by F/K along each
    axis against the arm's own inertia: no inertia is shaped, so no force sensor and no inverse
    of J are needed (Albu-Schäffer, Ott, Frese and Hirzinger, ICRA 2003; Ott, Cartesian Impedance
    Control of Redundant and Flexible-Joint Robots, 2008, ch. 3). Coriolis and friction terms are
    those of the reference, so at a reference at rest and with ω = 0 the energy ½ vᵀMv + U(e)
    only falls (Takegaki and Arimoto, J. Dynamic Systems, Measurement and Control 103(2), 1981).
    U(e) = ½ eᵀKe, for rotations 2 εᵀKε with ε the vector part of the error's quaternion
    (Caccavale, Siciliano and Villani, IEEE/ASME Trans. Mechatronics 4(3), 1999): its torque
    falls to zero at half a turn, without a jump.

    D_ii = 2 ζ √(K_ii Λ_ii(q)). N = I - Jᵀ Λ J M⁻¹ keeps the posture's torque from moving the tool
    (Khatib 1987; Dietrich, Ott and Albu-Schäffer, IJRR 34(11), 2015). Close to a singularity
    (see `ToolSpace`) joints that no longer move the tool follow the posture; spring and damper
    stay bounded there.
    """

    stiffness: Gains = field(default_factory=lambda: np.array([800.0] * 3 + [40.0] * 3))
    """K (6,), linear part first, along the axes of `frame` [N/m, N·m/rad]."""
    damping_ratio: NotNegative = 1.0
    """ζ: 1 is critically damped for the inertia along each axis [-]."""
    frame: Literal["world", "tool"] = "world"
    """Axes of the stiffness: those of the world, or of the tool at its reference."""
    error_max: Gains = field(default_factory=lambda: np.array([0.1] * 3 + [0.5] * 3))
    """Error beyond which the force of a spring stays constant, per axis (6,)
    [m, twice the sine of half the angle]."""
    posture_frequency: NotNegative = 8.0
    """ω: natural frequency of the posture in the null space; 0 lets it drift [rad/s]."""
    posture_damping: NotNegative = 16.0
    """d: rate at which a motion in the null space decays [1/s]."""

    def torque(self, arm: Arm, reference: JointReference, state: JointState) -> Vector:
        """See `Controller.torque`."""
        return self.torque_with(self.wrench, arm, reference, state)

    def torque_with(
        self, wrench: Wrench, arm: Arm, reference: JointReference, state: JointState
    ) -> Vector:
        """Return the torque with `wrench` in place of f(e) + D J (v_ref - v)."""
        space, in_tool = arm.derived(ToolSpace), self.frame == "tool"
        np.subtract(reference.q, state.q, space.error_q)
        np.subtract(reference.v, state.v, space.error_v)
        # Two rows: the posture's acceleration, and the velocity error.
        self._posture.dot(space.errors, space.motions)
        space.set_reference(reference.q)
        arm.place(state.q)
        space.update(in_tool=in_tool)
        posture, unfelt = space.null_space_motions()
        free = space.inverse_dynamics((reference.v, unfelt), (reference.a, posture))
        twist = space.twists[1].tolist()
        force = np.array(wrench(space, space.position_error(in_tool=in_tool), twist))
        # Cancels the tool acceleration J̇ v of the null-space motion.
        force += space.inertia_times(space.jacobian_rate_times(unfelt, in_tool=in_tool))
        tau: Vector = space.J_T.dot(force)
        tau += free
        if arm.has_dry_friction:
            add_dry_friction(tau, arm, reference.v)
        return tau

    def wrench(self, space: ToolSpace, error: list[float], twist: list[float]) -> list[float]:
        """Return f(e) + D J (v_ref - v), 6 numbers along the axes of the frame.

        Args:
            space: The tool space, updated to the arm and its reference.
            error: Displacement from the tool to its reference, 3 numbers [m].
            twist: J (v_ref - v), 6 numbers.
        """
        # Scalars, because numpy takes twice the time for so few numbers.
        x, y, z = error
        w, ex, ey, ez = space.orientation_error(in_tool=self.frame == "tool")
        (kx, mx, dx), (ky, my, dy), (kz, mz, dz), *turning = self._gains
        (ka, ma, da), (kb, mb, db), (kc, mc, dc) = turning
        a, b, c = 2.0 * ex, 2.0 * ey, 2.0 * ez
        a = ka * (ma if a > ma else -ma if a < -ma else a)
        b = kb * (mb if b > mb else -mb if b < -mb else b)
        c = kc * (mc if c > mc else -mc if c < -mc else c)
        ix, iy, iz, ia, ib, ic = space.inertias
        vx, vy, vz, va, vb, vc = twist
        return [
            kx * (mx if x > mx else -mx if x < -mx else x) + dx * sqrt(ix) * vx,
            ky * (my if y > my else -my if y < -my else y) + dy * sqrt(iy) * vy,
            kz * (mz if z > mz else -mz if z < -mz else z) + dz * sqrt(iz) * vz,
            # The gradient of the potential 2 εᵀKε: 2 (η Kε - ε × Kε).
            w * a + ez * b - ey * c + da * sqrt(ia) * va,
            w * b + ex * c - ez * a + db * sqrt(ib) * vb,
            w * c + ey * a - ex * b + dc * sqrt(ic) * vc,
        ]

    @cached_property
    def _posture(self) -> Matrix:
        """Matrix from the two errors to the posture's acceleration and the velocity error."""
        return np.array([[self.posture_frequency**2, self.posture_damping], [0.0, 1.0]])

    @cached_property
    def _gains(self) -> list[tuple[float, float, float]]:
        """Stiffness, largest error, and damping over the root of the inertia, per axis."""
        rates = [2.0 * self.damping_ratio * sqrt(k) for k in self.stiffness.tolist()]
        return list(zip(self.stiffness.tolist(), self.error_max.tolist(), rates, strict=True))
