"""Grasp check: whether an item is between the fingers."""

from collections.abc import Callable
from dataclasses import dataclass

from mink import SE3

from robo47_qp.run.failure import Cause, Condition
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.item import Item

_WIDTH_TOLERANCE = 3e-3
"""How far the fingers' width may be from the item's [m]."""
_LEAST_SHARE = 0.1
"""Force of a finger that holds, relative to the one that was asked for [-]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GraspCheck:
    """Checks that an item is held: the opening width is that of the item, and the fingers press."""

    simulation: Simulation
    item: Item
    force: float
    """Commanded force of one finger [N]."""
    standing: Callable[[], SE3]
    """Returns the currently seen T_world_item, its z axis up."""
    settled: bool = False
    """True if the fingers must be at rest, too."""

    def condition(self, cause: Cause) -> Condition:
        """Return the condition that the item is held; a violation fails with `cause`."""
        name = f"the fingers hold the {self.item.name}"
        return Condition(name=name, cause=cause, against=self._against)

    def _against(self) -> str | None:
        sim, name = self.simulation, self.item.name
        width, forces = sim.width(), sim.last_finger_forces()
        expected = self.item.width(sim.tool_pose(), self.standing())
        closing = self.settled and not sim.grip_settled()
        if abs(width - expected) > _WIDTH_TOLERANCE or closing:
            return (
                f"the fingers are {1e3 * width:.1f} mm apart, "
                f"the {name} measures {1e3 * expected:.1f} mm"
            )
        if forces.min() < _LEAST_SHARE * self.force:
            return (
                f"the fingers press with {forces[0]:.1f} N and {forces[1]:.1f} N, "
                f"{self.force:.1f} N were asked for"
            )
        return None
