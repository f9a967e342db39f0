"""BoardWiper: the steps that move a sponge over a board."""

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np
from mink import SE3

from robo47_qp.motion.waypoint import Motion, Waypoint, tool_down
from robo47_qp.run.compliance import Compliance
from robo47_qp.run.contact_steps import Comply
from robo47_qp.run.failure import Cause, Condition
from robo47_qp.run.steps import Move, StepLike
from robo47_qp.tasks.handling.item_handler import ItemHandler
from robo47_qp.tasks.heading import heading
from robo47_qp.tasks.wipe.board import SURFACE, WipeSettings

_STROKE, _LANES = 0.09, (-0.04, 0.0, 0.04)
"""Half the length of a stroke along the board's y, and the positions of the strokes along its x
[m]."""
_ABOVE = 0.015
"""Height of the sponge above the nominal surface before it is lowered [m]."""
_STEADY = 0.3
"""Time for which the force must stay close to its set value; a force that oscillates with a period
of 0.9 s crosses it in less [s]."""
_SETTLING = 0.5
"""Speed without contact once the sponge is on the board, relative to that of the touch [-]: arm and
foam, which swing at the latter, are then damped twice as much, and the force settles sooner."""
_FIRM = np.array([3000.0] * 3 + [100.0] * 3)
"""Stiffness of the tool on the board [N/m, N·m/rad]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BoardWiper(ItemHandler):
    """Picks the sponge, wipes the board with it and puts it back."""

    settings: WipeSettings
    T_world_board: SE3
    """Estimated pose of the board, but for its height."""

    def wipe(self) -> Generator[StepLike, None, None]:
        """Lower the sponge to the board, wipe and lift it; fails with DROP or TIMEOUT."""
        yield Move(
            waypoints=self.to_board(),
            before=(self._held(Cause.DROP),),
            during=(self._held(Cause.DROP),),
        )
        pressing = Compliance(
            stiffness=_FIRM,
            axis=np.array([0.0, 0.0, -1.0]),
            force=self.settings.force,
            speed=self.settings.touch_speed,
        )
        damped = replace(pressing, speed=_SETTLING * self.settings.touch_speed)
        held = (self._held(Cause.DROP),)
        yield Comply(
            name="touch down",
            waypoints=(),
            compliance=pressing,
            seconds=2.0,
            until=self._in_contact(),
            during=held,
            stay=True,
        )
        yield Comply(
            name="settle",
            waypoints=(),
            compliance=damped,
            seconds=5.0,
            until=self._pressed(),
            during=held,
            stay=True,
        )
        yield Comply(
            name="wipe",
            # Level, at the height at which the tool is now.
            waypoints=self.strokes(self.sensed.tool_pose().translation()[2]),
            compliance=pressing,
            renew=True,
            speed=self.settings.speed,
            during=held,
        )
        off = self._line("lift off", self._up(self.sensed.tool_pose()))
        yield Comply(
            name="lift off", waypoints=(off,), compliance=Compliance(stiffness=_FIRM), during=held
        )

    def to_board(self) -> tuple[Waypoint, Waypoint]:
        """Return the waypoints above the first stroke, and down to a little above the board."""
        height = self._let_down()
        strokes, start = self.strokes(height), self._over(_LANES[0], -_STROKE, height)
        payload = self.item.payload(SE3.identity())
        hover = Waypoint(name="hover", target=start, motion=Motion.LIN, carried=payload)
        above = self._up(start)
        onward = (hover, *strokes)
        return Waypoint(name="to the board", target=above, carried=payload, onward=onward), hover

    def _let_down(self) -> float:
        """Return the height of the tool from which the sponge is lowered [m]."""
        return SURFACE + 0.5 * self.item.height + _ABOVE

    def strokes(self, height: float) -> tuple[Waypoint, ...]:
        """Return the strokes up and down the board at a height of the tool, without stops [m]."""
        ways, end = [], _STROKE
        for i, x in enumerate(_LANES):
            if i:
                centre = self._over(0.5 * (x + _LANES[i - 1]), -end, height)
                middle = centre.translation() - np.sign(end) * 0.5 * (x - _LANES[i - 1]) * self._y()
                ways.append(
                    Waypoint(
                        name=f"turn {i}",
                        target=self._over(x, -end, height),
                        motion=Motion.CIRC,
                        through=middle,
                        blend=0.01,
                    )
                )
            last = i == len(_LANES) - 1
            ways.append(
                Waypoint(
                    name=f"stroke {i + 1}",
                    target=self._over(x, end, height),
                    motion=Motion.LIN,
                    blend=0.0 if last else 0.01,
                )
            )
            end = -end
        return tuple(ways)

    def _over(self, x: float, y: float, height: float) -> SE3:
        """Return the tool pose over a position on the board, at a height in the world [m]."""
        at = self.T_world_board @ np.array([x, y, 0.0])
        at[2] = height
        return tool_down(at, heading(self.T_world_board))

    def _y(self) -> np.ndarray:
        """Return the direction of the strokes (3,) [-]."""
        return self.T_world_board.rotation().as_matrix()[:, 1]

    def _force(self) -> float:
        """Return the force of the sponge on the board, as measured without its weight [N]."""
        return float(self.sensed.felt_force()[2]) + 9.81 * self.item.mass

    def _pressed(self) -> Condition:
        """Return the condition that the force has been close to its set value for a while."""
        since = self.sensed.time

        def against() -> str | None:
            nonlocal since
            now, force = self.sensed.time, self._force()
            if abs(force - self.settings.force) > 0.02 * self.settings.force:
                since = now
            if now - since >= _STEADY:
                return None
            return (
                f"the sponge presses with {force:.2f} N, {self.settings.force:.2f} N are asked for"
            )

        return Condition(name="the force is steady", cause=Cause.TIMEOUT, against=against)

    def _in_contact(self) -> Condition:
        def against() -> str | None:
            force = self._force()
            if force >= 0.5 * self.settings.force:
                return None
            return (
                f"the sponge presses with {force:.1f} N, {self.settings.force:.1f} N are asked for"
            )

        return Condition(name="the sponge is on the board", cause=Cause.TIMEOUT, against=against)
