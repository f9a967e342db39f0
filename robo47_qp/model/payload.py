"""Payload: a rigid body held by the tool, as the controller believes it."""

from dataclasses import dataclass

from mink import SE3

from robo47_qp.arrays import Checked, Positive, check_pose, checked_vector
from robo47_qp.errors import InvalidValueError


@dataclass(frozen=True, kw_only=True, eq=False)
class Payload(Checked):
    """A rigid body held by the tool, as the controller believes it."""

    mass: Positive
    """[kg]"""
    inertia: tuple[float, float, float]
    """Principal moments about the centre of mass, along the axes of T_tcp_com [kg·m²]."""
    T_tcp_com: SE3
    """Pose of the principal axes, at the centre of mass, in the tool frame."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: The mass is not positive, the inertia not that of a body, or the
                pose none.
        """
        super().__post_init__()
        check_pose("payload T_tcp_com", self.T_tcp_com)
        moments = checked_vector("payload inertia", self.inertia, 3)
        if (moments <= 0.0).any() or 2 * moments.max() > moments.sum() * (1 + 1e-9):
            raise InvalidValueError(
                "payload inertia",
                moments.tolist(),
                "three positive moments, none above the sum of the others",
            )

    def _label(self, field: str) -> str:
        return f"payload {field}"
