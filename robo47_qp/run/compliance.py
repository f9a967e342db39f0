"""Compliance: how the tool gives way in contact, and the change to it and back without a bump."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np

from robo47_qp.arrays import Checked, NotNegative, Size, Vector
from robo47_qp.control.cartesian_impedance import CartesianImpedance, Gains
from robo47_qp.control.controller import Controller
from robo47_qp.control.pressing import Pressing
from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm, JointReference, JointState
from robo47_qp.run.control_loop import ControlLoop

_AT_REST = 2e-3
"""Joint speed below which the arm counts as at rest [rad/s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Compliance(Checked):
    """How the tool gives way while it is in contact, and how hard it presses."""

    stiffness: Gains = field(default_factory=lambda: np.array([800.0] * 3 + [40.0] * 3))
    """Per axis of the frame (6,), linear part first [N/m, N·m/rad]."""
    frame: Literal["world", "tool"] = "world"
    """Frame whose axes the stiffness has."""
    axis: Annotated[Vector, Size(3, unit=True)] | None = None
    """Direction to press in, a unit vector in the world (3,); None does not press. With the frame
    "tool" it turns with the tool from the start of the step on. Motion of the reference along it
    is ignored, so the waypoints should lie in a plane normal to it."""
    force: NotNegative = 0.0
    """Force to press with along the axis, whatever the surface does [N]."""
    speed: NotNegative = 0.1
    """Largest speed along the axis while nothing is touched [m/s]."""

    def __post_init__(self) -> None:
        """Check and freeze the numbers.

        Raises:
            InvalidValueError: A number is negative, not finite or of the wrong shape.
        """
        super().__post_init__()
        if (self.axis is None) != (self.force == 0.0):
            raise InvalidValueError(
                "force", f"{self.force} N with axis {self.axis}", "above 0 with an axis, or neither"
            )


class CompliantMode:
    """Makes the arm of a control loop compliant, and stiff again."""

    def __init__(self, loop: ControlLoop) -> None:
        """Start stiff."""
        self._loop = loop
        self._stiff: Controller | None = None
        self._compliance: Compliance | None = None

    @property
    def active(self) -> bool:
        """True while the arm is compliant."""
        return self._stiff is not None

    def soften(self, compliance: Compliance) -> None:
        """Make the arm compliant until `stiffen`."""
        loop = self._loop
        if compliance is self._compliance:
            return
        if self._stiff is None:
            self._stiff = loop.control.controller
        self._compliance = compliance
        loop.compensate(on=False)
        loop.control.switch(self._controller(compliance))

    def stiffen(self) -> None:
        """Make a compliant arm stiff where it is, and bring it to rest.

        Raises:
            Aborted: See `ControlLoop.track`.
        """
        if self._stiff is None:
            return
        loop, stiff = self._loop, self._stiff
        self._stiff = self._compliance = None
        speed = loop.state().v.copy()
        self._restart(stiff)
        loop.compensate(on=True)
        speed[np.abs(speed) < _AT_REST] = 0.0
        if speed.any():
            loop.take_over(JointReference(loop.reference.q, speed, np.zeros(loop.arm.n)))
            loop.halt()

    def unload(self) -> None:
        """Take the arm's position as the reference of the springs, so that they carry no load."""
        if self.active:
            self.unload_stiff()

    def unload_stiff(self) -> None:
        """Do the same whether the arm is compliant or stiff."""
        self._restart(self._loop.control.controller)

    def _restart(self, controller: Controller) -> None:
        """Take the arm's position as the reference, at rest, and go on with a controller.

        Springs that lose their load at once would be felt: the torque fades from what it was,
        not from what the old control law commands at the new reference.
        """
        loop, control = self._loop, self._loop.control
        loop.rest(np.clip(loop.state().q, loop.arm.q_min, loop.arm.q_max))
        control.switch(_ConstantTorque(control.commanded.copy()), seconds=0.0)
        control.switch(controller)

    def _controller(self, compliance: Compliance) -> Controller:
        springs = CartesianImpedance(stiffness=compliance.stiffness, frame=compliance.frame)
        if compliance.axis is None:
            return springs
        loop, axis = self._loop, compliance.axis
        if compliance.frame == "tool":
            axis = loop.arm.pose(loop.reference.q).rotation().as_matrix().T @ axis
        pressing = Pressing(
            force=compliance.force, axis=axis, impedance=springs, speed_max=compliance.speed
        )
        return pressing.build(loop.control.arm, self._felt)

    def _felt(self) -> Vector:
        """Contact force on the tool and its known payload (3,), in the world [N]."""
        arm, felt = self._loop.control.arm, self._loop.sim.felt_force()
        if arm.payload is not None:
            felt -= arm.payload.mass * arm.model.opt.gravity
        return felt


@dataclass(frozen=True, eq=False)
class _ConstantTorque:
    """Commands the same torque in every period."""

    tau: Vector

    def torque(self, arm: Arm, reference: JointReference, state: JointState) -> Vector:
        return self.tau.copy()
