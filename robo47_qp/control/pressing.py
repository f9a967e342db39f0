"""Pressing: force control along one axis of the tool, impedance along the others."""

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

ForceSensor = Callable[[], Vector]
"""Net contact force on the tool in the last period, in the world (3,) [N]."""
_TOUCH = 0.1
"""Share of the force above which the tool counts as in contact [-]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Pressing(Checked):
    """Controls the force along u, and the tool's impedance along and about all other axes.

    f = P f_K(P e) + P D P J (v_ref - v) + u (F + t) (1 - u·ẋ / s),   P = I - u uᵀ

    replaces the linear springs and dampers of `CartesianImpedance`; the angular ones stay. It is
    hybrid control (Raibert and Craig, Hybrid position/force control of manipulators, J. Dynamic
    Systems, Measurement and Control 103(2), 1981) without shaping of the inertia (Albu-Schäffer,
    Ott, Frese and Hirzinger, ICRA 2003). At rest on a surface of any stiffness the tool presses
    with F + t, less errors of the model such as payload and friction. The trim t removes these:
    it is the integral of the error of the measured force f (Villani and De Schutter, Force
    control, in: Springer Handbook of Robotics, 2nd ed. 2016, ch. 9),

        t' = γ clip(F - f, ±F) in contact, where f > F / 10;   t' = -γ t without;   |t| ≤ b F

    Without contact the tool moves along u at the speed s at most, whatever the trim; an unknown
    force δ adds s δ / (F + t). In contact the same term is the damper d = (F + t) / s: a surface
    that recedes at a speed r is pressed with (F + t)(1 - r / s). On an elastic surface without
    damping, Λ_u x'' + d x' + k x = F + t is stable with the trim if γ < d / Λ_u (Routh) for any
    k; so γ is held below half of F / (s Λ_u).

    The impact is that of the tool's inertia at the speed s: no controller is faster than a hard
    contact. With a pad of stiffness k the peak is about F + s √(k Λ_u).

    Close to a singularity Jᵀ stays bounded. The structure bears a force along a lost direction:
    the trim ends at its bound, and the joints stay.

    The reference's motion along u is not followed, but its acceleration is fed forward: keep
    the reference at rest along u.
    """

    force: Positive
    """F: force that the tool presses with [N]. For none, use a stiffness of 0."""
    axis: Vector = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))
    """u: direction of the force (3,), in the frame of the impedance; normalised [-]."""
    impedance: CartesianImpedance = CartesianImpedance()
    """Impedance of all other axes; that along u is not used."""
    speed_max: Positive = 0.1
    """s: speed without contact [m/s]."""
    trim_rate: NotNegative = 5.0
    """γ: largest rate at which the trim removes an error of the force; 0 for no trim [1/s]."""
    trim_max: Annotated[float, Range(at_least=0.0, below=1.0)] = 0.5
    """b: largest trim, as a share of the force [-]."""

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

    def build(self, arm: Arm, sensor: ForceSensor, *, dt: float = TIMESTEP) -> "Presser":
        """Return a controller of an arm, with its own trim, for control periods dt [s]."""
        return Presser(self, arm, sensor, dt)


class Presser:
    """A `Controller` that presses; see `Pressing`.

    A new payload leaves the trim as it is. It integrates once per `JointState`, even if `torque`
    is called twice for it, as happens when the payload changes.
    """

    def __init__(self, settings: Pressing, arm: Arm, sensor: ForceSensor, dt: float) -> None:
        """Start without trim."""
        self.settings = settings
        self._sensor, self._dt = sensor, dt
        self._u: list[float] = settings.axis.tolist()
        still = np.zeros(arm.n)
        self._state, self._new = JointState(still, still), False
        self.trim = 0.0
        """t: force added to the command [N]."""
        self.pressed = 0.0
        """f: force measured along the axis in the last period [N]."""

    def torque(self, arm: Arm, reference: JointReference, state: JointState) -> Vector:
        """See `Controller.torque`."""
        self._new = state is not self._state
        self._state = state
        return self.settings.impedance.torque_with(self._wrench, arm, reference, state)

    def _wrench(self, space: ToolSpace, error: list[float], twist: list[float]) -> list[float]:
        """Return f of `Pressing` and the torques, 6 numbers along the axes of the frame."""
        settings, u = self.settings, self._u
        if self._new:
            self._integrate(space)
        across = self._across(error), [*self._across(twist[:3]), *twist[3:]]
        f = settings.impedance.wrench(space, *across)
        speed = sum(map(mul, u, space.J[:3].dot(self._state.v).tolist()))
        push = (settings.force + self.trim) * (1.0 - speed / settings.speed_max)
        return [*(c + push * a for c, a in zip(self._across(f[:3]), u, strict=True)), *f[3:]]

    def _integrate(self, space: ToolSpace) -> None:
        """Measure the force and update the trim."""
        settings, measured = self.settings, self._sensor()
        if settings.impedance.frame == "tool":
            measured = measured.dot(space.rotation_ref)
        self.pressed = -sum(map(mul, self._u, measured.tolist()))
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
        """Return Λ_u: the tool's mass along the axis with the other axes held [kg]."""
        u = self.settings.axis
        return float(u.dot(space.inertia[:3, :3].dot(u)))

    def _across(self, x: list[float]) -> list[float]:
        """Return P x: the part of a vector across the axis."""
        along = sum(map(mul, self._u, x))
        return [c - along * a for c, a in zip(x, self._u, strict=True)]
