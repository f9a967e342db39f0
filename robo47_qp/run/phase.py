"""Phase: a part of a run, and how the arm follows its reference in it."""

from dataclasses import dataclass

from robo47_qp.arrays import Vector
from robo47_qp.motion.planner import Leg


@dataclass(frozen=True, kw_only=True, eq=False)
class Phase:
    """A part of the run with one name and at most one planned motion."""

    name: str
    start: int
    """First row."""
    leg: Leg | None
    """The planned motion; None while the arm holds still."""
    compliant: bool = False
    """True where the tool may leave its reference: it is compliant, or stops where it touched."""
    streamed: bool = False
    """True where the reference follows a moving target, or a force: its jerk is not bounded."""
    axis: Vector | None = None
    """Direction in which the reference leaves the planned motion as the tool presses along it: a
    unit vector in the world (3,). None where it does not press, or is compliant."""

    def continues(self, last: "Phase") -> bool:
        """Return whether it has the name of the last phase, and the arm follows as it did then."""
        same = (self.name, self.compliant, self.streamed) == (
            last.name,
            last.compliant,
            last.streamed,
        )
        if not same or self.axis is None or last.axis is None:
            return same and self.axis is last.axis
        return bool((self.axis == last.axis).all())
