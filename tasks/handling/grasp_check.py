"""Grasp check: whether an item is between the fingers."""

from collections.abc import Callable
from dataclasses import dataclass

from mink import SE3

from robo47_qp.run.failure import Cause, Condition
from robo47_qp.sim.sensed import Sensed
from robo47_qp.tasks.item import Item

WIDTH_TOLERANCE = 3e-3
"""Largest difference between the opening width and that of an item of known size [m]."""
LEAST_SHARE = 0.1
"""Least force of a finger that holds an item, relative to the commanded one [-]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GraspCheck:
    """Checks that an item is held: the opening width is the item's, and the fingers press on it."""

    sensed: Sensed
    item: Item
    force: float
    """Commanded force of one finger [N]."""
    standing: Callable[[], SE3]
    """Returns T_world_item as the camera sees it now, with z up."""
    settled: bool = False
    """True if the fingers must also be at rest."""

    def condition(self, cause: Cause) -> Condition:
        """Return the condition that the item is held; a violation fails with `cause`."""
        name = f"the fingers hold the {self.item.name}"
        return Condition(name=name, cause=cause, against=self._against)

    def around(self, cause: Cause) -> Condition:
        """Return the condition that the fingers are not closer than the item is wide."""
        name = f"the fingers are around the {self.item.name}"
        return Condition(name=name, cause=cause, against=self._past)

    def _past(self) -> str | None:
        width, expected, within = self._widths()
        return self._apart(width, expected) if width < expected - within else None

    def _widths(self) -> tuple[float, float, float]:
        """Return the opening width, that of the item, and how far they may be apart [m]."""
        expected = self.item.width(self.sensed.tool_pose(), self.standing())
        part = float(self.sensed.sheet.noise["size_tolerance"])
        return self.sensed.width(), expected, WIDTH_TOLERANCE + part * expected

    def _apart(self, width: float, expected: float) -> str:
        return (
            f"the fingers are {1e3 * width:.1f} mm apart, "
            f"the {self.item.name} measures {1e3 * expected:.1f} mm"
        )

    def _against(self) -> str | None:
        forces, (width, expected, within) = self.sensed.finger_forces(), self._widths()
        closing = self.settled and not self.sensed.grip_settled()
        if abs(width - expected) > within or closing:
            return self._apart(width, expected)
        if forces.min() < LEAST_SHARE * self.force:
            return (
                f"the fingers press with {forces[0]:.1f} N and {forces[1]:.1f} N, "
                f"{self.force:.1f} N were asked for"
            )
        return None
