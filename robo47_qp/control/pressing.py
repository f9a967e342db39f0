"""Pressing: a force along one axis of the tool, springs along all others."""

from collections.abc import Callable
from dataclasses import dataclass, field
from operator import mul
from typing import Annotated

import numpy as np

from robo47_qp.arrays import (
    Checked,
    NotNegative,
    Positive,
    Range,
    Vector,
    checked_vector,
    frozen_vector,
)
from robo47_qp.constants import TIMESTEP
from robo47_qp.control.cartesian_impedance import CartesianImpedance
from robo47_qp.control.tool_space import ToolSpace
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm, JointReference, JointState

Feel = Callable[[], Vector]
"""Net contact force of the surroundings on the tool in the last period, in the world (3,) [N]."""
_TOUCH = 0.1
"""Part of the force from which the tool counts as in contact [-]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Pressing(Checked):
    """Hybrid control: a force along u, the tool's impedance along and about all else.

    f = P f_K(P e) + P D P J (v_ref - v) + u (F + t) (1 - u·ẋ / s),   P = I - u uᵀ

    takes the place of the linear springs and dampers of `CartesianImpedance`; those that turn
    stay. What is held in force and what in position complement each other (Raibert and Craig,
    Hybrid position/force control of manipulators, J. Dynamic Systems, Measurement and Control
    103(2), 1981), and as in the impedance no inertia is shaped (Albu-Schäffer, Ott, Frese and
    Hirzinger, ICRA 2003). At rest on a surface of any stiffness the tool presses with F + t,
    less what the arm does not know of itself: payload, friction. The trim t takes that away: it
    is the integral of the error of the measured force f (Villani and De Schutter, Force control,
    in: Springer Handbook of Robotics, 2nd ed. 2016, ch. 9),

        t' = γ clip(F - f, ±F) in contact, where f > F / 10;   t' = -γ t without;   |t| ≤ b F

    Without contact the tool runs along u at the speed s at most, whatever the trim: the push
    falls to zero there, and brakes beyond. A force δ that the belief lacks adds s δ / (F + t).
    In contact the same term is the damper d = (F + t) / s: a surface that gives way at a speed r
    is pressed with (F + t)(1 - r / s). On an elastic surface without damping,
    Λ_u x'' + d x' + k x = F + t is stable with the trim if γ < d / Λ_u (Routh), however stiff it
    is; so γ is held below half of F / (s Λ_u).

    What the tool meets on touching is its own inertia at the speed s: no controller is faster
    than a hard contact. A pad decides the peak, about F + s √(k Λ_u) with k its stiffness.

    Towards a singularity Jᵀ needs no inverse and stays bounded. A force along a direction that
    is lost is borne by the structure: the trim ends at its bound, and the joints do not run.

    The reference's motion along u is not followed; its acceleration is fed forward all the
    same, so let it stay level.
    """

    force: Positive
    """F: what the tool presses with, above 0 [N]. For none, use a stiffness of 0."""
    axis: Vector = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))
    """Where to (3,), in the frame of the impedance; made a unit vector, u [-]."""
    impedance: CartesianImpedance = CartesianImpedance()
    """Of all other axes; what it says of u is not used."""
    speed_max: Positive = 0.1
    """s: speed without contact [m/s]."""
    trim_rate: NotNegative = 5.0
    """γ: rate at which the trim takes an error of the force away, at most; 0 for none [1/s]."""
    trim_max: Annotated[float, Range(at_least=0.0, below=1.0)] = 0.5
    """b: largest trim, as a part of the force, below 1 [-]."""

    def __post_init__(self) -> None:
        """Check and freeze the settings.

        Raises:
            InvalidValueError: A number is out of range, or the axis has no direction.
        """
        super().__post_init__()
        axis = checked_vector("axis", self.axis, 3)
        length = float(np.linalg.norm(axis))
        if length < 1e-6:
            raise InvalidValueError("axis", axis.tolist(), "a vector with a direction")
        object.__setattr__(self, "axis", frozen_vector("axis", axis / length, 3))

    def build(self, arm: Arm, feel: Feel, *, dt: float = TIMESTEP) -> "Presser":
        """The controller at work, which remembers its trim.

        Args:
            arm: The arm that is to press, with whatever payload.
            feel: The force sensor.
            dt: Control period [s].
        """
        return Presser(self, arm, feel, dt)


class Presser:
    """A `Controller` that presses; see `Pressing`.

    A new belief about the payload leaves the trim as it is. Asked twice about one state, as it
    is when the belief changes, it integrates once: a period is known by its `JointState`.
    """

    def __init__(self, settings: Pressing, arm: Arm, feel: Feel, dt: float) -> None:
        """Start without trim."""
        self.settings = settings
        self._feel, self._dt = feel, dt
        self._u: list[float] = settings.axis.tolist()
        still = np.zeros(arm.n)
        self._state, self._new = JointState(still, still), False
        self.trim = 0.0
        """t: force that is commanded on top [N]."""
        self.pressed = 0.0
        """f: force that was measured along the axis in the last period [N]."""

    def torque(self, arm: Arm, reference: JointReference, state: JointState) -> Vector:
        """See `Controller.torque`."""
        self._new = state is not self._state
        self._state = state
        return self.settings.impedance.torque_with(self._wrench, arm, reference, state)

    def _wrench(self, space: ToolSpace, way: list[float], twist: list[float]) -> list[float]:
        """Six forces along the axes of the frame: f of `Pressing`."""
        settings, u = self.settings, self._u
        if self._new:
            self._integrate(space)
        across = self._across(way), [*self._across(twist[:3]), *twist[3:]]
        f = settings.impedance.wrench(space, *across)
        speed = sum(map(mul, u, space.J[:3].dot(self._state.v).tolist()))
        push = (settings.force + self.trim) * (1.0 - speed / settings.speed_max)
        return [*(c + push * a for c, a in zip(self._across(f[:3]), u, strict=True)), *f[3:]]

    def _integrate(self, space: ToolSpace) -> None:
        """Measure the force, and bring the trim up to date."""
        settings, felt = self.settings, self._feel()
        if settings.impedance.frame == "tool":
            felt = felt.dot(space.rotation_ref)
        self.pressed = -sum(map(mul, self._u, felt.tolist()))
        force = settings.force
        stable = force / (settings.speed_max * self._inertia(space))
        gain = min(settings.trim_rate, 0.5 * stable) * self._dt
        if self.pressed > _TOUCH * force:
            bound = settings.trim_max * force
            trim = self.trim + gain * min(max(force - self.pressed, -force), force)
            self.trim = min(max(trim, -bound), bound)
        else:
            self.trim -= min(gain, 1.0) * self.trim

    def _inertia(self, space: ToolSpace) -> float:
        """Λ_u: mass that a force along the axis meets while the other axes are held [kg]."""
        u = self.settings.axis
        return float(u.dot(space.inertia[:3, :3].dot(u)))

    def _across(self, x: list[float]) -> list[float]:
        """P x: what of a vector is not along the axis."""
        along = sum(map(mul, self._u, x))
        return [c - along * a for c, a in zip(x, self._u, strict=True)]
