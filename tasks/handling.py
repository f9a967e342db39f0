"""Handling: the steps that pick an item and put it somewhere."""

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np
from mink import SE3

from robo47_qp.failure import Cause
from robo47_qp.simulation import Simulation
from robo47_qp.steps import Condition, Grasp, Move, Release, Step
from robo47_qp.waypoint import Motion, Place, Waypoint
from tasks.headings import heading
from tasks.item import Item, turned_about_vertical
from tasks.looking import look

LOST = frozenset({Cause.GRASP, Cause.SLIP, Cause.DROP})
"""Failures after which it makes sense to look where the item is and to try again."""
HOME = Waypoint(name="home", target=Place.HOME)
_WIDTH_TOLERANCE = 3e-3
"""How far the fingers' width may be from the item's [m]."""
_LEAST_SHARE = 0.1
"""Force of a finger that holds, relative to the one that was asked for [-]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Handling:
    """Picks and places one item of one world with the tool pointing down."""

    simulation: Simulation
    item: Item
    above: float
    """Height of the tool as it comes and goes, in the world [m]."""
    force: float = 30.0
    """Of one finger [N]."""

    def pick(self) -> Generator[Step, None, None]:
        """Look, approach, grasp and lift; fails with GRASP, or DROP on the way up."""
        T_world_item = yield from look(self.simulation, self.item.name)
        yield from self.approach(T_world_item)
        yield Grasp(name="close gripper", force=self.force, after=(self._held(Cause.GRASP),))
        yield self.lift(self.simulation.tool_pose(), self.simulation.seen_pose(self.item.name))

    def place(self, T_world_goal: SE3) -> Generator[Step, None, None]:
        """Carry the item to a pose and let go of it; fails with DROP on the way."""
        T_world_item = yield from look(self.simulation, self.item.name)
        T_world_tcp = self.simulation.tool_pose()
        yield self.carry(T_world_tcp, T_world_item, T_world_goal)
        # It may have turned between the fingers on the way.
        T_world_item = yield from look(self.simulation, self.item.name)
        yield self.lower(self.simulation.tool_pose(), T_world_item, T_world_goal)
        yield Release()

    def retreat(self, T_world_tcp: SE3) -> Waypoint:
        """Straight up from a pose."""
        return self._line("retreat", self._up(T_world_tcp))

    def back_off(self) -> Generator[Step, None, None]:
        """Up and away from what went wrong, gripper open for the next time."""
        yield self._line("back off", self._up(self.simulation.tool_pose()))
        yield Release(name="open gripper")

    def approach(self, T_world_item: SE3) -> list[Waypoint]:
        """To above the item and down to it."""
        grasp = self.item.grasp(T_world_item, self.simulation.gripper.width_max)
        descend = self._line("descend", grasp)
        return [Waypoint(name="approach", target=self._up(grasp), onward=(descend,)), descend]

    def lift(self, T_world_tcp: SE3, T_world_item: SE3) -> Move:
        """Straight up with the item."""
        return self._carrying(
            Waypoint(
                name="lift",
                target=self._up(T_world_tcp),
                motion=Motion.LIN,
                carried=self.item.payload(T_world_tcp.inverse() @ T_world_item),
            )
        )

    def carry(self, T_world_tcp: SE3, T_world_item: SE3, T_world_goal: SE3) -> Move:
        """To above the place from which the item can be lowered to its goal."""
        lower = self.lower(T_world_tcp, T_world_item, T_world_goal).waypoints[0]
        target = self._up(self.release_pose(T_world_tcp, T_world_item, T_world_goal))
        return self._carrying(
            Waypoint(name="carry", target=target, carried=lower.carried, onward=(lower,))
        )

    def lower(self, T_world_tcp: SE3, T_world_item: SE3, T_world_goal: SE3) -> Move:
        """Straight down, until the item is at its goal."""
        return self._carrying(
            Waypoint(
                name="lower",
                target=self.release_pose(T_world_tcp, T_world_item, T_world_goal),
                motion=Motion.LIN,
                carried=self.item.payload(T_world_tcp.inverse() @ T_world_item),
            )
        )

    def release_pose(self, T_world_tcp: SE3, T_world_item: SE3, T_world_goal: SE3) -> SE3:
        """T_world_tcp with the item at its goal, held as it is held now, the wrist turned least."""
        tool, item, goal = (heading(T) for T in (T_world_tcp, T_world_item, T_world_goal))
        turn = self.item.same_heading(tool + goal - item) - tool
        placed = turned_about_vertical(T_world_item, turn, T_world_goal.translation())
        return placed @ T_world_item.inverse() @ T_world_tcp

    def _carrying(self, waypoint: Waypoint) -> Move:
        held = (self._held(Cause.DROP),)
        return Move(waypoints=(waypoint,), before=held, during=held, after=held)

    def _held(self, cause: Cause) -> Condition:
        name = f"the fingers hold the {self.item.name}"
        return Condition(name=name, cause=cause, against=self._against_holding)

    def _against_holding(self) -> str | None:
        """What speaks against the item being between the fingers; None where it is."""
        width, forces = self.simulation.width(), self.simulation.last_finger_forces()
        pose = self.simulation.seen_pose(self.item.name)
        expected = self.item.width(self.simulation.tool_pose(), pose)
        if abs(width - expected) > _WIDTH_TOLERANCE:
            return (
                f"the fingers are {1e3 * width:.1f} mm apart, "
                f"the {self.item.name} measures {1e3 * expected:.1f} mm"
            )
        if forces.min() < _LEAST_SHARE * self.force:
            return (
                f"the fingers press with {forces[0]:.1f} N and {forces[1]:.1f} N, "
                f"{self.force:.1f} N were asked for"
            )
        return None

    def _line(self, name: str, target: SE3) -> Waypoint:
        return Waypoint(name=name, target=target, motion=Motion.LIN)

    def _up(self, T_world_tcp: SE3) -> SE3:
        x, y, _ = T_world_tcp.translation()
        return SE3.from_rotation_and_translation(
            T_world_tcp.rotation(), np.array([x, y, self.above])
        )
